"""Etalon: does a calibrated camera measure what its calibration promises?

Lengths in mm, angles in rad, pixel (0, 0) is the centre of the top-left pixel; a transform says both of its
frames: camera_from_marker is a (4, 4) matrix that takes points of the marker's frame to the camera's.
"""

from etalon import copies  # noqa: F401
from etalon._etalon import *  # noqa: F401,F403
from etalon._etalon import __version__  # noqa: F401
from etalon.errors import (  # noqa: F401
    ConfigError,
    DeviceError,
    Error,
    Interrupted,
    NumericalError,
)
from etalon.records import read_record, read_results, read_table  # noqa: F401
from etalon.testing import twin  # noqa: F401
