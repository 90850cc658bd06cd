// Photographs from the sensor model for the tests of what characterises a sensor: a camera with
// noise, and radiance pictures with many levels.
#pragma once

#include "compare/characterise/transfer_estimate.h"
#include "sim/sensor/sensor_model.h"
#include "tests/calib/cameras.h"
#include "tests/image_of.h"

namespace etalon::test {

// 8 bit, a black level between two codes, 12 e/DN, 14 e of read noise (1.2 DN).
inline CameraModel noisy_camera() {
    return camera_with(
        320, 240, {400.0, 403.0, 165.0, 112.0}, {},
        Sensor{
            .pixel_pitch_um = 6.0, .black_dn = 9.3, .gain_e_per_dn = 12.0, .read_noise_e = 14.0});
}

// Light and dark squares of 40 px under light that rises to the right: an eighth to all of `top`.
inline Radiance squares(const CameraModel& camera, double top) {
    return image_of({camera.width, camera.height}, [&](int x, int y) {
        return top * ((x / 40 + y / 40) % 2 == 0 ? 0.25 : 1.0) * (0.5 + 0.5 * x / camera.width);
    });
}

inline Radiance even(const CameraModel& camera, double level) {
    return Radiance(camera.height, camera.width, CV_32FC1, cv::Scalar(level));
}

inline std::vector<CodeImage> exposed(const CameraModel& camera, const Radiance& radiance,
                                      int count, std::uint64_t seed, std::uint32_t first = 0) {
    const SensorModel sensor(camera);
    std::vector<CodeImage> images;
    for (int i = 0; i < count; ++i)
        images.push_back(
            sensor.expose(radiance, NoiseKey{seed, first + static_cast<std::uint32_t>(i)}));
    return images;
}

// Of a scene of which 1 ms makes full scale 1, one photograph a time.
inline std::vector<ExposedPhoto> exposure_series(const CameraModel& camera, const Radiance& scene,
                                                 const std::vector<double>& times_us,
                                                 std::uint64_t seed = 5) {
    std::vector<ExposedPhoto> photos;
    for (const double time : times_us) {
        const auto frame = static_cast<std::uint32_t>(photos.size());
        photos.push_back(
            {exposed(camera, scene * (time / 1000.0), 1, seed, frame).front(), time, "photo"});
    }
    return photos;
}

}  // namespace etalon::test
