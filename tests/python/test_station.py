"""Everything that needs devices: the twin speaks their protocols on 127.0.0.1."""

import _thread
import signal
import threading
import time

import numpy
import pytest
from conftest import pose
from quick_station import write_quick_station
from signatures import check, functions

import etalon

# What twin.yaml says is true, in rad.
CAMERA_FROM_BASE = pose(*numpy.radians([1.1, -1.7, 0.6]), 4, -3, 480)
CARRIAGE_FROM_MARKER = pose(*numpy.radians([22.5, -0.4, 0.7]), 5.3, -7.2, 20.5)

pytestmark = pytest.mark.skipif(not hasattr(etalon._etalon, "_Twin"), reason="this build has no twin: Aravis is missing")


@pytest.fixture(scope="module", autouse=True)
def ctrl_c():
    """As in a terminal: a program in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    with etalon.twin(*write_quick_station(tmp_path_factory.mktemp("station"))) as station:
        yield station


@pytest.fixture(scope="module")
def record(station, tmp_path_factory):
    """A run that Ctrl-C ended after some poses, and that went on: (folder, then, now)."""
    folder = tmp_path_factory.mktemp("records") / "run"

    def interrupt_after_five_poses():
        log = folder / "events.jsonl"
        while not log.exists() or log.read_text().count('"event":"pose"') < 5:
            time.sleep(0.01)
        _thread.interrupt_main()

    thread = threading.Thread(target=interrupt_after_five_poses)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        station.qualify(folder)
    thread.join()
    then = etalon.read_record(folder)
    return folder, then, etalon.resume_record(folder)


def test_the_plan_is_within_the_limits(station):
    plan = station.plan()
    low, high = (numpy.array([axis[key] for axis in station.axes]) for key in ("low", "high"))
    assert plan["targets"].shape == (26, 4) and plan["hold_out"].dtype == bool
    assert ((plan["targets"] >= low) & (plan["targets"] <= high)).all()
    assert [axis["unit"] for axis in station.axes] == ["mm", "mm", "mm", "rad"]
    turned = station.base_from_carriage([7, 5, -3, 0.25])
    assert numpy.abs(turned - pose(0, 0, 0.25, 7, 5, -3)).max() < 1e-12


def test_a_photograph_shows_where_the_stage_is(station):
    target = numpy.array([20.0, -15.0, 10.0, 0.3])
    with station.open_stage() as stage, station.open_camera() as camera:
        with pytest.raises(etalon.DeviceError):
            stage.move(target)  # before it is enabled and homed
        stage.enable()
        stage.home()
        stage.move(target)
        assert numpy.abs(stage.position() - target).max() < 1e-3
        frame = camera.frame()
        assert frame.status == "complete" and frame.bits == 8 and frame.settings["exposure_us"] == 4000
        assert numpy.shares_memory(frame.image, frame.image)
        assert camera.identity["serial"] == "TWIN" and camera.statistics["delivered"] == 1
    found = etalon.detect(frame.image, station.marker, station.camera)
    truth = CAMERA_FROM_BASE @ station.base_from_carriage(target) @ CARRIAGE_FROM_MARKER
    assert numpy.abs(found.pose.camera_from_marker - truth)[:3, 3].max() < 1.0
    with pytest.raises(etalon.Error, match="this device is closed"):
        stage.position()


def test_the_rules_of_the_station_hold(station):
    with station.open_stage() as stage:
        stage.enable()
        stage.home()
        before = stage.position()
        with pytest.raises(etalon.ConfigError, match="x"):
            stage.move([126, 0, 0, 0])
        with pytest.raises(etalon.ConfigError):
            stage.move([numpy.nan, 0, 0, 0])
        with pytest.raises(etalon.ConfigError, match=r"target: must be \(N,\)"):
            stage.move([[0, 0, 0, 0]])
        assert numpy.array_equal(stage.position(), before)
        assert not any(axis["moving"] or axis["alarm"] for axis in stage.status())
        with pytest.raises(etalon.DeviceError):
            etalon.open_camera("genicam:127.0.0.9", frame_timeout_s=0.2)
        with pytest.raises(etalon.ConfigError):
            etalon.open_camera("polaroid:1")
    with station.open_camera() as camera, pytest.raises(etalon.ConfigError, match="retries"):
        camera.frame(retries=-3)


def test_wrong_arguments_of_a_stage_are_refused_by_their_names(station, camera, tag):
    with station.open_stage() as stage:
        for (owner, name), arguments in functions().items():
            if owner == "Stage":
                right = {"target": numpy.zeros(4), "share": 1.0}
                check(getattr(stage, name), {one: right[one] for one in arguments}, arguments, camera, tag)


@pytest.mark.parametrize("how", ["ctrl-c", "stop"])
def test_a_motion_is_stopped(station, how):
    with station.open_stage() as stage:
        stage.enable()
        stage.home()
        stage.move([-100, 0, 0, 0])
        stage.limit_speed(0.005)  # 10 s for the way
        end = _thread.interrupt_main if how == "ctrl-c" else stage.stop
        timer = threading.Timer(0.3, end)
        timer.start()
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt if how == "ctrl-c" else etalon.Interrupted):
            stage.move([100, 0, 0, 0])
        assert time.monotonic() - began < 5
        timer.join()
        status = stage.status()[0]
        assert not status["moving"] and -100 <= status["position"] < 90


def test_python_works_on_while_the_stage_moves(station):
    with station.open_stage() as stage:
        stage.enable()
        stage.home()
        stage.limit_speed(0.05)
        counted, moving = [0], threading.Event()

        def count():
            while not moving.is_set():
                counted[0] += 1

        thread = threading.Thread(target=count)
        thread.start()
        stage.move([-50, 0, 0, 0])
        moving.set()
        thread.join()
    assert counted[0] > 1000  # it would be a handful with the GIL held


def test_a_run_that_is_interrupted_goes_on(record):
    _, then, now = record
    assert then["outcome"] == "ABORTED" and 5 <= len(then["poses"]["pose"]) < 26
    assert now["outcome"] in ("PASS", "INCONCLUSIVE") and len(now["sessions"]) == 2
    assert now["station"] == "demo" and len(now["poses"]["pose"]) == 26
    kept = len(then["poses"]["pose"])
    assert numpy.array_equal(now["poses"]["done_s"][:kept], then["poses"]["done_s"])


def test_a_run_finds_where_the_stage_stands(record):
    folder, _, run = record
    poses = run["poses"]
    assert set(poses["split"]) == {"training", "hold-out"} and (folder / "report.html").exists()
    training = poses["split"] == "training"
    assert numpy.isnan(poses["b3_x_mm"][training]).all() and numpy.abs(poses["b3_x_mm"][~training]).max() < 1.0
    found = etalon.register_record(folder)
    assert found.used == 26 and found.covariance.shape == (12, 12) and found.deviations.shape == (12,)
    assert len(found.photos) == 26 and found.photos[3]["difference_mm"].shape == (3,)
    # A stage that turns about z alone cannot tell a shift along z; X Y does not depend on it.
    assert found.freedoms == ["shift along base z between X and Y"]
    product = found.camera_from_base @ found.carriage_from_marker
    assert numpy.abs(product - CAMERA_FROM_BASE @ CARRIAGE_FROM_MARKER)[:3, 3].max() < 1.0
    assert numpy.abs(found.camera_from_base - CAMERA_FROM_BASE)[:3, :3].max() < 0.01


def test_a_record_analysed_again_says_the_same(record):
    folder, _, run = record
    before = (folder / "run.json").read_bytes()
    again = etalon.analyse_record(folder)
    assert (folder / "run.json").read_bytes() == before
    numpy.testing.assert_array_equal(again["poses"]["b3_z_mm"], run["poses"]["b3_z_mm"])
    with pytest.raises(etalon.ConfigError):
        etalon.resume_record(folder)  # it came to its end


def test_a_wrong_station_says_where(tmp_path):
    _, path = write_quick_station(tmp_path)
    path.write_text(path.read_text().replace("hold_out: 0.6", "hold_out: 1.6"))
    with pytest.raises(etalon.ConfigError) as caught:
        etalon.Station(path)
    assert caught.value.key == "plan.hold_out" and caught.value.line > 0
    with pytest.raises(etalon.ConfigError):
        with etalon.twin(tmp_path / "nowhere.yaml"):
            pass
