// The boards of compare/detect/board/calibration_target.h behind the Detector interface.
#include "compare/detect/board/calibration_target.h"
#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Empty for what is no board.
std::string detector_of(Marker::Kind kind) {
    switch (kind) {
        case Marker::Kind::charuco:
            return "charuco";
        case Marker::Kind::aprilgrid:
            return "aprilgrid";
        case Marker::Kind::circles:
        case Marker::Kind::acircles:
        case Marker::Kind::hexcircles:
            return "circles";
        case Marker::Kind::squares:
            return "squares";
        default:
            return "";
    }
}

class BoardDetector final : public Detector {
public:
    BoardDetector(const std::string& name, CalibrationTarget target)
        : Detector(name), target_(std::move(target)) {}

    Detection detect(const CodeImage& image) override {
        const auto [view, reason, shown_as] = observe(target_, image);
        if (!view)
            return {{}, reason.empty() ? "marker not found" : "marker not found: " + reason};
        const bool is_whole = view->ids.size() == target_.board.points_mm.size();
        return {DetectedCorners{0, view->pixels, is_whole ? std::vector<int>() : view->ids},
                {},
                {},
                shown_as};
    }

private:
    CalibrationTarget target_;
};

}  // namespace

std::unique_ptr<Detector> make_board_detector(const Marker& marker, const std::string& place) {
    const std::string name = detector_of(marker.kind);
    if (name.empty())
        throw ConfigError({place}, marker.spec + " is no board");
    return std::make_unique<BoardDetector>(name, parse_calibration_target(marker.spec, place));
}

}  // namespace etalon
