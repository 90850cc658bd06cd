#include "compare/characterise/edge_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/errors.h"

namespace etalon {
namespace {

constexpr double min_angle_deg = 2.0, max_angle_deg = 15.0;
constexpr double min_length_px = 24.0;

struct Segment {
    cv::Point2d from, to;

    cv::Point2d along() const { return to - from; }
    double length() const { return cv::norm(along()); }
    bool is_steep() const { return std::abs(along().y) > std::abs(along().x); }
    double angle_deg() const {
        const auto [less, more] = std::minmax(std::abs(along().x), std::abs(along().y));
        return std::atan2(less, more) * 180.0 / std::numbers::pi;
    }
};

std::vector<Segment> slanted_segments(const LinearPhoto& photo) {
    double lowest = 0.0, highest = 0.0;
    cv::minMaxLoc(photo.radiance, &lowest, &highest);
    if (!(highest > lowest))
        return {};
    // Lines stand out where the dark parts have room on the scale, too.
    cv::Mat visible;
    cv::sqrt(cv::max((photo.radiance - lowest) / (highest - lowest), 0.0), visible);
    visible.convertTo(visible, CV_8U, 255.0);
    std::vector<cv::Vec4f> lines;
    cv::createLineSegmentDetector()->detect(visible, lines);
    std::vector<Segment> segments;
    for (const cv::Vec4f& line : lines) {
        const Segment segment{{line[0], line[1]}, {line[2], line[3]}};
        const double angle = segment.angle_deg();
        if (segment.length() >= min_length_px && angle >= min_angle_deg && angle <= max_angle_deg)
            segments.push_back(segment);
    }
    return segments;
}

// Around the segment less its ends, which other edges meet, so far to both sides.
cv::Rect window_of(const Segment& segment, double to_both_sides_px) {
    constexpr double ends = 0.08;  // of its length
    const cv::Point2d a = segment.from + ends * segment.along(),
                      b = segment.to - ends * segment.along();
    const cv::Point2d low(std::min(a.x, b.x), std::min(a.y, b.y)),
        high(std::max(a.x, b.x), std::max(a.y, b.y));
    const cv::Point2d sides =
        segment.is_steep() ? cv::Point2d(to_both_sides_px, 0.0) : cv::Point2d(0.0, to_both_sides_px);
    return {cv::Point(cvRound(low.x - sides.x), cvRound(low.y - sides.y)),
            cv::Point(cvRound(high.x + sides.x), cvRound(high.y + sides.y))};
}

// In the width in which its MTF50 is most certain: what is beside the edge counts as noise.
std::optional<FoundSlantedEdge> measured(const LinearPhoto& photo, const Segment& segment) {
    std::optional<FoundSlantedEdge> best;
    for (const double side : {10.0, 14.0, 20.0, 28.0, 40.0}) {
        const cv::Rect region = window_of(segment, side);
        auto edge = attempted([&] { return slanted_edge(photo, region); });
        if (edge && edge->mtf50_cycles_per_px > 0.0 &&
            (!best ||
             edge->mtf50_standard_uncertainty < best->edge.mtf50_standard_uncertainty))
            best = FoundSlantedEdge{region, *edge};
    }
    return best;
}

}  // namespace

std::vector<FoundSlantedEdge> find_slanted_edges(const LinearPhoto& photo, std::size_t most) {
    std::vector<FoundSlantedEdge> all;
    for (const Segment& segment : slanted_segments(photo))
        if (auto edge = measured(photo, segment))
            all.push_back(std::move(*edge));
    std::ranges::stable_sort(all, {}, [](const FoundSlantedEdge& each) {
        return each.edge.mtf50_standard_uncertainty;
    });
    std::vector<FoundSlantedEdge> best;
    for (FoundSlantedEdge& each : all) {
        const bool is_apart = std::ranges::none_of(best, [&](const FoundSlantedEdge& other) {
            return (other.region & each.region).area() > 0;
        });
        if (is_apart && best.size() < most)
            best.push_back(std::move(each));
    }
    return best;
}

}  // namespace etalon
