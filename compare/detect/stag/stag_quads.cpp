#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "compare/detect/stag/stag_detector.h"
#include "core/image/opencv_plugin.h"

namespace etalon {
namespace {

using Chain = std::vector<cv::Point>;

// A straight part of a chain.
struct Line {
    Eigen::Vector2d from, to;  // its ends, on the line
    Eigen::Vector2d along;     // unit
    double length() const { return (to - from).norm(); }
};

Eigen::Vector2d vector_of(const cv::Point& pixel) {
    return {pixel.x, pixel.y};
}

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() * b.y() - a.y() * b.x();
}

// The pixel that is farthest from the chord between the chain's ends, and how far that is.
std::pair<std::size_t, double> farthest_from_chord(std::span<const cv::Point> chain) {
    const Eigen::Vector2d start = vector_of(chain.front());
    const Eigen::Vector2d chord = vector_of(chain.back()) - start;
    const double length = chord.norm();
    std::pair<std::size_t, double> farthest{0, -1.0};
    for (std::size_t i = 0; i < chain.size(); ++i) {
        const Eigen::Vector2d place = vector_of(chain[i]) - start;
        const double distance =
            length < 2.0 ? place.norm() : std::abs(cross(chord, place)) / length;
        if (distance > farthest.second)
            farthest = {i, distance};
    }
    return farthest;
}

// Cuts the chain where it leaves its chord (Ramer, Douglas and Peucker) and adds the parts' ends.
void cut(std::span<const cv::Point> chain, std::size_t first, double tolerance_px,
         std::vector<std::size_t>& ends) {
    const auto [farthest, distance] = farthest_from_chord(chain);
    if (distance > tolerance_px && farthest > 0 && farthest + 1 < chain.size()) {
        cut(chain.subspan(0, farthest + 1), first, tolerance_px, ends);
        cut(chain.subspan(farthest), first + farthest, tolerance_px, ends);
    } else {
        ends.push_back(first + chain.size() - 1);
    }
}

// The line with the least squared distances to the pixels, without the two next to each end, which
// belong to the corner.
std::optional<Line> fit_line(std::span<const cv::Point> pixels) {
    constexpr std::size_t corner_pixels = 2, min_pixels = 4;
    if (pixels.size() < min_pixels + 2 * corner_pixels)
        return std::nullopt;
    pixels = pixels.subspan(corner_pixels, pixels.size() - 2 * corner_pixels);
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    for (const cv::Point& pixel : pixels)
        mean += vector_of(pixel) / static_cast<double>(pixels.size());
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    for (const cv::Point& pixel : pixels) {
        const Eigen::Vector2d place = vector_of(pixel) - mean;
        scatter += place * place.transpose();
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
    solver.computeDirect(scatter);
    const Eigen::Vector2d first = vector_of(pixels.front()), last = vector_of(pixels.back());
    Eigen::Vector2d along = solver.eigenvectors().col(1);
    if (along.dot(last - first) < 0.0)
        along = -along;
    return Line{mean + along * along.dot(first - mean), mean + along * along.dot(last - mean),
                along};
}

std::vector<Line> lines_of(const Chain& chain, double tolerance_px) {
    std::vector<std::size_t> ends{0};
    cut(chain, 0, tolerance_px, ends);
    std::vector<Line> lines;
    for (std::size_t i = 1; i < ends.size(); ++i)
        if (const auto line =
                fit_line(std::span(chain).subspan(ends[i - 1], ends[i] - ends[i - 1] + 1)))
            lines.push_back(*line);
    return lines;
}

std::optional<Eigen::Vector2d> intersection(const Line& a, const Line& b) {
    constexpr double min_sine = 0.17;  // 10 degrees
    const double sine = cross(a.along, b.along);
    if (std::abs(sine) < min_sine)
        return std::nullopt;
    return a.from + a.along * (cross(b.from - a.from, b.along) / sine);
}

// Where a line meets the next, if that is near the end of the one and the start of the other.
std::optional<Eigen::Vector2d> corner_between(const Line& line, const Line& next) {
    const double reach = 5.0 + 0.2 * std::min(line.length(), next.length());
    const auto corner = intersection(line, next);
    if (!corner || (*corner - line.to).norm() > reach || (*corner - next.from).norm() > reach)
        return std::nullopt;
    return corner;
}

// Clockwise, if all its angles turn the same way.
std::optional<Quad> clockwise(Quad quad) {
    int right_turns = 0;
    for (std::size_t i = 0; i < 4; ++i)
        right_turns +=
            cross(quad[(i + 1) % 4] - quad[i], quad[(i + 2) % 4] - quad[(i + 1) % 4]) > 0;
    if (right_turns == 0)
        std::swap(quad[1], quad[3]);
    else if (right_turns != 4)
        return std::nullopt;
    return quad;
}

// With any of the corners first.
bool are_the_same(const Quad& a, const Quad& b) {
    constexpr double near_px = 0.3;
    for (std::size_t first = 0; first < 4; ++first) {
        double farthest = 0.0;
        for (std::size_t i = 0; i < 4; ++i)
            farthest = std::max(farthest, (a[i] - b[(first + i) % 4]).norm());
        if (farthest < near_px)
            return true;
    }
    return false;
}

std::optional<Quad> quad_of(std::span<const Line> lines) {
    const auto first = corner_between(lines[0], lines[1]),
               second = corner_between(lines[1], lines[2]),
               third = corner_between(lines[2], lines[3]), last = intersection(lines[3], lines[0]);
    if (!first || !second || !third || !last)
        return std::nullopt;
    return clockwise({*last, *first, *second, *third});
}

// Edge Drawing begins and ends a closed curve anywhere, with a gap of a few pixels.
bool is_closed(const Chain& chain) {
    constexpr double max_gap_px = 5.0;
    return (vector_of(chain.back()) - vector_of(chain.front())).norm() <= max_gap_px;
}

// The closed curve from the pixel that is farthest from its centre, a corner if it has corners,
// and back to it.
Chain from_a_corner(Chain chain) {
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    for (const cv::Point& pixel : chain)
        centre += vector_of(pixel) / static_cast<double>(chain.size());
    const auto distance = [&](const cv::Point& pixel) {
        return (vector_of(pixel) - centre).norm();
    };
    std::ranges::rotate(chain, std::ranges::max_element(chain, {}, distance));
    chain.push_back(chain.front());
    return chain;
}

// How far a side may be from straight: distortion and a near circle bend sides, noise does, and a
// blurred corner is cut. What is one line with one tolerance is two with another.
constexpr std::array tolerances_px{1.5, 2.5, 4.0, 6.0};

// Of four lines in a row; after the last line of a closed curve comes the first.
void add_quads(std::vector<Line> lines, bool closed, std::vector<Quad>& quads) {
    if (lines.size() < 4)
        return;
    if (closed && lines.size() > 4)
        lines.insert(lines.end(), {lines[0], lines[1], lines[2]});
    for (std::size_t i = 0; i + 4 <= lines.size(); ++i)
        if (const auto quad = quad_of(std::span(lines).subspan(i, 4));
            quad && std::none_of(quads.begin(), quads.end(),
                                 [&](const Quad& other) { return are_the_same(*quad, other); }))
            quads.push_back(*quad);
}

}  // namespace

std::vector<Quad> find_quads(const cv::Mat& image) {
    constexpr int min_side_px = 16;  // what the library's own filters need
    if (image.cols < min_side_px || image.rows < min_side_px)
        return {};
    std::vector<Quad> quads;
    for (const Chain& segment : opencv_plugin().edge_segments(image)) {
        const bool closed = is_closed(segment);
        const Chain chain = closed ? from_a_corner(segment) : segment;
        for (const double tolerance_px : tolerances_px)
            add_quads(lines_of(chain, tolerance_px), closed, quads);
    }
    return quads;
}

}  // namespace etalon
