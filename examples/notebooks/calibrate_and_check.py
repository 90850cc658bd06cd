# %% [markdown]
# # Calibrate a camera, and check what the result is worth
#
# Photographs of a chessboard give a camera's intrinsics. Here they are rendered, so that the truth is known;
# of your own photographs it would be `photos = [etalon.read_image(path) for path in paths]`.

# %%
import matplotlib.pyplot as plt
import numpy as np

import etalon
from etalon.testing import demo

truth = etalon.Camera.load(demo / "camera.yml")
board = etalon.Marker("chessboard:9x6@25mm")
renderer, sensor = etalon.Renderer(truth), etalon.SensorModel(truth)

poses = etalon.rigid_from_vector([   # all over the image, its corners too, and tilted all ways
    [0.3, -0.2, 0.1, -100, -60, 400],
    [-0.3, 0.3, 0.0, -120, -80, 450],
    [0.1, 0.5, 0.3, -70, -80, 390],
    [-0.1, -0.5, -0.2, -90, -20, 430],
    [0.2, 0.2, 0.0, -240, -175, 430],
    [0.2, -0.2, 0.0, 50, -175, 430],
    [-0.2, 0.2, 0.0, -240, 55, 430],
    [-0.2, -0.2, 0.0, 50, 55, 430],
])
photos = [
    sensor.expose(np.float32(0.8) * renderer.render([(board, pose)], background=0.8).radiance, seed=number)
    for number, pose in enumerate(poses)
]

# %% [markdown]
# `leave_one_out` and the bootstrap (`resamples`) take most of the time; here without the latter.

# %%
result = etalon.calibrate(photos, board, resamples=0)
print(f"model {result.model}: {result.rms_px:.3f} px RMS, {result.leave_one_out_rms_px:.3f} px of photographs left out")
for name in result.parameters:
    found, deviation = result.camera.parameters[name], result.deviations[name]
    print(f"{name:5} {found:10.4f} +- {deviation:8.4f}   off by {(found - truth.parameters[name]) / deviation:5.1f} deviations")

# %% [markdown]
# Parameters make up for each other; what counts is where rays are seen. The map says how uncertain that is,
# and the check whether the whole image can be used. (Leave the last four photographs out: the corners are
# then guesses, and the difference below shows how wrong.)

# %%
uncertainty = result.uncertainty
check = result.camera.check()
print("usable:", not check["has_fault"], f"{check['horizontal_deg']:.1f} x {check['vertical_deg']:.1f} deg")
for finding in check["findings"]:
    print(f"  {finding['weight']}: {finding['message']}")

difference = result.camera.project(truth.unproject(uncertainty["pixels"])) - uncertainty["pixels"]
print(f"rays are seen {np.nanmax(np.linalg.norm(difference, axis=1)):.3f} px off at most, all over the image")

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
places = uncertainty["pixels"]
shown = left.scatter(*places.T, c=uncertainty["rotated_px"], marker="s", s=30)
left.set_title("uncertainty of the projection, px")
left.invert_yaxis()
figure.colorbar(shown)
residuals = np.concatenate([view.residuals_px for view in result.views])
right.plot(*residuals.T, ".", markersize=3)
right.set_aspect("equal")
right.set_title("corners: photograph less model, px")
figure.savefig("calibrate_and_check.png", dpi=100)

result.camera.save("calibrated.yml")
result.camera.save("calibrated-opencv.yml", "opencv")
again = etalon.Camera.load("calibrated.yml")
assert again.covariance
print("read back:", again, "covariance of", again.covariance[0])
