// How a marker's image is sampled before it is filtered.
#pragma once

#include "sim/psf/edge_table.h"
#include "sim/psf/wedge_table.h"

namespace etalon {

enum class SampleKind {
    point,  // values at the centres of a pixel's k x k parts
    box,    // averages over them
    disk,   // averages over disks around the centres, for the sharpened spread
    pixel,  // what the spread's core makes of the pixels, by a table of edges and corners; k is 1
};

// Tiles blurred by at least this everywhere are sampled at k places per pixel side, exact lens
// averages, and interpolated (sim/tiles/tile_interpolation.h).
struct CoarseSampling {
    double from_blur_px;
    int k;
};

struct Sampling {
    int k = 1;  // samples per pixel side
    // By how much the distortion may shrink and magnify the blur, which the limits below are for.
    double least_blur_scale = 1.0, largest_blur_scale = 1.0;
    SampleKind kind = SampleKind::box;
    // Box samples: tiles blurred by at least this everywhere take the mean of 2 x 2 exact lens
    // averages per box instead of the exact area at some lens points.
    double exact_lens_from_px = std::numeric_limits<double>::infinity();
    // Box and disk samples: up to this blur the lens centre stands for the aperture.
    double sharp_up_to_px = 0.0;
    // Disk samples: their radius on the sensor, in pixel pitches along x, and how many concentric
    // disks stand for disk and aperture together: one up to this blur, beyond it so many.
    double disk_radius_px = 0.0, one_disk_up_to_px = 0.0;
    int disks = 1;
    // Disk samples: tiles not blurred by at least this everywhere are sampled at 2 k places per
    // pixel side and thinned out.
    double direct_from_px = 0.0;
    // Pixels only: the table, and from where on they do not see an edge, px.
    const WedgeTable* wedges = nullptr;
    double wedge_reach_px = 0.0;
    // Point samples: groups of tiles that see one edge take its response, where that errs by less
    // than this much; null: none does.
    const EdgeTable* edges = nullptr;
    double edge_gray = 0.0;
    // The coarsest first.
    std::vector<CoarseSampling> coarser;
};

}  // namespace etalon
