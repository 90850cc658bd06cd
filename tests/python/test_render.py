import gc
import resource

import numpy
import pytest
from conftest import exposed, pose

import etalon


def overlap(edges, pixels):
    """(pixels, cells): how much of each pixel [i - 0.5, i + 0.5] lies in each cell."""
    low, high = numpy.arange(pixels)[:, None] - 0.5, numpy.arange(pixels)[:, None] + 0.5
    return numpy.clip(numpy.minimum(high, edges[1:]) - numpy.maximum(low, edges[:-1]), 0, None)


def test_a_frontal_marker_is_the_overlap_of_cells_and_pixels(sharp, tag):
    tx, ty, z = 13.0, -7.5, 311.0
    columns, rows = tag.cells.shape[1], tag.cells.shape[0]
    x = (tag.corner_mm[0] + tag.cell_mm[0] * numpy.arange(columns + 1) + tx) / z * 400 + 155.5
    y = (tag.corner_mm[1] + tag.cell_mm[1] * numpy.arange(rows + 1) + ty) / z * 390 + 121.25
    in_x, in_y = overlap(x, 320), overlap(y, 240)
    truth = in_y @ tag.cells @ in_x.T + 0.6 * (1 - in_y.sum(1)[:, None] * in_x.sum(1))
    image = etalon.Renderer(sharp).render([(tag, pose(0, 0, 0, tx, ty, z))], background=0.6)
    assert image.radiance.dtype == numpy.float32 and image.radiance.shape == (240, 320)
    assert numpy.abs(image.radiance - truth).max() < 0.1 / 255
    assert (image.valid == 255).all() and "exact areas" in image.plan


def test_the_sensor_follows_its_formula(camera):
    radiance = numpy.linspace(-0.1, 1.1, 512 * 384, dtype=numpy.float32).reshape(384, 512)
    sensor = etalon.SensorModel(camera)
    truth = numpy.clip(numpy.floor(8 + 247 * radiance.astype(float) + 0.5), 0, 255)
    codes = sensor.expose(radiance)
    assert codes.dtype == numpy.uint8
    assert numpy.abs(codes.astype(int) - truth).max() <= 1 and (codes == truth).mean() > 0.999
    assert numpy.abs(sensor.linear_radiance(codes) - (codes.astype(float) - 8) / 247).max() < 1e-6


def test_noise_has_the_variance_of_the_sensor_and_follows_its_seed(camera):
    gray = numpy.full((384, 512), 0.5, numpy.float32)
    sensor = etalon.SensorModel(camera)
    codes = sensor.expose(gray, seed=7, frame=3)
    signal = 0.5 * 247
    variance = signal / 60 + (10 / 60) ** 2 + 1 / 12
    # The variance of n normal deviates has the standard deviation variance * sqrt(2 / n).
    assert abs(codes.var() / variance - 1) < 5 * numpy.sqrt(2 / codes.size)
    assert abs(codes.mean() - 8 - signal) < 5 * numpy.sqrt(variance / codes.size)
    assert numpy.array_equal(codes, sensor.expose(gray, seed=7, frame=3))
    assert not numpy.array_equal(codes, sensor.expose(gray, seed=7, frame=4))


def test_images_are_shared_with_numpy(sharp, tag):
    image = etalon.Renderer(sharp).render([(tag, pose(0.2, 0, 0, 0, 0, 300))])
    first, second = image.radiance, image.radiance
    assert numpy.shares_memory(first, second)
    first[7, 5] = 0.25
    assert second[7, 5] == 0.25
    assert not image.valid.flags.writeable and numpy.shares_memory(image.valid, image.valid)
    assert not tag.cells.flags.writeable
    kept = image.radiance[100:110]
    expected = kept.copy()
    del image, first, second
    gc.collect()
    assert numpy.array_equal(kept, expected)  # the memory lives as long as the last array


def kib(key):
    with open("/proc/self/status", encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(key))


def test_an_image_that_goes_in_is_not_copied():
    width, height = 6000, 4000
    camera = etalon.Camera((width, height), [[6000, 0, 3000], [0, 6000, 2000], [0, 0, 1]])
    sensor = etalon.SensorModel(camera)
    radiance = numpy.full((height, width), 0.5, numpy.float32)  # 94 MiB
    sensor.expose(radiance[:10].repeat(400, axis=0))  # whatever is made once
    before = kib("VmRSS")
    with open("/proc/self/clear_refs", "w", encoding="ascii") as peak:
        peak.write("5")
    codes = sensor.expose(radiance)  # 23 MiB come out
    grown = kib("VmHWM") - before
    # What comes out shows in the peak, or it would show nothing.
    assert 0.5 * codes.nbytes < 1024 * grown < codes.nbytes + 0.3 * radiance.nbytes


def test_memory_does_not_grow(sharp, tag):
    renderer, sensor = etalon.Renderer(sharp), etalon.SensorModel(sharp)

    def work():
        image = renderer.render([(tag, pose(0.1, 0.2, 0, 0, 0, 300))])
        etalon.detect(sensor.expose(image.radiance), tag, sharp)
        sharp.project(numpy.zeros((1000, 3)))

    for _ in range(10):
        work()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(60):
        work()
    # Sixty images of radiance alone would be 18 MiB.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 8 * 1024


def test_rows_of_a_larger_image_are_taken_as_they_are(sharp):
    sensor = etalon.SensorModel(sharp)
    large = numpy.random.default_rng(1).random((300, 400), numpy.float32)
    part = large[20:260, 40:360]
    assert numpy.array_equal(sensor.expose(part), sensor.expose(part.copy()))
    with pytest.raises(etalon.ConfigError, match="radiance: pixels of a row must lie side by side"):
        sensor.expose(large[20:260, 40:360][:, ::-1])
    with pytest.raises(etalon.ConfigError, match="radiance: pixels of a row"):
        sensor.expose(numpy.asfortranarray(part))


def test_wrong_images_are_refused_by_name(camera, sharp, tag):
    sensor = etalon.SensorModel(sharp)
    with pytest.raises(TypeError, match="radiance: must be float32, is float64"):
        sensor.expose(numpy.zeros((240, 320)))
    with pytest.raises(etalon.NumericalError):
        sensor.expose(numpy.zeros((320, 240), numpy.float32))
    with pytest.raises(etalon.NumericalError):
        sensor.expose(numpy.full((240, 320), numpy.nan, numpy.float32))
    photo = exposed(sharp, [(tag, pose(0.1, 0, 0, 0, 0, 300))])
    with pytest.raises(TypeError, match="photo: must be uint8 or uint16, is float32"):
        etalon.detect(photo.astype(numpy.float32), tag)
    with pytest.raises(ValueError, match=r"photo: must be \(height, width\), one channel, is \(240, 320, 3\)"):
        etalon.detect(numpy.zeros((240, 320, 3), numpy.uint8), tag)
    with pytest.raises(etalon.ConfigError, match="photo: is 320 x 240 px, but"):
        etalon.detect(photo, tag, camera)


def test_wrong_scenes_are_refused(sharp, tag):
    renderer = etalon.Renderer(sharp)
    with pytest.raises(etalon.ConfigError, match="camera_from_marker: must be"):
        renderer.render([(tag, numpy.zeros((4, 4)))])
    with pytest.raises(TypeError, match="markers"):
        renderer.render([tag])
    with pytest.raises(etalon.NumericalError):
        renderer.render([(tag, pose(0, 1.5, 0, 0, 0, 20))])  # through the lens
    with pytest.raises(etalon.ConfigError, match='spec: .*"?apriltag'):
        etalon.Marker("apriltag:36h11:9999@80mm")


def test_images_come_back_from_files(tmp_path, tag, sharp):
    codes = numpy.arange(12, dtype=numpy.uint16).reshape(3, 4) * 5000
    etalon.write_image(tmp_path / "codes.png", codes)
    assert numpy.array_equal(etalon.read_image(tmp_path / "codes.png"), codes)
    with pytest.raises(etalon.ConfigError, match="nowhere.png"):
        etalon.read_image(tmp_path / "nowhere.png")
    etalon.write_radiance(tmp_path / "one.tiff", numpy.ones((3, 4), numpy.float32))
    assert (tmp_path / "one.tiff").stat().st_size >= 48
