"""A station to test against: the twin, which speaks the real protocols on 127.0.0.1."""

import contextlib
from pathlib import Path

from etalon import _etalon
from etalon.errors import Error
from etalon.records import path_of

demo: Path = Path(__file__).parent / "demo"  # camera.yml, station.yaml, twin.yaml and limits.yaml


@contextlib.contextmanager
def twin(file=None, station=None, *, seed=None):
    """Starts a simulated stage and GigE Vision camera, gives the Station that drives them, ends them.

    file: twin.yaml, what is true (default: the demo's); station: station.yaml, what the station is told (the
    demo's); seed: of all noise, in place of the file's. One at a time on a machine: the port of GigE Vision
    is fixed. Raises ConfigError for the files, DeviceError when a port is taken, Error where the build has no
    twin (it needs Aravis).
    """
    if not hasattr(_etalon, "_Twin"):
        raise Error("this build has no twin: Aravis was missing when it was made")
    file = demo / "twin.yaml" if file is None else path_of(file, "file")
    told = _etalon.Station(demo / "station.yaml" if station is None else path_of(station, "station"))
    running = _etalon._Twin(file, seed)
    try:
        yield told
    finally:
        del running
