// What several tests of markers ask: is a name refused with its reason, what colour is a place, and
// what does the AprilTag library see.
#pragma once

#include <apriltag/apriltag.h>

#include <opencv2/core.hpp>

#include "sim/marker/marker.h"
#include "tests/test.h"

namespace etalon::test {

// At the place "--marker", with these words.
inline void expect_refused(const std::string& spec, const std::string& reason) {
    try {
        parse_marker(spec, "--marker");
        ADD_FAILURE() << spec;
    } catch (const ConfigError& error) {
        EXPECT_EQ(error.place().file, "--marker") << spec;
        EXPECT_THAT(error.what(), HasSubstr(reason)) << spec;
    }
}

inline float radiance_at(const Marker& marker, double x_mm, double y_mm) {
    const CellGrid& grid = marker.grid;
    return grid.cells.at<float>(
        static_cast<int>(std::floor((y_mm - grid.corner_mm.y()) / grid.cell_mm.y())),
        static_cast<int>(std::floor((x_mm - grid.corner_mm.x()) / grid.cell_mm.x())));
}

struct SeenTag {
    int id;
    std::vector<cv::Point2d> corners;  // top left clockwise, pixel centres at integers
};

inline std::vector<SeenTag> seen_apriltags(apriltag_family_t* family, const cv::Mat& image) {
    apriltag_detector_t* detector = apriltag_detector_create();
    detector->quad_decimate = 1.0f;
    apriltag_detector_add_family_bits(detector, family, 0);
    image_u8_t view{image.cols, image.rows, static_cast<int>(image.step), image.data};
    zarray_t* found = apriltag_detector_detect(detector, &view);
    std::vector<SeenTag> tags;
    for (int i = 0; i < zarray_size(found); ++i) {
        apriltag_detection_t* one = nullptr;
        zarray_get(found, i, &one);
        SeenTag& tag = tags.emplace_back(SeenTag{one->id, {}});
        for (int k = 3; k >= 0; --k)  // bottom left, then counter-clockwise; centres at 0.5
            tag.corners.emplace_back(one->p[k][0] - 0.5, one->p[k][1] - 0.5);
    }
    apriltag_detections_destroy(found);
    apriltag_detector_destroy(detector);
    return tags;
}

}  // namespace etalon::test
