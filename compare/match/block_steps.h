// What strong JPEG compression leaves: steps between blocks of 8 x 8 px where the marker is flat.
// Only for whole photographs: a cut or scaled one has its blocks elsewhere.
#pragma once

#include "compare/photometric/pixel_difference.h"

namespace etalon {

struct BlockSteps {
    // RMS difference of neighbouring pixels' residuals, gray: across the borders of blocks and
    // inside them. 0 where there are no flat pairs.
    double across_gray = 0.0, inside_gray = 0.0;
    int pairs = 0;  // across borders

    // What the borders add: sqrt(across^2 - inside^2), or 0.
    double excess_gray() const;
};

// Of the compared pixels whose prediction changes by less than 1 % of `contrast_gray` per px.
BlockSteps block_steps(const PixelDifference& difference, double contrast_gray);

}  // namespace etalon
