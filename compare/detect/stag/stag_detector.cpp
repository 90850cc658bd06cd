#include "compare/detect/stag/stag_detector.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "compare/detect/detector_adaptors.h"
#include "core/image/opencv_plugin.h"

namespace etalon {

std::optional<double> bilinear(const cv::Mat& image, const Eigen::Vector2d& place) {
    if (!(place.x() >= 0.0 && place.y() >= 0.0 && place.x() < image.cols - 1 &&
          place.y() < image.rows - 1))
        return std::nullopt;
    const int x = static_cast<int>(place.x()), y = static_cast<int>(place.y());
    const double right = place.x() - x, down = place.y() - y;
    const float* upper = image.ptr<float>(y) + x;
    const float* lower = image.ptr<float>(y + 1) + x;
    return (1.0 - down) * ((1.0 - right) * upper[0] + right * upper[1]) +
           down * ((1.0 - right) * lower[0] + right * lower[1]);
}

std::optional<Homography> homography_to(const Quad& corners) {
    // The marker's corners are (-1, -1, 2), ... / 2: a projective basis, so that three of them give
    // the homography up to their scales, and the fourth gives the scales.
    Eigen::Matrix3d image, marker;
    image << corners[0].homogeneous(), corners[1].homogeneous(), corners[3].homogeneous();
    marker << -0.5, 0.5, -0.5, -0.5, -0.5, 0.5, 1.0, 1.0, 1.0;
    const Eigen::Vector3d image_scales = image.fullPivLu().solve(corners[2].homogeneous());
    const Eigen::Vector3d marker_scales = marker.inverse() * Eigen::Vector3d(0.5, 0.5, 1.0);
    const Homography result =
        image * image_scales.cwiseQuotient(marker_scales).asDiagonal() * marker.inverse();
    if (!result.allFinite() || !(std::abs(result(2, 2)) > 0.0))
        return std::nullopt;
    return result / result(2, 2);
}

namespace {

using Chain = std::vector<cv::Point>;

struct Line {
    Eigen::Vector2d from, to;  // its ends, on the line
    Eigen::Vector2d along;     // unit
    double length() const { return (to - from).norm(); }
};

Eigen::Vector2d vector_of(const cv::Point& pixel) {
    return {pixel.x, pixel.y};
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

// By least squares, without the two pixels next to each end, which belong to the corner.
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
    Quad quad;
    for (std::size_t i = 0; i < 4; ++i) {
        const auto corner =
            i == 0 ? intersection(lines[3], lines[0]) : corner_between(lines[i - 1], lines[i]);
        if (!corner)
            return std::nullopt;
        quad[i] = *corner;
    }
    return clockwise(quad);
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
    std::rotate(chain.begin(), std::ranges::max_element(chain, {}, distance), chain.end());
    chain.push_back(chain.front());
    return chain;
}

// How far a side may be from straight: distortion, a near circle and noise bend sides, blur cuts
// corners.
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

// Convex quadrilaterals in a CV_8UC1 image, good to a pixel or two, from edge segments (Edge
// Drawing, parameter free: C. Akinlar, C. Topal, "EDPF", IJPRAI 26, 2012). A chain of pixels is cut
// into straight lines, of which four in a row may meet. About 2 ms for 640x480.
std::vector<Quad> find_quads(const cv::Mat& image) {
    constexpr int min_side_px = 16;     // what the library's own filters need
    constexpr double max_gap_px = 5.0;  // where Edge Drawing begins and ends a closed curve
    if (image.cols < min_side_px || image.rows < min_side_px)
        return {};
    std::vector<Quad> quads;
    for (const Chain& segment : opencv_plugin().edge_segments(image)) {
        const bool closed =
            (vector_of(segment.back()) - vector_of(segment.front())).norm() <= max_gap_px;
        const Chain chain = closed ? from_a_corner(segment) : segment;
        for (const double tolerance_px : tolerances_px)
            add_quads(lines_of(chain, tolerance_px), closed, quads);
    }
    return quads;
}

constexpr std::size_t references = 12;  // of each shade

// The code points, then the references in the black corners and those on the white border: three of
// each shade, turned by the four quarters.
const std::vector<Eigen::Vector2d>& places_to_read() {
    static const auto all = [] {
        constexpr double white = -0.5 - stag_border / 2.0;
        using Three = std::array<Eigen::Vector2d, 3>;
        std::vector<Eigen::Vector2d> places(stag_code_points().begin(), stag_code_points().end());
        for (Three shade :
             {Three{Eigen::Vector2d(-0.365, -0.455), {-0.41, -0.41}, {-0.455, -0.365}},
              Three{Eigen::Vector2d(-0.25, white), {0.0, white}, {0.25, white}}})
            for (int quarter = 0; quarter < 4; ++quarter)
                for (Eigen::Vector2d& place : shade) {
                    places.push_back(place);
                    place = {-place.y(), place.x()};
                }
        return places;
    }();
    return all;
}

// The threshold between two classes with the largest variance between them (N. Otsu, 1979).
double otsu_threshold(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const double total = std::accumulate(values.begin(), values.end(), 0.0);
    double below = 0.0, largest = -1.0, threshold = values.front();
    for (std::size_t i = 1; i < values.size(); ++i) {
        below += values[i - 1];
        const auto n = static_cast<double>(i), m = static_cast<double>(values.size() - i);
        const double step = (total - below) / m - below / n;
        if (n * m * step * step > largest) {
            largest = n * m * step * step;
            threshold = (values[i - 1] + values[i]) / 2.0;
        }
    }
    return threshold;
}

struct StagReading {
    StagCode code = 0;      // as seen: upright only if the first corner is the marker's top left
    double contrast = 0.0;  // mean white reference - mean black reference, in the image's values
};

// Samples places_to_read() in a CV_32FC1 image. Nothing when one is outside the image.
std::optional<StagReading> read_stag_code(const cv::Mat& image,
                                          const Homography& image_from_marker) {
    std::vector<double> values;
    for (const Eigen::Vector2d& place : places_to_read()) {
        const auto value = bilinear(image, (image_from_marker * place.homogeneous()).hnormalized());
        if (!value)
            return std::nullopt;
        values.push_back(*value);
    }
    const double threshold = otsu_threshold(values);
    StagReading reading;
    for (std::size_t i = 0; i < stag_bits; ++i)
        if (values[i] < threshold)
            reading.code |= StagCode{1} << i;
    const auto blacks = values.begin() + stag_bits, whites = blacks + references;
    reading.contrast =
        (std::accumulate(whites, values.end(), 0.0) - std::accumulate(blacks, whites, 0.0)) /
        references;
    return reading;
}

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

std::optional<Candidate> read(const cv::Mat& image, const Quad& quad, const Wanted& wanted) {
    const auto seen = homography_to(quad);
    if (!seen)
        return std::nullopt;
    // Largest over smallest depth of the square's corners; not above 0 with one behind the camera.
    const double reach = 0.5 * seen->row(2).head<2>().lpNorm<1>();
    const double depth_ratio = (1.0 + reach) / (1.0 - reach);
    if (!(depth_ratio >= 1.0 && depth_ratio <= max_depth_ratio))
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

FoundStag refined(const cv::Mat& image, const Candidate& candidate, const Wanted& wanted) {
    const auto start = homography_to(candidate.corners);
    const StagCode word = wanted.words[static_cast<std::size_t>(candidate.id)];
    const auto corners =
        start ? refine_stag(image, *start, word, candidate.contrast) : std::nullopt;
    const auto again = corners ? read(image, *corners, wanted) : std::nullopt;
    if (!again || again->id != candidate.id || again->quarters != 0)
        return {candidate.id, candidate.corners};
    return {candidate.id, *corners, true};
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
        const auto centre = [](const Quad& quad) -> Eigen::Vector2d {
            return (quad[0] + quad[1] + quad[2] + quad[3]) / 4.0;
        };
        const auto same = std::ranges::find_if(found, [&](const FoundStag& other) {
            return (centre(other.corners) - centre(candidate.corners)).norm() <
                   0.5 * (other.corners[2] - other.corners[0]).norm();
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
