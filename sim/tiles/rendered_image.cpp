#include "sim/tiles/rendered_image.h"

#include "sim/tiles/tile_map.h"

namespace etalon {

Radiance RenderedPart::within(const cv::Rect& other) const {
    Radiance result(other.size(), CV_32FC1);
    const cv::Rect both = region & other;
    set_outside(both, other, static_cast<float>(background), result);
    if (!both.empty())
        radiance(both - region.tl()).copyTo(result(both - other.tl()));
    return result;
}

}  // namespace etalon
