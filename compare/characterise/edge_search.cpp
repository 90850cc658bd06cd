#include "compare/characterise/edge_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/program/errors.h"

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
        const double x = std::abs(along().x), y = std::abs(along().y);
        return std::atan2(std::min(x, y), std::max(x, y)) * 180.0 / std::numbers::pi;
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
    std::ranges::stable_sort(segments, std::greater(), &Segment::length);
    return segments;
}

// Around the segment less its ends, which other edges meet, so far to both sides.
cv::Rect window_of(const Segment& segment, double to_both_sides_px) {
    constexpr double ends = 0.08;  // of its length
    const cv::Point2d a = segment.from + ends * segment.along(),
                      b = segment.to - ends * segment.along();
    const cv::Point2d low(std::min(a.x, b.x), std::min(a.y, b.y)),
        high(std::max(a.x, b.x), std::max(a.y, b.y));
    const cv::Point2d sides = segment.is_steep() ? cv::Point2d(to_both_sides_px, 0.0)
                                                 : cv::Point2d(0.0, to_both_sides_px);
    return {cv::Point(cvRound(low.x - sides.x), cvRound(low.y - sides.y)),
            cv::Point(cvRound(high.x + sides.x), cvRound(high.y + sides.y))};
}

// Another edge in the window would turn the line, or leave a spectrum that is mostly noise.
bool is_this_edge(const SlantedEdge& edge, const Segment& segment) {
    constexpr double max_turn_deg = 1.5, max_nyquist_deviation = 0.05;
    return edge.mtf50_cycles_per_px > 0.0 &&
           std::abs(edge.angle_deg - segment.angle_deg()) < max_turn_deg &&
           edge.at_nyquist_standard_uncertainty < max_nyquist_deviation;
}

// In the width in which its MTF50 is most certain: what is beside the edge counts as noise.
std::optional<FoundSlantedEdge> measured(const LinearPhoto& photo, const Segment& segment,
                                         std::string& reason) {
    std::optional<FoundSlantedEdge> best;
    for (const double side : {10.0, 14.0, 20.0, 28.0, 40.0}) {
        const cv::Rect region = window_of(segment, side);
        auto edge = attempted([&] { return slanted_edge(photo, region); });
        if (edge && is_this_edge(*edge, segment) &&
            (!best || edge->mtf50_standard_uncertainty < best->edge.mtf50_standard_uncertainty))
            best = FoundSlantedEdge{region, *edge};
        if (!best && reason.empty())
            reason = edge.cause;
    }
    return best;
}

cv::Point middle_of(const cv::Rect& region) {
    return (region.tl() + region.br()) / 2;
}

}  // namespace

SlantedEdges find_slanted_edges(const LinearPhoto& photo, std::size_t most) {
    std::vector<FoundSlantedEdge> all;
    SlantedEdges found;
    for (const Segment& segment : slanted_segments(photo))
        if (auto edge = measured(photo, segment, found.reason))
            all.push_back(std::move(*edge));
    std::ranges::stable_sort(
        all, {}, [](const FoundSlantedEdge& each) { return each.edge.mtf50_standard_uncertainty; });
    for (FoundSlantedEdge& each : all) {
        const bool is_apart = std::ranges::none_of(found.edges, [&](const FoundSlantedEdge& other) {
            return other.region.contains(middle_of(each.region)) ||
                   each.region.contains(middle_of(other.region));
        });
        if (is_apart && found.edges.size() < most)
            found.edges.push_back(std::move(each));
    }
    return found;
}

}  // namespace etalon
