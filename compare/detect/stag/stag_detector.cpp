#include "compare/detect/stag/stag_detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/detect/detector_adaptors.h"

namespace etalon {
namespace {

// What is looked for, and the least contrast of its references in the image's values.
struct Wanted {
    std::span<const StagCode> words;
    int correctable_bits;
    double contrast;
};

struct Candidate {
    int id;
    Quad corners;  // upright
    int quarters;  // by which it was turned to be so
    int wrong_bits;
    double contrast;
};

// The corners from the marker's top left, of a marker seen turned counter-clockwise.
Quad upright(const Quad& seen, int quarters) {
    Quad corners;
    for (std::size_t i = 0; i < 4; ++i)
        corners[i] = seen[(i + 4 - static_cast<std::size_t>(quarters)) % 4];
    return corners;
}

// The publication allows 1.5; a marker at a distance of 1.5 sides tilted by 60 degrees has 1.9.
constexpr double max_depth_ratio = 2.0;
constexpr double min_contrast = 0.05;  // of full scale

// Largest over smallest depth of the square's corners, as far as the image shows it: 1 for a marker
// seen squarely. Not above 0 when a corner would be behind the camera.
double depth_ratio(const Homography& image_from_marker) {
    const double reach = 0.5 * image_from_marker.row(2).head<2>().lpNorm<1>();
    return (1.0 + reach) / (1.0 - reach);
}

std::optional<Candidate> read(const cv::Mat& image, const Quad& quad, const Wanted& wanted) {
    const auto seen = homography_to(quad);
    if (!seen)
        return std::nullopt;
    const double ratio = depth_ratio(*seen);
    if (!(ratio >= 1.0 && ratio <= max_depth_ratio))
        return std::nullopt;
    const auto reading = read_stag_code(image, *seen);
    if (!reading || !(reading->contrast >= wanted.contrast))
        return std::nullopt;
    Candidate nearest{-1, quad, 0, wanted.correctable_bits + 1, reading->contrast};
    for (std::size_t id = 0; id < wanted.words.size(); ++id)
        for (int quarters = 0; quarters < 4; ++quarters) {
            const int wrong =
                hamming_distance(reading->code, turned_stag_code(wanted.words[id], quarters));
            if (wrong < nearest.wrong_bits)
                nearest = {static_cast<int>(id), upright(quad, quarters), quarters, wrong,
                           reading->contrast};
        }
    return nearest.id < 0 ? std::nullopt : std::optional(nearest);
}

bool overlap(const Quad& a, const Quad& b) {
    const auto centre = [](const Quad& quad) -> Eigen::Vector2d {
        return (quad[0] + quad[1] + quad[2] + quad[3]) / 4.0;
    };
    return (centre(a) - centre(b)).norm() < 0.5 * (a[2] - a[0]).norm();
}

FoundStag refined(const cv::Mat& image, const Candidate& candidate, const Wanted& wanted) {
    const FoundStag unrefined{candidate.id, candidate.corners, candidate.wrong_bits};
    const auto start = homography_to(candidate.corners);
    if (!start)
        return unrefined;
    const StagCode word = wanted.words[static_cast<std::size_t>(candidate.id)];
    const auto refinement = refine_stag(image, *start, word, candidate.contrast);
    if (!refinement)
        return unrefined;
    const auto again = read(image, refinement->corners, wanted);
    if (!again || again->id != candidate.id || again->quarters != 0)
        return unrefined;
    return {candidate.id, refinement->corners, again->wrong_bits, true};
}

}  // namespace

std::vector<FoundStag> find_stags(const CodeImage& image, std::span<const StagCode> words,
                                  int correctable_bits) {
    const Wanted wanted{words, correctable_bits, min_contrast * image.full_scale()};
    cv::Mat pixels;
    image.pixels.convertTo(pixels, CV_32F);
    std::vector<Candidate> candidates;
    for (const Quad& quad : find_quads(as_8_bit(image)))
        if (const auto candidate = read(pixels, quad, wanted))
            candidates.push_back(*candidate);
    std::ranges::stable_sort(candidates, {}, &Candidate::wrong_bits);
    std::vector<FoundStag> found;
    for (const Candidate& candidate : candidates) {
        const auto same = std::find_if(found.begin(), found.end(), [&](const FoundStag& other) {
            return overlap(other.corners, candidate.corners);
        });
        if (same == found.end())
            found.push_back(refined(pixels, candidate, wanted));
        else if (!same->is_refined)
            if (const FoundStag again = refined(pixels, candidate, wanted); again.is_refined)
                *same = again;
    }
    return found;
}

std::unique_ptr<Detector> make_stag_detector(const Marker& marker) {
    // The word stays the nearest one, however the marker is turned; and of random readings no more
    // than 4 (1 + 48 + 1128 + 17296 + 194580) / 2^48 = 3e-9 are taken for a marker's.
    constexpr int max_correctable_bits = 4;
    const std::vector<StagCode> codes = stag_codes(marker.family);
    const int id = marker.id,
              correctable = std::min(max_correctable_bits, (stag_separation(codes, id) - 1) / 2);
    return std::make_unique<Detector>(
        "stag",
        [id, correctable,
         word = codes.at(static_cast<std::size_t>(id))](const CodeImage& image) -> Detection {
            const std::vector<FoundStag> found = find_stags(image, {&word, 1}, correctable);
            std::vector<DetectedCorners> own;
            for (const FoundStag& one : found)
                if (one.is_refined)
                    own.push_back({id, {one.corners.begin(), one.corners.end()}});
            if (own.empty() && !found.empty())
                return {{},
                        fmt::format("marker {} is seen, but its edges do not fix its corners", id)};
            return only_one(id, own);
        });
}

}  // namespace etalon
