"""Whatever an argument cannot be is refused by its name, and the interpreter goes on."""

import copy
import pickle
import signal
import threading
import time

import numpy
import pytest
from conftest import DEMO, exposed, pose
from signatures import CORNERS, PHOTO, RADIANCE, check, functions, unaligned

import etalon

FUNCTIONS = functions()
POSE = pose(0.35, -0.2, 0.1, 20, -10, 420)
POINTS = numpy.array([[7, 5, 400], [-20, 3, 500], [1, 2, 300]], float)


@pytest.fixture(scope="module")
def owners(camera, tag, tmp_path_factory):
    """An object of each class that has functions; a stage is in test_station.py."""
    folder = tmp_path_factory.mktemp("frames")
    etalon.write_image(folder / "one.png", PHOTO)
    return {
        "": etalon,
        "Camera": camera,
        "Renderer": etalon.Renderer(camera),
        "SensorModel": etalon.SensorModel(camera),
        "Detector": etalon.Detector(tag),
        "PhotometricDetector": etalon.PhotometricDetector(camera, tag),
        "CameraDevice": etalon.open_camera(f"files:{folder}"),
        "Station": etalon.Station(DEMO / "station.yaml"),
    }


def right_arguments(function, camera, tag):
    matrix = [[600, 0, 250], [0, 600, 190], [0, 0, 1]]
    path = "nowhere/at/all"
    every = dict(
        pose=numpy.ones(6), transform=POSE, path=path, image=PHOTO, radiance=RADIANCE, image_size=(512, 384),
        matrix=matrix, distortion=numpy.zeros(5), tool="etalon", points_camera=POINTS, pixels=CORNERS, jacobians=True,
        spec="apriltag:36h11:5@80mm", camera=camera, markers=[(tag, POSE)], background=1.0, tolerance_gray=0.1,
        method="automatic", seed=1, frame=1, marker=tag, name="auto", photo=PHOTO, detector="auto",
        points_mm=tag.points_mm, start=POSE, start_error_px=1.0, photos=[PHOTO], target=tag, model="standard",
        leave_one_out=False, resamples=0, fit_board=False, views=[], camera_from_marker=POSE, exposure_us=1,
        gain_db=0.0, width=1, height=1, bits=8, format="", black_level=0.0, trigger="", controls={}, retries=0,
        uri="files:nowhere", frame_timeout_s=1.0, packet_size=1400, positions=numpy.zeros(4), homed=False, out=path,
        progress=False, record=path, study=path, ablate=[], folder=path, text=[], file=None, station=None,
    )  # fmt: skip
    if function == ("Station", "register_photos"):
        every["positions"] = path
    return {name: every[name] for name in FUNCTIONS[function]}


def called(function, owners):
    owner, name = function
    if name == "twin":
        return lambda **given: etalon.twin(**given).__enter__()
    return getattr(etalon, owner) if name == "__init__" else getattr(owners[owner], name)


@pytest.mark.parametrize(
    "function", [one for one in FUNCTIONS if one[0] != "Stage"], ids=lambda one: ".".join(filter(None, one))
)
def test_wrong_arguments_are_refused_by_their_names(function, owners, camera, tag):
    if function[1] == "twin" and not hasattr(etalon._etalon, "_Twin"):
        pytest.skip("this build has no twin: Aravis is missing")
    check(called(function, owners), right_arguments(function, camera, tag), FUNCTIONS[function], camera, tag)


def test_the_list_is_that_of_the_interface():
    assert len(FUNCTIONS) > 40 and {"Camera", "Stage", "CameraDevice", ""} <= {owner for owner, _ in FUNCTIONS}


def laid_out_anew(array):
    yield from (array.tolist(), numpy.asfortranarray(array), array.astype(">f8"), unaligned(array))
    yield array[::-1].copy()[::-1]
    yield numpy.repeat(array, 2, axis=-1)[..., ::2]
    read_only = array.copy()
    read_only.flags.writeable = False
    yield read_only


def test_order_stride_and_byte_order_change_nothing(owners, camera, tag):
    station = owners["Station"]
    seen = camera.project(tag.points_mm @ POSE[:3, :3].T + POSE[:3, 3])
    for function, array in (
        (camera.project, POINTS),
        (camera.unproject, CORNERS),
        (etalon.rigid_from_vector, numpy.full((2, 6), 0.25)),
        (etalon.vector_from_rigid, POSE),
        (station.base_from_carriage, numpy.array([7, 5, -3, 0.25])),
        (lambda pixels: etalon.estimate_pose(camera, tag.points_mm, pixels).camera_from_marker, seen),
    ):
        expected = function(array)
        for other in laid_out_anew(array):
            assert numpy.array_equal(function(other), expected)
    whole = numpy.abs(numpy.rint(POINTS))
    for kind in ("i2", "i8", "u8", "f2", "f4"):
        assert numpy.array_equal(camera.project(whole.astype(kind)), camera.project(whole))


def test_what_is_refused_is_told_in_our_words(camera, tag):
    with pytest.raises(TypeError, match="^marker: must be Marker, is 'tag'$"):
        etalon.detect(PHOTO, "tag")
    with pytest.raises(TypeError, match=r"^frame: must be int from 0 to 4294967295, is -1$"):
        etalon.SensorModel(camera).expose(RADIANCE, frame=-1)
    with pytest.raises(TypeError, match="^camera: must be Camera or None, is Marker$"):
        etalon.detect(PHOTO, tag, tag)
    with pytest.raises(TypeError, match=r"^points_camera: must be an array of numbers that float64 holds, is float[0-9]+$"):
        camera.project(numpy.ones((2, 3), numpy.longdouble))
    with pytest.raises(TypeError, match=r"^markers: \[1\] must be \(Marker, camera_from_marker\), is \(ndarray, Marker\)$"):
        etalon.Renderer(camera).render([(tag, POSE), (POSE, tag)])


# ---- copies


def test_cameras_and_markers_are_copied_and_pickled(camera, tag, tmp_path):
    rich = (DEMO / "camera.yml").read_text().replace("transfer: linear", "transfer: {table: {file: t.csv}}")
    (tmp_path / "t.csv").write_text("radiance,code\n0,8\n0.3,90\n1,255\n")
    (tmp_path / "camera.yml").write_text(rich)
    for one in (camera, etalon.Camera.load(tmp_path / "camera.yml")):
        (tmp_path / "a").mkdir(exist_ok=True)
        (tmp_path / "b").mkdir(exist_ok=True)
        one.save(tmp_path / "a" / "camera.yml")
        for again in (copy.copy(one), copy.deepcopy(one), *(pickle.loads(pickle.dumps(one, p)) for p in range(6))):
            again.save(tmp_path / "b" / "camera.yml")
            for file in (tmp_path / "a").iterdir():
                assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
            assert numpy.array_equal(again.project(POINTS), one.project(POINTS))
    for again in (copy.copy(tag), copy.deepcopy(tag), pickle.loads(pickle.dumps(tag))):
        assert again.spec == tag.spec and numpy.array_equal(again.cells, tag.cells)


def test_everything_else_says_that_it_cannot_be_copied(owners, camera, tag):
    photo = exposed(camera, [(tag, POSE)])
    found = etalon.detect(photo, tag, camera)
    others = [one for name, one in owners.items() if name not in ("", "Camera")]
    for one in (*others, found, found.pose, etalon.CalibrationView(tag.points_mm, CORNERS)):
        for copied in (copy.copy, copy.deepcopy, *(lambda x, p=p: pickle.dumps(x, p) for p in range(6))):
            with pytest.raises(TypeError, match=f"^{type(one).__name__}: cannot be copied or pickled$"):
                copied(one)


# ---- Ctrl-C


def seconds_to_end(work):
    """How long after Ctrl-C the KeyboardInterrupt is there, the signal given once the work has begun."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    sent = []

    def interrupt():
        sent.append(time.monotonic())
        signal.raise_signal(signal.SIGINT)

    timer = threading.Timer(0.3, interrupt)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            work()
            pytest.fail("it ended before the Ctrl-C: the work is too small for this machine")
        return time.monotonic() - sent[0]
    finally:
        timer.cancel()
        timer.join()
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_reference_render_at_once(tag):
    large = etalon.Camera((1600, 1200), [[1360, 0, 799.5], [0, 1360, 599.5], [0, 0, 1]])
    renderer = etalon.Renderer(large)
    scene = [(tag, pose(0.2, 0.1, 0, 0, 0, 150))]
    assert seconds_to_end(lambda: renderer.render(scene, method="reference", tolerance_gray=1e-4)) < 0.5
    image, fresh = renderer.render(scene), etalon.Renderer(large).render(scene)  # nothing is left behind
    assert numpy.array_equal(image.radiance, fresh.radiance)


def test_ctrl_c_ends_a_calibration_at_once(camera):
    board = etalon.Marker("chessboard:9x6@25mm")
    random = numpy.random.default_rng(4)
    views = []
    for _ in range(16):
        placed = pose(*random.uniform(-0.5, 0.5, 3), *random.uniform((-120, -90, 380), (-80, -60, 500)))
        pixels = camera.project(board.points_mm @ placed[:3, :3].T + placed[:3, 3])
        views.append(etalon.CalibrationView(board.points_mm, pixels + random.normal(0, 0.1, pixels.shape)))
    assert seconds_to_end(lambda: etalon.calibrate_camera(views, (512, 384), resamples=1_000_000)) < 0.5
