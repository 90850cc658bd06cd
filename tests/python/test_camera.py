import threading

import numpy
import pytest
from conftest import DEMO, brown

import etalon

RANDOM = numpy.random.default_rng(3)
POINTS = RANDOM.uniform((-150, -90, 300), (170, 110, 800), (200, 3))


def differences(function, at, step):
    """(N, outputs, inputs) by central differences."""
    columns = []
    for axis in range(at.shape[1]):
        shift = numpy.zeros(at.shape[1])
        shift[axis] = step
        columns.append((function(at + shift) - function(at - shift)) / (2 * step))
    return numpy.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def fisheye(tmp_path_factory):
    path = tmp_path_factory.mktemp("fisheye") / "camera.yml"
    path.write_text(
        "etalon: camera/1\nimage: {width: 800, height: 600}\nprojection: equidistant\n"
        "intrinsics: {fx: 260, fy: 250, cx: 391.5, cy: 305.25}\n"
    )
    return etalon.Camera.load(path)


def test_projects_as_the_formula_says(camera):
    assert numpy.abs(camera.project(POINTS) - brown(camera.parameters, POINTS)).max() < 1e-9


def test_projects_as_opencv_does_with_all_fourteen_coefficients():
    cv2 = pytest.importorskip("cv2")
    matrix = numpy.array([[600, 0, 331.5], [0, 580, 229.25], [0, 0, 1]])
    distortion = [-0.21, 0.05, 1e-3, -7e-4, 0.011, 0.02, -0.01, 0.003, 2e-4, -1e-4, 3e-4, 5e-5, 0.01, -0.02]
    ours = etalon.Camera((640, 480), matrix, distortion)
    theirs = cv2.projectPoints(POINTS, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), matrix, numpy.array(distortion))[0][:, 0]
    assert numpy.abs(ours.project(POINTS) - theirs).max() < 1e-9


def test_a_wide_lens_projects_as_its_formula_says(fisheye):
    points = RANDOM.normal(size=(100, 3)) * (3, 3, 1)
    theta = numpy.arctan2(numpy.hypot(points[:, 0], points[:, 1]), points[:, 2])
    phi = numpy.arctan2(points[:, 1], points[:, 0])
    truth = (260, 250) * (theta * [numpy.cos(phi), numpy.sin(phi)]).T + (391.5, 305.25)
    assert numpy.nanmax(numpy.abs(fisheye.project(points) - truth)) < 1e-9


def test_jacobians_are_the_differences(camera, fisheye):
    for one in (camera, fisheye):
        pixels, by_point = one.project(POINTS, jacobians=True)
        assert by_point.shape == (200, 2, 3)
        assert numpy.array_equal(pixels, one.project(POINTS))
        assert numpy.abs(by_point - differences(one.project, POINTS, 1e-3)).max() < 1e-7
        rays, by_pixel = one.unproject(pixels, jacobians=True)
        assert by_pixel.shape == (200, 3, 2)
        assert numpy.abs(by_pixel - differences(one.unproject, pixels, 1e-2)).max() < 1e-8


def test_unprojecting_is_the_inverse(camera, fisheye):
    rays = camera.unproject(camera.project(POINTS))
    assert numpy.abs(rays - POINTS / POINTS[:, 2:]).max() < 1e-9
    rays = fisheye.unproject(fisheye.project(POINTS))
    assert numpy.abs(rays - POINTS / numpy.linalg.norm(POINTS, axis=1, keepdims=True)).max() < 1e-9


def test_what_has_no_image_is_nan(camera):
    pixels, by_point = camera.project([[7, 5, 500], [7, 5, -500], [numpy.nan, 0, 1]], jacobians=True)
    assert numpy.isnan(pixels).all(axis=1).tolist() == [False, True, True]
    assert numpy.isnan(by_point).all(axis=(1, 2)).tolist() == [False, True, True]
    folding = etalon.Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.3])
    # x (1 - 0.3 x^2) is largest at x = 1 / sqrt(0.9): 0.7027, or 671.4 px.
    rays = folding.unproject([[671, 240], [672, 240]])
    assert numpy.isnan(rays).all(axis=1).tolist() == [False, True]


def test_leading_dimensions_stay(camera):
    grid = camera.project(POINTS.reshape(4, 50, 3))
    assert grid.shape == (4, 50, 2)
    assert numpy.array_equal(grid.reshape(-1, 2), camera.project(POINTS))
    assert camera.project(POINTS[7]).shape == (2,)
    assert camera.project(numpy.empty((0, 3))).shape == (0, 2)
    assert numpy.array_equal(camera.project(POINTS[::2]), camera.project(POINTS)[::2])  # strided
    assert camera.project([7, 5, 500]).shape == (2,)  # whole numbers


@pytest.mark.parametrize(
    "points, error, text",
    [
        (numpy.zeros((3, 2)), ValueError, r"points_camera: must be \(\.\.\., 3\), is \(3, 2\)"),
        (5.0, etalon.ConfigError, r"points_camera: must be \(\.\.\., 3\), is \(\)"),
        (numpy.zeros((3, 3), complex), TypeError, "points_camera: must be an array of real numbers, is complex128"),
        (["a", "b", "c"], TypeError, "points_camera: must be an array of real numbers, is <U1"),
        ([[1, 2, 3], [1]], TypeError, "points_camera"),
    ],
)
def test_wrong_arrays_are_refused_by_name(camera, points, error, text):
    with pytest.raises(error, match=text):
        camera.project(points)


def test_every_tool_gives_the_same_pixels_back(camera, tmp_path):
    truth = camera.project(POINTS)
    for tool in ("etalon", "opencv", "ros", "mrcal", "colmap", "matlab"):
        path = tmp_path / f"{tool}.txt"
        if tool == "matlab":
            path = path.with_suffix(".json")
        if tool == "colmap":
            path = tmp_path / "cameras.txt"
        camera.save(path, tool)
        again = etalon.Camera.load(path, image_size=(512, 384))
        assert numpy.abs(again.project(POINTS) - truth).max() < 1e-9, tool
    with pytest.raises(etalon.ConfigError, match='tool: there is no tool "kodak"'):
        camera.save(tmp_path / "x", "kodak")


def test_a_wrong_file_says_where(tmp_path):
    path = tmp_path / "camera.yml"
    path.write_text((DEMO / "camera.yml").read_text().replace("fx: 431.0", "fx: -431.0"))
    with pytest.raises(etalon.ConfigError) as caught:
        etalon.Camera.load(path)
    assert (caught.value.file, caught.value.line, caught.value.key) == (str(path), 6, "intrinsics.fx")
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, etalon.Error)


def test_a_camera_tells_what_its_file_says(camera):
    assert (camera.width, camera.height, camera.serial, camera.projection) == (512, 384, "TWIN", "perspective")
    assert camera.parameters["k3"] == 0.112 and camera.matrix[1, 2] == 194.2
    assert camera.lens["f_number"] == 1.4 and camera.sensor["gain_e_per_dn"] == 60
    assert camera.covariance is None and not camera.check()["has_fault"]
    with pytest.raises(etalon.NumericalError):
        etalon.Camera((640, 480), [[-1, 0, 0], [0, 1, 0], [0, 0, 1]])


def test_poses_are_rodrigues(tmp_path):
    from conftest import pose

    numbers = numpy.array([[0.3, -0.2, 0.1, 20, -10, 400], [0, 0, 0, 7, 5, 300], [1.1, 0.4, -2.0, 1, 2, 3]])
    truth = numpy.stack([pose(*one) for one in numbers])
    assert numpy.abs(etalon.rigid_from_vector(numbers) - truth).max() < 1e-12
    assert numpy.abs(etalon.vector_from_rigid(truth[2]) - numbers[2]).max() < 1e-12
    numpy.savetxt(tmp_path / "poses.csv", numbers, delimiter=",", header="rx,ry,rz,tx,ty,tz", comments="")
    assert numpy.abs(etalon.read_poses(tmp_path / "poses.csv") - truth).max() < 1e-12
    with pytest.raises(etalon.ConfigError, match="pose: must be finite"):
        etalon.rigid_from_vector([0, 0, 0, 0, 0, numpy.inf])
    sheared = truth[0].copy()
    sheared[0, 1] += 1e-3
    with pytest.raises(etalon.ConfigError, match="transform: must be a rigid transform"):
        etalon.vector_from_rigid(sheared)


def test_other_threads_run_meanwhile(camera):
    pixels = numpy.random.default_rng(1).uniform((0, 0), (511, 383), (300_000, 2))  # some 0.2 s
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    camera.unproject(pixels)
    during = counted[0] - before
    done.set()
    thread.join()
    assert during > 10_000  # with the GIL held, next to none
