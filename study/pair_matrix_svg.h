// The picture of a pair matrix, for a file of its own or inside a page: see study/pair_matrix.h.
#pragma once

#include <string>

#include "study/pair_matrix.h"

namespace etalon {

// Of a panel, in the units of its <svg>: the density's cells are 2 x 2, two rows at the top and the
// bottom are the rims for what lies beyond the axis, with an empty row between.
inline constexpr double panel_width = 2.0 * PairMatrix::columns,
                        panel_height = 2.0 * (PairMatrix::rows + 6), panel_rim = 6.0;

enum class PairPicture { in_page, stand_alone };

// In a page every panel has the data that enlarging needs, and every bin its <title>.
std::string pair_matrix_picture(const PairMatrix& matrix, PairPicture kind);

// Style rules of the picture; those of a page follow its colours.
std::string pair_matrix_style(PairPicture kind);

}  // namespace etalon
