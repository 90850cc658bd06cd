// A map of a positive quantity over a camera's image for reports: coloured cells, a scale beside
// them, and the value under the pointer. Colours are those of "viridis" (Smith and van der Walt),
// which rise evenly in lightness and are told apart by colour-blind readers.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

namespace etalon {

struct HeatMap {
    // Centres of the cells in image coordinates, their size, and the image they lie in, all in px.
    std::vector<Eigen::Vector2d> centres;
    std::vector<double> values;
    double cell_width = 0.0, cell_height = 0.0;
    int image_width = 0, image_height = 0;
    double highest = 0.0;  // of the scale, which begins at 0
    std::string unit;
    std::string axis_unit = "px";  // of what the cells lie in, where that is no image
};

// The <svg> element. Cells are cut off at the image's border; places without a cell stay empty.
std::string heat_map_svg(const HeatMap& map);

}  // namespace etalon
