// The pictures of a comparison: photograph and rendering, their overlay, residual and significance
// maps; and the viewer of the report in which photograph and rendering take turns in one place.
#pragma once

#include <string>
#include <vector>

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

// One place for several pictures of the same size: side by side, in turn, or one of them, by radio
// buttons; pressing holds the first one. Nothing moves for readers who want less motion, and no
// script is needed. `id` is unique in the page.
struct NamedPicture {
    std::string name, html;  // "photograph"; an <img> element
};
std::string viewer_html(const std::string& id, const std::vector<NamedPicture>& pictures,
                        bool starts_in_turn);

// The colours of residual and significance maps with their ends, "-30" and "+30 gray".
std::string colour_scale_html(double end, const std::string& unit);

}  // namespace etalon
