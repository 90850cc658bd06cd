// The sensor in the frame in which a marker is seen (docs/rendering.md). A flat projection has one
// for all markers; a wide lens is turned towards each and needs only the pixels that may see it.
#pragma once

#include "sim/tiles/tail_pyramid.h"

namespace etalon {

struct SensorMap {
    // Of these pixels and what the filter takes around them. The filter must outlive it.
    SensorMap(const ImageFilter& filter, const Projector& projector, const cv::Rect& pixels);
    SensorMap(const SensorMap&) = delete;

    UndistortionMap rays;
    TailPyramid tail;
};

// Of the pixels that may see the marker. `projector`: turned as the view is. Time as the map's:
// some 0.6 to 2 us for each of these tiles.
std::unique_ptr<const SensorMap> sensor_towards(const Projector& projector,
                                                const ImageFilter& filter, const MarkerView& view);

// 255 where a pixel's centre has a ray: from a map of all pixels, or from the projector (which
// takes some 0.5 us a tile, on all cores).
cv::Mat valid_mask(const CameraModel& camera, const UndistortionMap& map);
cv::Mat valid_mask(const Projector& projector);

}  // namespace etalon
