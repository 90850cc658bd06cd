# %% [markdown]
# # Render a tag, and find it again
#
# A calibrated camera looks at an AprilTag of 80 mm. We render what it sees, with its lens and its sensor's
# noise, and ask two detectors where the tag is: one goes by the corners, the other by every pixel.

# %%
import matplotlib.pyplot as plt
import numpy as np

import etalon
from etalon.testing import demo

camera = etalon.Camera.load(demo / "camera.yml")
tag = etalon.Marker("apriltag:36h11:5@80mm")
camera_from_marker = etalon.rigid_from_vector([0.35, -0.2, 0.1, 20, -10, 420])  # rad and mm
print(camera, tag)

# %% [markdown]
# Radiance is linear, 1 is full scale. The exposure is a factor of it; the sensor makes code values.

# %%
image = etalon.Renderer(camera).render([(tag, camera_from_marker)], background=0.6)
exposure = np.float32(0.8)
photo = etalon.SensorModel(camera).expose(exposure * image.radiance, seed=7)
print(image.plan)
print("codes", photo.dtype, photo.shape, photo.min(), "to", photo.max())

# %% [markdown]
# The corners, and the pose from them. Truth is at hand: the corners of the tag, projected.

# %%
found = etalon.detect(photo, tag, camera)
assert found.corners is not None and found.pose, found.reason
truth = camera.project(tag.points_mm @ camera_from_marker[:3, :3].T + camera_from_marker[:3, 3])
print("corners less truth, px\n", np.round(found.corners - truth, 3))
print("position less truth, mm", np.round((found.pose.camera_from_marker - camera_from_marker)[:3, 3], 3))

# %% [markdown]
# The pose from all pixels, with its standard deviations.

# %%
detector = etalon.PhotometricDetector(camera, tag, background=0.6)
pose = detector.find(photo, found.pose.camera_from_marker)
deviations = np.sqrt(np.diag(pose.covariance))
print("position less truth, mm", np.round((pose.camera_from_marker - camera_from_marker)[:3, 3], 3))
print("standard deviations, mm", np.round(deviations[3:], 3))

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
left.imshow(photo, cmap="gray")
left.plot(*found.corners.T, "r+", markersize=10)
left.set_title("photograph, and the corners found")
comparison = etalon.compare(photo, tag, camera, pose.camera_from_marker, background=0.6)
assert comparison.refined, comparison.failure
shown = right.imshow(np.where(comparison.refined.use > 0, comparison.refined.residual, np.nan), cmap="RdBu", vmin=-6, vmax=6)
right.set_xlim(150, 400)
right.set_ylim(300, 80)
right.set_title("photograph less render, gray")
figure.colorbar(shown)
figure.savefig("render_and_detect.png", dpi=100)
print("matched:", comparison.is_matched, f"{comparison.refined.rms_gray:.2f} gray RMS, noise {comparison.refined.noise_gray:.2f}")
