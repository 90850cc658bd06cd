"""What one call costs in Python: see python_overhead.sh."""

import sys
import time

import numpy

import etalon


def measure(name, times, work):
    best = min(timed(work) for _ in range(times))
    print(f"{name}\t{1e3 * best:.4f}")


def timed(work):
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


camera = etalon.Camera.load(sys.argv[1])
points = numpy.random.default_rng(7).uniform((-150, -100, 300), (150, 100, 800), (1_000_000, 3))
pixels = camera.project(points)
measure("project 1e6 points", 9, lambda: camera.project(points))
measure("unproject 1e6 pixels", 5, lambda: camera.unproject(pixels))
single = list(points[:1000])
measure("1000 calls of 1 point", 99, lambda: [camera.project(point) for point in single])
renderer = etalon.Renderer(camera)
scene = [(etalon.Marker("apriltag:36h11:5@80mm"), etalon.rigid_from_vector([0.3, -0.2, 0.1, 20, -10, 400]))]
measure("render a tag", 50, lambda: renderer.render(scene))
