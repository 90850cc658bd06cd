# %% [markdown]
# # The bias field of a run
#
# A run of `etalon qualify` against the twin: a simulated stage and camera on this machine, over the real
# protocols. The twin's camera has a focal length that is 0.5 % off what the station believes, and the run
# must see it. The plan is short, so that this takes seconds; for your own station it is
# `etalon.Station("station.yaml").qualify("run")`.

# %%
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import etalon
from etalon.testing import demo

folder = Path("station")
shutil.copytree(demo, folder)
for name in ("station.yaml", "twin.yaml"):
    text = (folder / name).read_text()
    for what, by in {
        "poses: 100": "poses: 32", "repeats: 8": "repeats: 0", "frames: 5": "frames: 1", "settle_ms: 50": "settle_ms: 5",
        "speed: 400": "speed: 4000", "speed_deg: 360": "speed_deg: 3600",
        "focal_length_percent: 0,": "focal_length_percent: 0.5,",
    }.items():
        text = text.replace(what, by)
    (folder / name).write_text(text)

with etalon.twin(folder / "twin.yaml", folder / "station.yaml") as station:
    run = station.qualify("run")
print("verdict", run["outcome"])
for quantity in run["measurements"]:
    if quantity["outcome"] in ("PASS", "FAIL", "INCONCLUSIVE"):
        print(f"  {quantity['name']}: {quantity['value']:.3f} +- {quantity['expanded_uncertainty']:.3f} {quantity['unit']}, limit {quantity['limit']}")

# %% [markdown]
# `b3` is the error of each hold-out pose: the photograph's pose less the one to be expected there, freed of
# what the detector does to a perfect picture. A wrong focal length shows as an error in depth that grows
# with the distance.

# %%
poses = run["poses"]
judged = (poses["split"] == "hold-out") & (poses["used"] == 1)
x, z = poses["predicted_tx"][judged], poses["predicted_tz"][judged]
dx, dz = poses["b3_x_mm"][judged], poses["b3_z_mm"][judged]
slope = np.polyfit(z, dz, 1)[0]
print(f"{judged.sum()} judged poses; the error in depth grows by {100 * slope:.2f} % of the distance")

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
arrows = left.quiver(x, z, dx, dz, dz, cmap="RdBu", angles="xy")
left.set(xlabel="x, mm", ylabel="z (distance), mm", title="error of the pose, seen from above, mm along z")
figure.colorbar(arrows)
right.plot(z, dz, "o")
right.set(xlabel="z (distance), mm", ylabel="error in z, mm")
figure.savefig("bias_field.png", dpi=100)
