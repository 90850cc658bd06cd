import threading

import numpy
import pytest
from conftest import brown, exposed, moved, pose

import etalon

TRUTH = pose(0.35, -0.2, 0.1, 20, -10, 420)


@pytest.fixture(scope="module")
def photo(camera, tag):
    return exposed(camera, [(tag, TRUTH)])


def test_corners_are_where_the_formula_projects_them(camera, tag, photo):
    found = etalon.detect(photo, tag, camera)
    truth = brown(camera.parameters, moved(TRUTH, tag.points_mm))
    assert found.found and found.reason == "" and found.points.tolist() == [0, 1, 2, 3]
    assert numpy.abs(found.corners - truth).max() < 0.25  # a detector's bias on a blurred tag
    assert numpy.array_equal(etalon.detect(photo, tag).corners, found.corners)
    pose_found = found.pose
    assert numpy.abs(pose_found.camera_from_marker - TRUTH)[:3, 3].max() < 1.0
    assert pose_found.reprojection_rms_px < 0.25 and pose_found.alternative_rms_px > pose_found.reprojection_rms_px


def test_a_pose_from_exact_corners_is_exact(camera, tag):
    seen = brown(camera.parameters, moved(TRUTH, tag.points_mm))
    found = etalon.estimate_pose(camera, tag.points_mm, seen)
    assert numpy.abs(found.camera_from_marker - TRUTH).max() < 1e-6
    assert numpy.linalg.eigvalsh(found.covariance_per_px2).min() > 0
    assert etalon.estimate_pose(camera, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], seen) is None
    with pytest.raises(etalon.ConfigError, match=r"pixels: must be \(N, 2\), is \(4, 3\)"):
        etalon.estimate_pose(camera, tag.points_mm, tag.points_mm)
    with pytest.raises(etalon.ConfigError, match="pixels: must be as many as points_mm"):
        etalon.estimate_pose(camera, tag.points_mm, seen[:3])


def test_opencv_reads_what_is_rendered(camera):
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "aruco") or not hasattr(cv2.aruco, "detectMarkers"):
        pytest.skip("this OpenCV has no cv2.aruco.detectMarkers")
    marker = etalon.Marker("aruco:4X4_50:7@80mm")
    photo = exposed(camera, [(marker, TRUTH)])
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners, ids, _ = cv2.aruco.detectMarkers(photo, dictionary)
    assert ids.tolist() == [[7]]
    truth = brown(camera.parameters, moved(TRUTH, marker.points_mm))
    assert numpy.abs(corners[0][0] - truth).max() < 1.0  # whole pixels: not refined
    assert numpy.abs(etalon.detect(photo, marker).corners - truth).max() < 0.3


def test_what_is_not_there_is_no_error(camera, photo):
    found = etalon.detect(photo, etalon.Marker("apriltag:36h11:6@80mm"), camera)
    assert not found.found and found.corners is None and found.pose is None and "not found" in found.reason
    with pytest.raises(etalon.ConfigError, match="detector"):
        etalon.Detector(etalon.Marker("apriltag:36h11:6@80mm"), "chessboard")


def test_threads_may_share_a_detector(camera, tag, photo):
    detector = etalon.Detector(tag)
    expected = detector.detect(photo, camera).corners
    found = []
    work = [threading.Thread(target=lambda: found.append(detector.detect(photo, camera).corners)) for _ in range(8)]
    for thread in work:
        thread.start()
    for thread in work:
        thread.join()
    assert len(found) == 8 and all(numpy.array_equal(corners, expected) for corners in found)


def test_a_photometric_pose_is_within_its_covariance(camera, tag, photo):
    detector = etalon.PhotometricDetector(camera, tag, background=0.6)
    start = TRUTH @ pose(0.01, -0.01, 0.005, 0.6, -0.4, 3)
    found = detector.find(photo, start)
    assert found.converged and found.covariance.shape == (6, 6)
    error = etalon.vector_from_rigid(found.camera_from_marker) - etalon.vector_from_rigid(TRUTH)
    deviations = numpy.sqrt(numpy.diag(found.covariance))
    assert (numpy.abs(error[3:]) < 5 * deviations[3:]).all()
    assert deviations[3:].max() < 0.2 and deviations[:3].max() < 2e-3
    with pytest.raises(etalon.NumericalError):
        detector.find(photo, pose(0, 0, 0, -130, 80, 420))


def test_a_photograph_matches_its_render_and_no_other(camera, tag, photo):
    result = etalon.compare(photo, tag, camera, TRUTH, background=0.6)
    assert result.is_matched and result.findings == [] and result.failure == ""
    # Noise of the sensor: white is 0.8 * 247 DN, black 0; the formula's deviations in DN.
    white = numpy.sqrt(0.8 * 247 / 60 + (10 / 60) ** 2 + 1 / 12)
    assert 0.3 < result.refined.rms_gray < white
    fit = result.calibrated
    assert numpy.array_equal(fit.camera_from_marker, TRUTH) or numpy.allclose(fit.camera_from_marker, TRUTH)
    assert fit.residual.shape == photo.shape and numpy.shares_memory(fit.residual, result.calibrated.residual)
    used = fit.use == 2
    assert abs(numpy.sqrt((fit.residual[used].astype(float) ** 2).mean()) - fit.rms_gray) < 1e-3
    assert numpy.abs(photo - fit.predicted - fit.residual)[fit.use > 0].max() < 1e-3

    hidden = photo.copy()
    row, column = brown(camera.parameters, moved(TRUTH, numpy.zeros((1, 3))))[0][::-1].astype(int)
    hidden[row - 15 : row + 15, column - 15 : column + 15] = 120
    result = etalon.compare(hidden, tag, camera, TRUTH, background=0.6)
    assert not result.is_matched and result.findings[0].sentence
    lost = etalon.compare(numpy.full_like(photo, 90), tag, camera)
    assert not lost.is_matched and lost.failure and lost.refined is None
