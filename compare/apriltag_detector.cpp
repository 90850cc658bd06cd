// libapriltag behind the Detector interface.
#include "compare/apriltag_finder.h"
#include "compare/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

class ApriltagDetector final : public Detector {
public:
    explicit ApriltagDetector(const Marker& marker) : id_(marker.id), finder_(marker.family) {}

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

}  // namespace

std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::apriltag)
        throw ConfigError({place}, "the apriltag detector cannot see " + marker.spec);
    return std::make_unique<ApriltagDetector>(marker);
}

}  // namespace etalon
