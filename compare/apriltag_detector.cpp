// libapriltag 3 behind the Detector interface. Its C handles never leave this file.
#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>

#include "compare/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

struct FamilyMaker {
    const char* name;
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
};

constexpr FamilyMaker family_makers[] = {
    {"36h11", tag36h11_create, tag36h11_destroy},
    {"36h10", tag36h10_create, tag36h10_destroy},
    {"25h9", tag25h9_create, tag25h9_destroy},
    {"16h5", tag16h5_create, tag16h5_destroy},
    {"Circle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    {"Circle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    {"Custom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    {"Standard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    {"Standard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
};

using Family = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;
using Finder = std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)>;
using Detections = std::unique_ptr<zarray_t, void (*)(zarray_t*)>;

Family make_family(const std::string& name, const std::string& place) {
    for (const FamilyMaker& maker : family_makers)
        if (name == maker.name)
            return {maker.create(), maker.destroy};
    throw ConfigError({place}, "libapriltag has no family '" + name + "'");
}

// The library's table of correctable codes grows with codes * bits^errors: two wrong bits in a
// family of 42 211 codes would take gigabytes.
int correctable_bits(const apriltag_family_t& family) {
    return family.ncodes > 5000 ? 1 : 2;
}

// The library puts (0, 0) at the corner of the top-left pixel, and lists the corners from the
// bottom left counter-clockwise; ours is the pixel's centre, from the top left clockwise.
std::vector<Eigen::Vector2d> corners_in_our_convention(const apriltag_detection_t& detection) {
    constexpr double half_pixel = 0.5;
    std::vector<Eigen::Vector2d> corners;
    for (const int i : {3, 2, 1, 0})
        corners.emplace_back(detection.p[i][0] - half_pixel, detection.p[i][1] - half_pixel);
    return corners;
}

class ApriltagDetector final : public Detector {
public:
    ApriltagDetector(const Marker& marker, const std::string& place)
        : id_(marker.id),
          family_(make_family(marker.family, place)),
          finder_(apriltag_detector_create(), apriltag_detector_destroy) {
        finder_->nthreads = 1;       // the same image gives the same result
        finder_->quad_decimate = 1;  // 2, the library's default, loses half of the small tags
        finder_->refine_edges = true;
        apriltag_detector_add_family_bits(finder_.get(), family_.get(), correctable_bits(*family_));
    }

    const std::string& name() const override { return name_; }

    std::optional<DetectedCorners> detect(const CodeImage& image) override {
        constexpr int smallest_tag = 8;  // px; the library's tiles need this much, too
        cv::Mat pixels = as_8_bit(image);
        if (pixels.cols < smallest_tag || pixels.rows < smallest_tag)
            return not_found();
        image_u8_t view{pixels.cols, pixels.rows, static_cast<int32_t>(pixels.step), pixels.data};
        const Detections detections(apriltag_detector_detect(finder_.get(), &view),
                                    apriltag_detections_destroy);
        std::vector<DetectedCorners> own;
        for (int i = 0; i < zarray_size(detections.get()); ++i) {
            apriltag_detection_t* detection = nullptr;
            zarray_get(detections.get(), i, &detection);
            if (detection->id == id_)
                own.push_back({id_, corners_in_our_convention(*detection)});
        }
        return only_one(own);
    }

private:
    const std::string name_ = "apriltag";
    int id_;
    Family family_;  // outlives the finder, which refers to it
    Finder finder_;
};

}  // namespace

std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::apriltag)
        throw ConfigError({place}, "the apriltag detector cannot see " + marker.spec);
    return std::make_unique<ApriltagDetector>(marker, place);
}

}  // namespace etalon
