#include "compare/detect/stag/stag_detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/detect/detector_adaptors.h"
#include "compare/detect/stag/stag_finder.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// The word stays the nearest one, however the marker is turned; and of random readings no more than
// 4 (1 + 48 + 1128 + 17296 + 194580) / 2^48 = 3e-9 are taken for a marker's.
constexpr int max_correctable_bits = 4;

int correctable_bits(const std::vector<StagCode>& codes, int id) {
    return std::min(max_correctable_bits, (stag_separation(codes, id) - 1) / 2);
}

class StagDetector final : public Detector {
public:
    explicit StagDetector(const Marker& marker) : Detector("stag"), id_(marker.id) {
        const std::vector<StagCode> codes = stag_codes(marker.family);
        word_ = codes.at(static_cast<std::size_t>(id_));
        correctable_bits_ = correctable_bits(codes, id_);
    }

    Detection detect(const CodeImage& image) override {
        const std::vector<FoundStag> found = find_stags(image, {&word_, 1}, correctable_bits_);
        std::vector<DetectedCorners> own;
        for (const FoundStag& marker : found)
            if (marker.is_refined)
                own.push_back({id_, {marker.corners.begin(), marker.corners.end()}});
        if (own.empty() && !found.empty())
            return {{},
                    fmt::format("marker {} is seen, but its edges do not fix its corners", id_)};
        return only_one(own);
    }

private:
    int id_, correctable_bits_ = 0;
    StagCode word_ = 0;
};

}  // namespace

std::unique_ptr<Detector> make_stag_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::stag)
        throw ConfigError({place}, "the STag detector cannot see " + marker.spec);
    return std::make_unique<StagDetector>(marker);
}

}  // namespace etalon
