#include "compare/characterise/slanted_edge.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <Eigen/Dense>
#include <algorithm>
#include <complex>
#include <numbers>

#include "compare/edges/edge_fit.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Eigen::ArrayXd;
using std::numbers::pi;

constexpr double edge_bin_px = 0.25;
constexpr int min_side_px = 16;
constexpr double min_half_width_px = 7.0;

// Flat over the middle half, then a cosine to zero at +-1.
double tukey(double position) {
    const double u = std::abs(position);
    if (u >= 1.0)
        return 0.0;
    return u <= 0.5 ? 1.0 : 0.5 + 0.5 * std::cos(2.0 * pi * (u - 0.5));
}

// One side of the edge, well away from it: a plane's level at the edge, and the scatter about it.
struct Level {
    double level, noise;
};

Level side_level(std::span<const EdgePixel> samples, double sign, double half_width) {
    std::vector<const EdgePixel*> side;
    for (const EdgePixel& sample : samples)
        if (sign * sample.distance_px > 0.6 * half_width)
            side.push_back(&sample);
    constexpr std::size_t min_pixels = 20;
    if (side.size() < min_pixels)
        throw NumericalError(fmt::format("slanted edge: {} pixels beside it", side.size()));
    const auto n = static_cast<Eigen::Index>(side.size());
    Eigen::MatrixXd design(n, 3);
    Eigen::VectorXd values(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const EdgePixel& sample = *side[static_cast<std::size_t>(i)];
        design.row(i) << 1.0, sample.distance_px - sign * 0.8 * half_width, sample.along_px;
        values[i] = sample.radiance;
    }
    const Eigen::VectorXd plane = design.colPivHouseholderQr().solve(values);
    const double squares = (values - design * plane).squaredNorm();
    return {plane[0], std::sqrt(squares / static_cast<double>(n - 3))};
}

// The edge spread in bins of a quarter pixel: means of radiance and of place within the bin.
struct Bins {
    ArrayXd mean, offset, count;
    double half_width;            // of the edge spread, px
    std::vector<double> offsets;  // of the pixels near the edge, from their bin's mean place
    double centre(Eigen::Index i) const {
        return (static_cast<double>(i) + 0.5) * edge_bin_px - half_width;
    }
};

Bins bins_of(std::span<const EdgePixel> samples, double half_width) {
    const auto n = static_cast<Eigen::Index>(std::floor(2.0 * half_width / edge_bin_px));
    Bins bins{ArrayXd::Zero(n),
              ArrayXd::Zero(n),
              ArrayXd::Zero(n),
              0.5 * edge_bin_px * static_cast<double>(n),
              {}};
    const auto index_of = [&](const EdgePixel& sample) {
        return static_cast<Eigen::Index>(
            std::floor((sample.distance_px + bins.half_width) / edge_bin_px));
    };
    for (const EdgePixel& sample : samples)
        if (const Eigen::Index i = index_of(sample); i >= 0 && i < n) {
            bins.mean[i] += sample.radiance;
            bins.offset[i] += sample.distance_px - bins.centre(i);
            bins.count[i] += 1.0;
        }
    for (Eigen::Index i = 0; i < n; ++i)
        if (bins.count[i] == 0.0)
            throw NumericalError(fmt::format(
                "slanted edge: no pixel at {:.2f} px from it: too short, or along the pixels",
                bins.centre(i)));
    bins.mean /= bins.count;
    bins.offset /= bins.count;
    constexpr double near_px = 2.0;
    for (const EdgePixel& sample : samples)
        if (const Eigen::Index i = index_of(sample);
            i >= 0 && i < n && std::abs(sample.distance_px) < near_px)
            bins.offsets.push_back(sample.distance_px - bins.centre(i) - bins.offset[i]);
    return bins;
}

// (row[i + 1] - row[i - 1]) / 2 bins; zero at both ends. And its transpose.
ArrayXd difference(const ArrayXd& row) {
    const Eigen::Index n = row.size();
    ArrayXd result = ArrayXd::Zero(n);
    result.segment(1, n - 2) = (row.tail(n - 2) - row.head(n - 2)) / (2.0 * edge_bin_px);
    return result;
}

ArrayXd transposed_difference(const ArrayXd& row) {
    const Eigen::Index n = row.size();
    ArrayXd result = ArrayXd::Zero(n);
    result.tail(n - 2) += row.segment(1, n - 2) / (2.0 * edge_bin_px);
    result.head(n - 2) -= row.segment(1, n - 2) / (2.0 * edge_bin_px);
    return result;
}

// The transform at each frequency and its derivative by the bins' means.
class Transform {
public:
    // Each bin's mean is moved to the bin's centre along the slope of its neighbours.
    Transform(const Bins& bins, const ArrayXd& variance) : bins_(bins), variance_(variance) {
        line_spread_ = difference(bins.mean - bins.offset * difference(bins.mean));
        window_.resize(line_spread_.size());
        for (Eigen::Index i = 0; i < window_.size(); ++i)
            window_[i] = tukey(bins.centre(i) / bins.half_width);
        total_ = (window_ * line_spread_).sum();
    }

    ModulationRow at(double frequency) const {
        std::complex<double> sum = 0.0;
        std::vector<std::complex<double>> turn;
        for (Eigen::Index i = 0; i < window_.size(); ++i) {
            turn.push_back(std::polar(window_[i], -2.0 * pi * frequency * bins_.centre(i)));
            sum += turn.back() * line_spread_[i];
        }
        const double size = std::abs(sum), loss = processing_transfer(frequency) * total_;
        const std::complex<double> direction = size > 0.0 ? std::conj(sum) / size : 1.0;
        ArrayXd by_spread(window_.size());
        for (Eigen::Index i = 0; i < window_.size(); ++i)
            by_spread[i] = ((turn[static_cast<std::size_t>(i)] * direction).real() -
                            size / total_ * window_[i]) /
                           loss;
        const ArrayXd moved = transposed_difference(by_spread);
        const ArrayXd by_mean = moved - transposed_difference(bins_.offset * moved);
        return {frequency, size / loss, std::sqrt((by_mean.square() * variance_).sum())};
    }

private:
    // What the two-sided difference and the average over a bin leave of this frequency.
    double processing_transfer(double frequency) const {
        const double q = 2.0 * pi * frequency * edge_bin_px;
        const double slope = q < 1e-9 ? 1.0 : std::sin(q) / q;
        std::complex<double> sum = 0.0;
        for (const double offset : bins_.offsets)
            sum += std::polar(1.0, -2.0 * pi * frequency * offset);
        return slope * std::abs(sum) / static_cast<double>(bins_.offsets.size());
    }

    const Bins& bins_;
    const ArrayXd& variance_;
    ArrayXd line_spread_, window_;
    double total_;
};

// Where the modulation first falls to one half, between two rows.
void find_half(SlantedEdge& edge) {
    for (std::size_t i = 1; i < edge.modulation.size(); ++i) {
        const ModulationRow &a = edge.modulation[i - 1], &b = edge.modulation[i];
        if (b.modulation > 0.5)
            continue;
        const double slope = (b.modulation - a.modulation) / (b.cycles_per_px - a.cycles_per_px);
        edge.mtf50_cycles_per_px = a.cycles_per_px + (0.5 - a.modulation) / slope;
        edge.mtf50_standard_uncertainty =
            std::max(a.standard_uncertainty, b.standard_uncertainty) / std::abs(slope);
        return;
    }
}

void transform(std::span<const EdgePixel> samples, double half_width, SlantedEdge& edge) {
    const Level dark = side_level(samples, -1.0, half_width);
    const Level light = side_level(samples, 1.0, half_width);
    constexpr double min_contrast_in_noise = 5.0;
    if (!(light.level - dark.level > min_contrast_in_noise * std::max(light.noise, dark.noise)))
        throw NumericalError(
            fmt::format("slanted edge: levels {:.4f} and {:.4f} with noise {:.4f} and {:.4f}",
                        dark.level, light.level, dark.noise, light.noise));
    const Bins bins = bins_of(samples, half_width);
    const ArrayXd part = ((bins.mean - dark.level) / (light.level - dark.level)).max(0.0).min(1.0);
    const ArrayXd variance =
        (dark.noise * dark.noise * (1.0 - part) + light.noise * light.noise * part) / bins.count;
    const Transform at(bins, variance);
    edge.dark = dark.level;
    edge.light = light.level;
    edge.pixels = static_cast<int>(bins.count.sum());
    const double step = 1.0 / (2.0 * bins.half_width);
    for (int k = 0; k * step <= 1.0; ++k)
        edge.modulation.push_back(at.at(k * step));
    find_half(edge);
    const ModulationRow nyquist = at.at(0.5);
    edge.at_nyquist = nyquist.modulation;
    edge.at_nyquist_standard_uncertainty = nyquist.standard_uncertainty;
}

// The rectangle turned so that the edge runs down it, light on the right.
Eigen::MatrixXd upright(const LinearPhoto& photo, const cv::Rect& region) {
    const cv::Rect image({0, 0}, photo.radiance.size());
    if (region.width < min_side_px || region.height < min_side_px || (region & image) != region)
        throw NumericalError(fmt::format("slanted edge: no region {} x {} px at ({}, {})",
                                         region.width, region.height, region.x, region.y));
    if (cv::countNonZero(photo.clipped(region)) > 0)
        throw NumericalError("slanted edge: the region holds clipped pixels");
    Eigen::MatrixXd pixels(region.height, region.width);
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x)
            pixels(y, x) = photo.radiance.at<float>(region.y + y, region.x + x);
    if (!pixels.allFinite())
        throw NumericalError("slanted edge: the region is not finite");
    const Eigen::Index h = pixels.rows(), w = pixels.cols();
    const double across = (pixels.rightCols(w / 3).mean() - pixels.leftCols(w / 3).mean());
    const double down = (pixels.bottomRows(h / 3).mean() - pixels.topRows(h / 3).mean());
    if (std::abs(down) > std::abs(across))
        pixels = pixels.transpose().eval();
    if ((std::abs(down) > std::abs(across) ? down : across) < 0.0)
        pixels = pixels.rowwise().reverse().eval();
    return pixels;
}

struct Line {  // x = at_middle + slope (y - middle)
    double at_middle, slope;
};

// Centroid of a row's derivative under a window about `centre`.
double centroid(const Eigen::MatrixXd& pixels, Eigen::Index y, double centre, double half_width) {
    double sum = 0.0, moment = 0.0;
    for (Eigen::Index x = 1; x + 1 < pixels.cols(); ++x) {
        const double slope = 0.5 * (pixels(y, x + 1) - pixels(y, x - 1)) *
                             tukey((static_cast<double>(x) - centre) / half_width);
        sum += slope;
        moment += slope * (static_cast<double>(x) - centre);
    }
    return sum > 0.0 ? centre + std::clamp(moment / sum, -half_width, half_width) : centre;
}

// The standard's two rounds, and a third, narrower one against the far pixels' noise.
Line find_line(const Eigen::MatrixXd& pixels) {
    const auto w = static_cast<double>(pixels.cols());
    Line line{0.5 * (w - 1.0), 0.0};
    const double middle = 0.5 * (static_cast<double>(pixels.rows()) - 1.0);
    const ArrayXd rows = ArrayXd::LinSpaced(pixels.rows(), -middle, middle);
    for (const double half_width : {0.75 * w, 0.5 * w, std::min(0.5 * w, 10.0)}) {
        ArrayXd places(pixels.rows());
        for (Eigen::Index y = 0; y < pixels.rows(); ++y)
            places[y] =
                centroid(pixels, y, line.at_middle + line.slope * (static_cast<double>(y) - middle),
                         half_width);
        line = {places.mean(), (rows * places).sum() / rows.square().sum()};
    }
    return line;
}

}  // namespace

SlantedEdge slanted_edge(const LinearPhoto& photo, const cv::Rect& region) {
    const Eigen::MatrixXd pixels = upright(photo, region);
    const Line line = find_line(pixels);
    const double cosine = 1.0 / std::hypot(1.0, line.slope);
    SlantedEdge edge;
    edge.angle_deg = std::atan(std::abs(line.slope)) * (180.0 / pi);
    if (!(edge.angle_deg >= 1.0 && edge.angle_deg <= 44.0))
        throw NumericalError(
            fmt::format("slanted edge: {:.2f} degrees from the pixels' axis, 1 to 44 are needed",
                        edge.angle_deg));
    // Rows for a whole number of pixels that the edge moves: every sub-pixel place counts alike.
    const double steepness = std::abs(line.slope);
    const double moved = std::floor(static_cast<double>(pixels.rows()) * steepness);
    const Eigen::Index rows =
        moved < 1.0 ? pixels.rows()
                    : std::min<Eigen::Index>(pixels.rows(), std::lround(moved / steepness));
    const double middle = 0.5 * (static_cast<double>(pixels.rows()) - 1.0);
    double half_width = 0.5 * static_cast<double>(pixels.cols());
    std::vector<EdgePixel> samples;
    for (Eigen::Index y = 0; y < rows; ++y) {
        const double at = line.at_middle + line.slope * (static_cast<double>(y) - middle);
        half_width = std::min(
            {half_width, cosine * at, cosine * (static_cast<double>(pixels.cols()) - 1.0 - at)});
        for (Eigen::Index x = 0; x < pixels.cols(); ++x)
            samples.push_back({cosine * (static_cast<double>(x) - at),
                               static_cast<double>(y) - middle, pixels(y, x)});
    }
    if (half_width < min_half_width_px)
        throw NumericalError(fmt::format(
            "slanted edge: it comes within {:.1f} px of the region's side", half_width));
    std::erase_if(samples,
                  [&](const EdgePixel& s) { return std::abs(s.distance_px) > half_width; });
    transform(samples, half_width, edge);
    return edge;
}

SlantedEdge slanted_edge(const StraightEdge& edge) {
    const EdgeFit fit = fit_edges({&edge, 1}, gaussian_blur());
    const FittedEdge& own = fit.edges.front();
    double half_width[2] = {};
    std::vector<EdgePixel> samples;
    for (const EdgePixel& pixel : edge.pixels) {
        const double distance = own.place_px(pixel);
        samples.push_back({distance, pixel.along_px, pixel.radiance});
        double& half = half_width[distance > 0.0];
        half = std::max(half, std::abs(distance));
    }
    const double half = std::min(half_width[0], half_width[1]) - 0.5;
    if (half < min_half_width_px)
        throw NumericalError(fmt::format("slanted edge: the band reaches {:.1f} px from it", half));
    std::erase_if(samples, [&](const EdgePixel& s) { return std::abs(s.distance_px) > half; });
    SlantedEdge result;
    const double angle = std::atan2(std::abs(edge.normal.y()), std::abs(edge.normal.x()));
    result.angle_deg = std::min(angle, 0.5 * pi - angle) * 180.0 / pi;
    transform(samples, half, result);
    return result;
}

namespace {

constexpr double min_angle_deg = 2.0, max_angle_deg = 15.0;
constexpr double min_length_px = 24.0;

struct Segment {
    cv::Point2d from, to;  // px

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

// In the width in which its MTF50 is most certain: other things in the window count as noise.
std::optional<FoundSlantedEdge> measured(const LinearPhoto& photo, const Segment& segment,
                                         std::string& reason) {
    // Another edge in the window would turn the line, or leave a spectrum that is mostly noise.
    constexpr double max_turn_deg = 1.5, max_nyquist_deviation = 0.05;
    std::optional<FoundSlantedEdge> best;
    for (const double side : {10.0, 14.0, 20.0, 28.0, 40.0}) {
        const cv::Rect region = window_of(segment, side);
        auto edge = attempted([&] { return slanted_edge(photo, region); });
        if (edge && edge->mtf50_cycles_per_px > 0.0 &&
            std::abs(edge->angle_deg - segment.angle_deg()) < max_turn_deg &&
            edge->at_nyquist_standard_uncertainty < max_nyquist_deviation &&
            (!best || edge->mtf50_standard_uncertainty < best->edge.mtf50_standard_uncertainty))
            best = FoundSlantedEdge{region, *edge};
        if (!best && reason.empty())
            reason = edge.cause;
    }
    return best;
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
    const auto middle_of = [](const cv::Rect& region) { return (region.tl() + region.br()) / 2; };
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
