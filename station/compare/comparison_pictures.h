// The pictures of a comparison: photograph and rendering, their overlay, residual and significance
// maps.
#pragma once

#include <string>

#include "station/compare/comparison.h"

namespace etalon {

inline constexpr double overlay_gain = 2.0;              // of the red/cyan overlays
inline constexpr double residual_map_scale_gray = 30.0;  // full colour of the residual maps
inline constexpr double significance_map_scale = 6.0;    // standard deviations, full colour

// Writes the picture files of the photograph with this number (from 1) into `folder` and makes the
// elements for the report.
PhotoPictures make_pictures(const std::filesystem::path& folder, std::size_t number,
                            const std::filesystem::path& photo, const PhotoFit& calibrated,
                            const PhotoFit& refined);

// Of a photograph that was not compared: the whole of it, for the report only.
PhotoPictures pictures_of_photo(const CodeImage& image, const std::filesystem::path& photo);

}  // namespace etalon
