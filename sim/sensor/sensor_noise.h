// Photon and read noise of a row of pixels, vectorised with Google Highway: the best instruction
// set of the machine is chosen at run time, and every set gives the same bits.
#pragma once

#include <cstdint>

namespace etalon {

// What the noise of an image is a pure function of, together with the pixel.
struct NoiseKey {
    std::uint64_t seed = 0;
    std::uint32_t frame = 0;
};

// Of a signal whose full scale is 1.
struct SensorNoise {
    double shot_variance;  // of the signal 1
    double read_variance;
};

// signal + sqrt(max(signal, 0) shot_variance + read_variance) * deviate for the `count` signals of
// the pixels from `first_pixel` on; what is not finite stays so. A pixel's deviate is the first
// normal() of RandomStream(seed, frame, pixel), bit for bit. About 4 ns a pixel with AVX-512, 6
// with AVX2, 11 with SSE4. Safe from every thread.
void add_noise(SensorNoise noise, const NoiseKey& key, std::uint64_t first_pixel, int count,
               double* signals);

}  // namespace etalon
