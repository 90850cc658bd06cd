"""Shared by the tests of the Python module. Truth comes from formulas in numpy, or from OpenCV where it is
installed; never from the library itself.
"""

from pathlib import Path

import numpy
import pytest

import etalon

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "examples" / "demo"


@pytest.fixture(scope="session")
def camera():
    """The demo's: 512 x 384 px, k1 k2 k3, a lens, a sensor with noise."""
    return etalon.Camera.load(DEMO / "camera.yml")


@pytest.fixture(scope="session")
def sharp():
    """A sharp pinhole of 320 x 240 px without distortion, lens and sensor."""
    return etalon.Camera((320, 240), [[400, 0, 155.5], [0, 390, 121.25], [0, 0, 1]])


@pytest.fixture(scope="session")
def tag():
    return etalon.Marker("apriltag:36h11:5@80mm")


def pose(*numbers):
    """rx, ry, rz (rad), tx, ty, tz (mm) by Rodrigues' formula."""
    r, t = numpy.array(numbers[:3], float), numbers[3:]
    angle = numpy.linalg.norm(r)
    x, y, z = r / angle if angle else (0, 0, 1)
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    transform = numpy.eye(4)
    transform[:3, :3] += numpy.sin(angle) * cross + (1 - numpy.cos(angle)) * cross @ cross
    transform[:3, 3] = t
    return transform


def moved(transform, points):
    return points @ transform[:3, :3].T + transform[:3, 3]


def brown(parameters, points):
    """Pixels of camera-frame points by the radial and tangential formula, written out."""
    p = parameters
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    s = x * x + y * y
    radial = 1 + s * (p["k1"] + s * (p["k2"] + s * p["k3"]))
    u = x * radial + 2 * p["p1"] * x * y + p["p2"] * (s + 2 * x * x)
    v = y * radial + p["p1"] * (s + 2 * y * y) + 2 * p["p2"] * x * y
    return numpy.stack([p["fx"] * u + p["cx"], p["fy"] * v + p["cy"]], axis=-1)


def exposed(camera, markers, *, exposure=0.8, background=0.6, seed=7):
    radiance = etalon.Renderer(camera).render(markers, background=background).radiance
    return etalon.SensorModel(camera).expose(numpy.float32(exposure) * radiance, seed=seed)
