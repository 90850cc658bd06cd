// The cells of square fiducial tags, from the tables of the libraries that detect them: AprilTag
// (libapriltag) and ArUco (OpenCV's predefined dictionaries).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace etalon {

// A square grid of cells seen from the front, upright as the library defines it, with a frame of
// at least one white cell all around.
struct TagPattern {
    cv::Mat cells;            // CV_32FC1, 0 black, 1 white
    int reference_start = 0;  // cells from the grid's edge to the square whose corners are reported
    int reference_cells = 0;  // side of that square
};

// Families by libapriltag's names without "tag": "36h11", "Standard41h12". In the classic ones the
// reference square is the black square and the data lie inside. In the Standard, Circle and Custom
// families it is the edge between an inner white and an outer black ring, and part of the data lie
// OUTSIDE it. Cells that a family leaves open (a Circle's corners) are white.
const std::vector<std::string>& apriltag_families();

// Dictionaries by OpenCV's names without "DICT_": "4X4_50", "APRILTAG_36h11". One cell of black
// border. The position in the list is OpenCV's number of the dictionary.
const std::vector<std::string>& aruco_dictionaries();

// The number of ids; they run from 0. `family` must be one of the lists above (ConfigError
// otherwise: the callers check first, to name the place).
int apriltag_count(const std::string& family);
int aruco_count(const std::string& dictionary);

// The id must be one of those.
TagPattern apriltag_pattern(const std::string& family, int id);
TagPattern aruco_pattern(const std::string& dictionary, int id);

}  // namespace etalon
