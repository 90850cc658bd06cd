# %% [markdown]
# # Which detector? A study, plotted
#
# `etalon study` renders markers at poses all over a volume and asks detectors where they are. Its tables come
# as columns of numpy; `pandas.DataFrame(study["results"])` takes them as they are.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import etalon
from etalon.testing import demo

Path("study.yaml").write_text(f"""
etalon: study/1
id: two-detectors
camera: {demo / "camera.yml"}
background: 0.6
white_level: 0.8
poses: {{count: 60, seed: 3, z_mm: [250, 900], roll_deg: [-45, 45], pitch_deg: [-45, 45], yaw_deg: [-180, 180]}}
detectors:
  - {{name: AprilTag, detector: apriltag, marker: "apriltag:36h11:5@50mm"}}
  - {{name: ArUco, detector: aruco, marker: "aruco:4X4_50:7@50mm"}}
""")
study = etalon.run_study("study.yaml", "study")
results = study["results"]

# %%
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for detector in ("AprilTag", "ArUco"):
    own = results["detector"] == detector
    seen = own & (results["detected"] == 1)
    print(f"{detector:9} detected {seen.sum()} of {own.sum()}, "
          f"median distance {np.median(results['distance_mm'][seen]):.2f} mm, "
          f"flips {int(results['flip'][seen].sum())}")
    axes[0].loglog(results["size_px"][seen], results["distance_mm"][seen], ".", label=detector)
    axes[1].loglog(results["size_px"][seen], results["corner_rms_px"][seen], ".", label=detector)
axes[0].set(xlabel="size of the marker, px", ylabel="error of the position, mm")
axes[1].set(xlabel="size of the marker, px", ylabel="error of the corners, px RMS")
axes[0].legend()
figure.savefig("study_plotted.png", dpi=100)
