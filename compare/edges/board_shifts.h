// Do the edges' shifts move with the board? What comes back at the same place of the board in
// photographs from other poses is the board's: it is not flat, or not printed true. What stays in
// the image is the camera's, and differs from photograph to photograph on the board.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/camera/projector.h"
#include "compare/edges/edge_shifts.h"
#include "compare/photometric/compared_area.h"
#include "core/geometry/rigid.h"

namespace etalon {

struct EdgesOfPhoto {
    std::vector<EdgeShift> edges;
    Rigid camera_from_marker;
};

// Of the displacements across each edge in the marker's plane, mm.
struct BoardShifts {
    double share = 0.0;  // of their mean square, the part that edges of different photographs share
    double rms_mm = 0.0;  // of that part
    // Errors of a photograph could as well have the other sign, all of them together: the share of
    // such changes of sign after which as much is shared (the wild bootstrap: Wu, Ann. Statist. 14,
    // 1986).
    double chance = 1.0;

    bool are_the_boards() const { return chance <= 0.01 && share >= 0.25; }
};

inline constexpr std::size_t min_board_photos = 8;  // 2^7 signs: a chance of 1/128 can be seen

// Nothing for fewer photographs, and where none shares an edge with another. Perspective cameras.
// Milliseconds for a hundred edges in each of 20 photographs; safe from every thread.
std::optional<BoardShifts> board_shifts(std::span<const EdgesOfPhoto> photos,
                                        const Projector& projector, const ComparedArea& area);

}  // namespace etalon
