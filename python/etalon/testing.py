"""A station to test against: the twin, which speaks the real protocols on 127.0.0.1."""

import contextlib
from pathlib import Path

from etalon import _etalon
from etalon.errors import Error

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
    told = _etalon.Station(station or demo / "station.yaml")
    running = _etalon._Twin(file or demo / "twin.yaml", seed)
    try:
        yield told
    finally:
        del running
