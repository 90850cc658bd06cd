#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "compare/detect/stag/stag_detector.h"
#include "sim/marker/stag_pattern.h"

namespace etalon {
namespace {

constexpr std::size_t references = 12;  // of each shade

// The code points, then the references in the black corners and those on the white border, as far
// from edges as there is room: three of each shade, turned by the four quarters.
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

}  // namespace

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

}  // namespace etalon
