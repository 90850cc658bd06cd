// Colour filters on a sensor's pixels.
#pragma once

namespace etalon {

// By the first two pixels of the first two rows.
enum class Mosaic { none, rggb, bggr, grbg, gbrg };

}  // namespace etalon
