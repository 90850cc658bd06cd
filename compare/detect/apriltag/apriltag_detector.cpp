// libapriltag behind the Detector interface.
#include <fmt/format.h>

#include <cmath>

#include "compare/detect/apriltag/apriltag_finder.h"
#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

class ApriltagDetector final : public Detector {
public:
    ApriltagDetector(const Marker& marker, const ApriltagOptions& options)
        : Detector("apriltag", ApriltagFinder::library_offset_px),
          id_(marker.id),
          finder_(marker.family, 1, options) {}

    Detection detect(const CodeImage& image) override {
        std::vector<DetectedCorners> own;
        for (const FoundTag& tag : finder_.find(as_8_bit(image)))
            if (tag.id == id_)
                own.push_back({id_, {tag.corners.begin(), tag.corners.end()}});
        return only_one(own);
    }

private:
    int id_;
    ApriltagFinder finder_;
};

// The library cuts other factors to whole numbers when it reduces the image, and takes them as they
// are when it scales the outlines back: the corners would be pixels off.
void require_exact_decimation(double factor, const std::string& place) {
    constexpr double max_factor = 8.0;
    const bool is_whole = factor >= 1.0 && factor <= max_factor && factor == std::floor(factor);
    if (!is_whole && factor != 1.5)
        throw ConfigError(
            {place, 0, "quad_decimate"},
            fmt::format("{} is not 1, 1.5 or a whole number up to {}", factor, max_factor));
}

}  // namespace

std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place,
                                                 const ApriltagOptions& options) {
    if (marker.kind != Marker::Kind::apriltag)
        throw ConfigError({place}, "the apriltag detector cannot see " + marker.spec);
    require_exact_decimation(options.quad_decimate, place);
    return std::make_unique<ApriltagDetector>(marker, options);
}

}  // namespace etalon
