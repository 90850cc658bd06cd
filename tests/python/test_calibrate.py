import numpy
import pytest
from conftest import ROOT, brown, exposed, moved, pose

import etalon

BOARD = "chessboard:9x6@25mm"
POSES = [
    pose(*numbers)
    for numbers in (
        (0.3, -0.2, 0.1, -100, -60, 400),
        (-0.3, 0.3, 0, -120, -80, 500),
        (0.2, 0.4, -0.1, -90, -60, 450),
        (-0.2, -0.4, 0.2, -60, -90, 420),
        (0.5, 0.1, 0.05, -100, -70, 380),
    )
]


@pytest.fixture(scope="module")
def photos(camera):
    board = etalon.Marker(BOARD)
    return [exposed(camera, [(board, one)], background=0.8) for one in POSES]


@pytest.fixture(scope="module")
def calibration(photos):
    return etalon.calibrate(photos, etalon.Marker(BOARD), model="standard", leave_one_out=False, resamples=0)


def test_renders_give_their_camera_back(camera, calibration):
    assert calibration.parameters == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
    assert calibration.rms_px < 0.1 and len(calibration.views) == 5
    found, truth = calibration.camera.parameters, camera.parameters
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(found[name] - truth[name]) < max(5 * calibration.deviations[name], 0.5), name
    assert numpy.allclose(numpy.sqrt(numpy.diag(calibration.covariance))[0], calibration.deviations["fx"])
    names, covariance = calibration.camera.covariance
    assert names == calibration.parameters and numpy.array_equal(covariance, calibration.covariance)
    assert calibration.uncertainty["pixels"].shape[1] == 2
    # Where the points were, the two cameras see the same: in px, after what a pose takes back.
    for view, truth_pose in zip(calibration.views, POSES):
        assert view.used and not view.left_out.any()
        assert numpy.abs(view.camera_from_target - truth_pose)[:3, 3].max() < 1.5


def test_opencv_calibrates_the_same_corners_alike(photos, calibration):
    cv2 = pytest.importorskip("cv2")
    views = [etalon.observe(photo, etalon.Marker(BOARD)).view for photo in photos]
    rms, matrix, *_ = cv2.calibrateCamera(
        [view.points_mm.astype(numpy.float32) for view in views],
        [view.pixels.astype(numpy.float32) for view in views], (512, 384), None, None,
    )
    assert abs(rms - calibration.rms_px) < 1e-3
    assert numpy.abs(matrix - calibration.camera.matrix).max() < 0.05


def test_exact_points_give_an_exact_camera(camera):
    points = etalon.Marker(BOARD).points_mm
    views = [etalon.CalibrationView(points, brown(camera.parameters, moved(one, points))) for one in POSES]
    result = etalon.calibrate_camera(views, (512, 384), model="standard", leave_one_out=False, resamples=0)
    for name, value in camera.parameters.items():
        assert abs(result.camera.parameters[name] - value) < 1e-4 * max(1, abs(value)), name
    assert max(numpy.abs(view.residuals_px).max() for view in result.views) < 1e-6


def test_what_cannot_be_calibrated_says_why(photos, tag):
    with pytest.raises(etalon.ConfigError, match="target"):
        etalon.calibrate(photos, tag)
    with pytest.raises(etalon.NumericalError):
        etalon.calibrate(photos[:2], etalon.Marker(BOARD))
    with pytest.raises(etalon.ConfigError, match="photos: must all have one size"):
        etalon.calibrate([photos[0], photos[1][:-1]], etalon.Marker(BOARD))
    nothing = etalon.observe(numpy.full((384, 512), 90, numpy.uint8), etalon.Marker(BOARD))
    assert nothing.view is None and nothing.reason
    with pytest.raises(etalon.ConfigError, match=r"points_mm: must be \(N, 3\)"):
        etalon.CalibrationView(numpy.zeros((4, 2)), numpy.zeros((4, 2)))


def test_real_photographs_are_calibrated_as_opencv_does():
    folder = next((ROOT / "build").glob("photos"), None)
    if not folder or not (folder / "left01.jpg").exists():
        pytest.skip("the photographs of opencv-doc are not unpacked: ./test.sh does it")
    cv2 = pytest.importorskip("cv2")
    photos = [etalon.read_image(path) for path in sorted(folder.glob("left*.jpg"))[:6]]
    ours = etalon.calibrate(photos, etalon.Marker(BOARD), model="standard", leave_one_out=False, resamples=0)
    points, pixels = [], []
    for photo in photos:
        _, corners = cv2.findChessboardCorners(photo, (9, 6))
        criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-3)
        pixels.append(cv2.cornerSubPix(photo, corners, (5, 5), (-1, -1), criteria))
        points.append(etalon.Marker(BOARD).points_mm.astype(numpy.float32))
    _, matrix, *_ = cv2.calibrateCamera(points, pixels, photos[0].shape[::-1], None, None)
    assert abs(matrix[0, 0] - ours.camera.matrix[0, 0]) < 5 * ours.deviations["fx"]
