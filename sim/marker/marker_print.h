// Print-ready files of a marker in its true size, with a scale bar to check the print with a ruler
// and the marker's name, both outside its quiet zone.
//
//   .svg   lengths in mm
//   .pdf   lengths in points of 1/72 inch, page size in the MediaBox, scaling by the viewer off
//   .png   8-bit gray with its resolution (pHYs); the page is the marker's own size, never A4
//
// Shades between black and white are sRGB-encoded, as these formats' readers assume.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sim/marker/marker.h"
#include "sim/marker/print_page.h"

namespace etalon {

std::string marker_svg(const Marker& marker, const PrintPage& page);

// Letters outside Latin-1 in the caption become question marks: the standard fonts lack them.
std::string marker_pdf(const Marker& marker, const PrintPage& page);

// Every edge lies on the nearest pixel border, within half a dot of its true place. The resolution
// is rounded to whole dots per metre, which is what pHYs can say, before anything is drawn.
// Throws ConfigError when a cell is smaller than 2 dots or the image larger than 400 megapixels.
std::vector<unsigned char> marker_png(const Marker& marker, const PrintPage& page,
                                      double dots_per_mm);

// Writes the file in one step, in the format of its extension, and says what is on it. Throws
// ConfigError for another extension and for a file that cannot be written; as above for the rest.
PrintPage print_marker(const Marker& marker, const std::filesystem::path& path, double dots_per_mm);

}  // namespace etalon
