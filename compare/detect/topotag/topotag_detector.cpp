#include "compare/detect/topotag/topotag_detector.h"

#include "compare/detect/detector_adaptors.h"
#include "compare/detect/topotag/topotag_finder.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

class TopotagDetector final : public Detector {
public:
    explicit TopotagDetector(const Marker& marker)
        : Detector("topotag"), id_(marker.id), family_(marker.family) {}

    Detection detect(const CodeImage& image) override {
        cv::Mat pixels;
        image.pixels.convertTo(pixels, CV_32F, 1.0 / image.full_scale());
        std::vector<DetectedCorners> own;
        for (const FoundTopotag& tag : find_topotags(as_8_bit(image), pixels, family_))
            if (tag.id == id_)
                own.push_back({id_, tag.vertices});
        return only_one(own);
    }

private:
    int id_;
    std::string family_;
};

}  // namespace

std::unique_ptr<Detector> make_topotag_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::topotag)
        throw ConfigError({place}, "the topotag detector cannot see " + marker.spec);
    return std::make_unique<TopotagDetector>(marker);
}

}  // namespace etalon
