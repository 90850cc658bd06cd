// libapriltag behind the Detector interface.
#include <fmt/format.h>

#include <cmath>

#include "compare/detect/apriltag_finder.h"
#include "compare/detect/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

class ApriltagDetector final : public Detector {
public:
    ApriltagDetector(const Marker& marker, const ApriltagQuads& quads)
        : id_(marker.id), finder_(marker.family, 1, quads) {}

    const std::string& name() const override { return name_; }

    std::optional<DetectedCorners> detect(const CodeImage& image) override {
        std::vector<DetectedCorners> own;
        for (const FoundTag& tag : finder_.find(as_8_bit(image)))
            if (tag.id == id_)
                own.push_back({id_, {tag.corners.begin(), tag.corners.end()}});
        return only_one(own);
    }

private:
    const std::string name_ = "apriltag";
    int id_;
    ApriltagFinder finder_;
};

// The library cuts other factors to whole numbers when it reduces the image, and takes them as they
// are when it scales the outlines back: the corners would be pixels off.
double checked_decimation(double factor, const std::string& place) {
    constexpr double largest = 8.0;
    const bool is_whole = factor >= 1.0 && factor <= largest && factor == std::floor(factor);
    if (!is_whole && factor != 1.5)
        throw ConfigError(
            {place, 0, "quad_decimate"},
            fmt::format("{} is not 1, 1.5 or a whole number up to {}", factor, largest));
    return factor;
}

}  // namespace

std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place,
                                                 const DetectorOptions& options) {
    if (marker.kind != Marker::Kind::apriltag)
        throw ConfigError({place}, "the apriltag detector cannot see " + marker.spec);
    ApriltagQuads quads;
    if (options.quad_decimate)
        quads.decimate = checked_decimation(*options.quad_decimate, place);
    if (options.refine_edges)
        quads.refine_edges = *options.refine_edges;
    return std::make_unique<ApriltagDetector>(marker, quads);
}

}  // namespace etalon
