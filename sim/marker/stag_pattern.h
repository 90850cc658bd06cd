// STag's look: a black square with a white disk and in it 48 small discs, black or white: the
// codeword. Neighbouring black discs are joined and rounded off (docs/stag.md). B. Benligiray, C.
// Topal, C. Akinlar, "STag: A stable fiducial marker system", Image and Vision Computing 89, 2019,
// and the authors' generator. Lengths in units of the black square's side.
#pragma once

#include <opencv2/core.hpp>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace etalon {

// Codewords: the published families HD17, HD19, HD21 and HD23 (smallest Hamming distance in the
// same orientation; over all turns 10, 10, 14 and 14), and our R16: 128 words that differ in 16
// discs or more from each other in all orientations and from themselves turned.

inline constexpr int stag_bits = 48;
inline constexpr int stag_bits_a_quarter = stag_bits / 4;

// Bit i is 1 when the disc at stag_code_points()[i] is black.
using StagCode = std::uint64_t;

// The built-in families, "HD17" to "R16".
const std::vector<std::string>& stag_families();

// Whether a family's name is that of a file: it holds a '.' or a '/'.
bool is_stag_file(const std::string& family);

// The words of a built-in family or of a table file (docs/files.md, "Markers"), by id. Throws
// ConfigError for an unknown family or file. Every thread; R16 takes some ms the first time.
std::vector<StagCode> stag_codes(const std::string& family);

// The word that is read from a marker turned counter-clockwise by so many quarters (any number).
StagCode turned_stag_code(StagCode code, int quarters);

// In how many discs they differ, both upright.
int hamming_distance(StagCode a, StagCode b);

// The smallest Hamming distance of word `id` to any other word in any orientation and to itself
// turned; 0 when it cannot be told from one of them.
int stag_separation(const std::vector<StagCode>& codes, int id);

inline constexpr double stag_border = 0.125, stag_circle_radius = 0.4;

// The code discs' centres in a marker of side 1: origin at its centre, x right, y down. 12 a
// quadrant, from the upper right counter-clockwise: point i + 12 is point i turned by a quarter.
const std::array<Eigen::Vector2d, stag_bits>& stag_code_points();

inline constexpr double stag_detail = 0.02;    // what a print must show of rounded outlines
inline constexpr int stag_cells_a_side = 320;  // of the black square

// With its white border, CV_32FC1, 0 black, 1 white, from the top left. A disc is the cells whose
// centres are inside it: symmetric for the large disk, whose area is right to 2e-4.
cv::Mat stag_cells(StagCode code);

}  // namespace etalon
