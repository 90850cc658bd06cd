#include "sim/sensor/line_blur.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "sim/tiles/tile_map.h"

namespace etalon {
namespace {

// The pixels at +- `at` count with this weight each.
struct Tap {
    cv::Point at;
    float weight;
};

double keys_weight(double distance) {
    const double t = std::abs(distance);
    if (t < 1.0)
        return (1.5 * t - 2.5) * t * t + 1.0;
    return t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0 : 0.0;
}

// Where the line (from -1/2 to 1/2 of the motion) passes from one polynomial to the next, and its
// ends.
std::vector<double> pieces(const Eigen::Vector2d& motion_px) {
    std::vector<double> ends{-0.5, 0.5};
    for (const double length : {std::abs(motion_px.x()), std::abs(motion_px.y())})
        for (int n = 0; n < 0.5 * length; ++n) {
            ends.push_back(n / length);
            ends.push_back(-n / length);
        }
    std::sort(ends.begin(), ends.end());
    return ends;
}

cv::Point reach_of(const Eigen::Vector2d& motion_px) {
    return {static_cast<int>(std::ceil(0.5 * std::abs(motion_px.x()))) + 2,
            static_cast<int>(std::ceil(0.5 * std::abs(motion_px.y()))) + 2};
}

// Adds a point's interpolation weights.
void add_point(const Eigen::Vector2d& point, double weight, const cv::Point& middle,
               cv::Mat_<double>& kernel) {
    const int left = static_cast<int>(std::floor(point.x())) - 1;
    const int top = static_cast<int>(std::floor(point.y())) - 1;
    for (int y = top; y < top + 4; ++y)
        for (int x = left; x < left + 4; ++x)
            kernel(middle.y + y, middle.x + x) +=
                weight * keys_weight(point.x() - x) * keys_weight(point.y() - y);
}

// Gauss and Legendre's four points are exact for the degree 6 of a product of two cubics.
cv::Mat_<double> line_kernel(const Eigen::Vector2d& motion_px) {
    constexpr std::array<std::pair<double, double>, 4> gauss{
        {{-0.8611363115940526, 0.3478548451374538},
         {-0.3399810435848563, 0.6521451548625461},
         {0.3399810435848563, 0.6521451548625461},
         {0.8611363115940526, 0.3478548451374538}}};
    const cv::Point reach = reach_of(motion_px);
    cv::Mat_<double> kernel = cv::Mat_<double>::zeros(2 * reach.y + 1, 2 * reach.x + 1);
    const std::vector<double> ends = pieces(motion_px);
    for (std::size_t i = 1; i < ends.size(); ++i) {
        const double half = 0.5 * (ends[i] - ends[i - 1]), middle = 0.5 * (ends[i] + ends[i - 1]);
        if (half > 0.0)
            for (const auto& [node, weight] : gauss)
                add_point((middle + half * node) * motion_px, half * weight, reach, kernel);
    }
    return kernel;
}

// One of each pair: a line is its own mirror image. The middle's weight is what they leave of 1.
std::vector<Tap> line_taps(const Eigen::Vector2d& motion_px) {
    const cv::Mat_<double> kernel = line_kernel(motion_px);
    const cv::Point reach = reach_of(motion_px);
    std::vector<Tap> taps;
    for (int y = 0; y <= reach.y; ++y)
        for (int x = y == 0 ? 1 : -reach.x; x <= reach.x; ++x)
            if (const auto weight = static_cast<float>(kernel(reach.y + y, reach.x + x));
                weight != 0.0f)
                taps.push_back({{x, y}, weight});
    return taps;
}

// The smallest rectangle outside of which all pixels are equal.
cv::Rect uneven_part(const Radiance& radiance) {
    cv::Mat differs;
    cv::compare(radiance, radiance.at<float>(0, 0), differs, cv::CMP_NE);
    return cv::boundingRect(differs);
}

// As differences from the middle pixel, so that what is even stays so to the last bit.
void add_tap(const Tap& tap, const float* middle, std::ptrdiff_t row, int count, float* to) {
    const std::ptrdiff_t offset = tap.at.y * row + tap.at.x;
    const float *ahead = middle + offset, *behind = middle - offset;
    for (int x = 0; x < count; ++x)
        to[x] += tap.weight * ((ahead[x] - middle[x]) + (behind[x] - middle[x]));
}

}  // namespace

Radiance line_blurred(const Radiance& radiance, const Eigen::Vector2d& motion_px) {
    if (radiance.empty() || motion_px.isZero(0.0))
        return radiance;
    const cv::Rect uneven = uneven_part(radiance);
    Radiance result = radiance.clone();
    if (uneven.empty())
        return result;
    const std::vector<Tap> taps = line_taps(motion_px);
    const cv::Point reach = reach_of(motion_px);
    const cv::Rect part = grown(uneven, reach.x, reach.y) & cv::Rect({0, 0}, radiance.size());
    cv::Mat bordered;
    cv::copyMakeBorder(radiance, bordered, reach.y, reach.y, reach.x, reach.x,
                       cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    for (int y = part.y; y < part.br().y; ++y)
        for (const Tap& tap : taps)
            add_tap(tap, bordered.ptr<float>(y + reach.y) + part.x + reach.x,
                    static_cast<std::ptrdiff_t>(bordered.step1()), part.width,
                    result.ptr<float>(y) + part.x);
    return result;
}

}  // namespace etalon
