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

#include "sim/marker/marker.h"

namespace etalon {

// Lengths in mm from the page's top-left corner, x right, y down. The grid includes the marker's
// white frame; scale bar and caption lie below it, outside every quiet zone.
struct PrintPage {
    double width_mm = 0, height_mm = 0;
    cv::Point2d grid_mm;      // top-left corner of the cell grid
    cv::Rect2d scale_bar_mm;  // exactly 50 or 100 mm wide
    cv::Point2d caption_mm;   // left end of the baseline
    double font_mm = 0;       // size of the caption's letters (em)
    std::string caption;      // the marker's spec and what the bar is
};

// A4 upright or lying when the marker fits, else (and always if `own_size`) a page as large as the
// marker with margin, scale bar and caption.
PrintPage lay_out_page(const Marker& marker, bool own_size);

// A region of cells by its outline: closed loops of corners in grid coordinates (columns, rows), to
// be filled by the even-odd rule. No hairlines can show between neighbouring cells.
using Outline = std::vector<std::vector<cv::Point>>;
Outline outline_of(const cv::Mat& mask);  // CV_8UC1, nonzero inside

// Both throw ConfigError for more than four million cells or two million corners (photographs; a
// PNG can hold them).
std::string marker_svg(const Marker& marker, const PrintPage& page);
// Letters outside Latin-1 in the caption become question marks: the standard fonts lack them.
std::string marker_pdf(const Marker& marker, const PrintPage& page);

// Edges lie on the nearest pixel border, at a resolution of whole dots per metre (pHYs). Throws
// ConfigError when a cell is smaller than 2 dots or the image larger than 400 megapixels.
std::vector<unsigned char> marker_png(const Marker& marker, const PrintPage& page,
                                      double dots_per_mm);

// Writes the file in one step, in the format of its extension, and says what is on it. Throws
// ConfigError for another extension and for a file that cannot be written; as above for the rest.
PrintPage print_marker(const Marker& marker, const std::filesystem::path& path, double dots_per_mm);

}  // namespace etalon
