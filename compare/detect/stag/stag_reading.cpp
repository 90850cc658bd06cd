#include "compare/detect/stag/stag_reading.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "sim/marker/stag_pattern.h"

namespace etalon {
namespace {

constexpr std::size_t references = 12;  // of each shade

// Turns three points by the four quarters about the centre.
std::array<Eigen::Vector2d, references> all_around(const std::array<Eigen::Vector2d, 3>& points) {
    std::array<Eigen::Vector2d, references> turned;
    for (std::size_t quarter = 0; quarter < 4; ++quarter)
        for (std::size_t i = 0; i < points.size(); ++i) {
            Eigen::Vector2d point = points[i];
            for (std::size_t turn = 0; turn < quarter; ++turn)
                point = {-point.y(), point.x()};
            turned[3 * quarter + i] = point;
        }
    return turned;
}

// In the black corners and on the white border, as far from edges as there is room.
const std::array<Eigen::Vector2d, references>& black_points() {
    static const auto points =
        all_around({Eigen::Vector2d(-0.365, -0.455), {-0.41, -0.41}, {-0.455, -0.365}});
    return points;
}

const std::array<Eigen::Vector2d, references>& white_points() {
    constexpr double middle = -0.5 - stag_border / 2.0;
    static const auto points =
        all_around({Eigen::Vector2d(-0.25, middle), {0.0, middle}, {0.25, middle}});
    return points;
}

// Bilinear values at points of the marker.
template <std::size_t count>
bool sample(const cv::Mat& image, const Homography& image_from_marker,
            const std::array<Eigen::Vector2d, count>& points, std::vector<double>& values) {
    for (const Eigen::Vector2d& point : points) {
        const auto value = bilinear(image, (image_from_marker * point.homogeneous()).hnormalized());
        if (!value)
            return false;
        values.push_back(*value);
    }
    return true;
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

}  // namespace

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

double depth_ratio(const Homography& image_from_marker) {
    const Eigen::Vector2d slope = image_from_marker.row(2).head<2>();
    const double reach = 0.5 * slope.lpNorm<1>();
    return (1.0 + reach) / (1.0 - reach);
}

std::optional<StagReading> read_stag_code(const cv::Mat& image,
                                          const Homography& image_from_marker) {
    std::vector<double> values;
    if (!sample(image, image_from_marker, stag_code_points(), values) ||
        !sample(image, image_from_marker, black_points(), values) ||
        !sample(image, image_from_marker, white_points(), values))
        return std::nullopt;
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

StagMatch match_stag_code(StagCode seen, StagCode word) {
    StagMatch best{stag_bits + 1, 0};
    for (int quarters = 0; quarters < 4; ++quarters) {
        const int wrong = hamming_distance(seen, turned_stag_code(word, quarters));
        if (wrong < best.wrong_bits)
            best = {wrong, quarters};
    }
    return best;
}

}  // namespace etalon
