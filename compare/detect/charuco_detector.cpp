// The ChArUco corners of compare/detect/calibration_target.h behind the Detector interface.
#include <algorithm>

#include "compare/detect/calibration_target.h"
#include "compare/detect/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

class CharucoDetector final : public Detector {
public:
    explicit CharucoDetector(const Marker& board) : Detector("charuco"), target_{board} {}

    Detection detect(const CodeImage& image) override {
        const auto view = observe(target_, image);
        if (!view)
            return only_one({});
        const bool is_whole = view->ids.size() == target_.board.points_mm.size();
        return only_one({{0, view->pixels, is_whole ? std::vector<int>() : view->ids}});
    }

private:
    CalibrationTarget target_;
};

}  // namespace

std::unique_ptr<Detector> make_charuco_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::charuco)
        throw ConfigError({place}, "the charuco detector cannot see " + marker.spec);
    if (std::min(marker.columns, marker.rows) < 3 || std::max(marker.columns, marker.rows) < 4)
        throw ConfigError({place}, marker.spec + " has fewer than 2x3 inner corners");
    return std::make_unique<CharucoDetector>(marker);
}

}  // namespace etalon
