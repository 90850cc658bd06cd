#include "compare/detect/board/saddle_point.h"

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <initializer_list>
#include <numbers>

#include "compare/detect/detector_adaptors.h"
#include "core/optimize/least_squares.h"

namespace etalon {
namespace {

constexpr double sharpest_px = 0.1, min_contrast = 0.02, worst_misfit = 0.25;
constexpr double max_turn = 0.52;  // 30 degrees

// Centre, angles of the edges, log of the blur, then what is linear: brightness, gradient,
// contrast.
using Parameters = Eigen::Matrix<double, 9, 1>;
enum : int { x, y, angle_1, angle_2, log_blur, brightness, gradient_x, gradient_y, contrast };

struct Sample {
    Eigen::Vector2d place;  // from the window's centre, px
    double value, weight;
};

// The pixels of a disk, fading out over its last pixel: every `step`-th and all `beside_edges`.
template <class Function>
std::vector<Sample> window_around(const cv::Mat& pixels, const Eigen::Vector2d& centre,
                                  double radius, int step, Function beside_edges) {
    std::vector<Sample> samples;
    const Eigen::Vector2d last(pixels.cols - 1, pixels.rows - 1);
    if (!(centre.minCoeff() >= radius && (last - centre).minCoeff() >= radius))
        return {};
    const int left = static_cast<int>(std::ceil(centre.x() - radius)),
              top = static_cast<int>(std::ceil(centre.y() - radius));
    const int right = static_cast<int>(std::floor(centre.x() + radius)),
              bottom = static_cast<int>(std::floor(centre.y() + radius));
    for (int row = top; row <= bottom; ++row)
        for (int column = left; column <= right; ++column) {
            const Eigen::Vector2d place = Eigen::Vector2d(column, row) - centre;
            const double weight = std::clamp(radius - place.norm(), 0.0, 1.0);
            const bool is_kept = (row % step == 0 && column % step == 0) || beside_edges(place);
            if (weight > 0.0 && is_kept)
                samples.push_back({place, pixels.at<float>(row, column), weight});
        }
    return samples;
}

// A step blurred by a Gaussian and by the pixel's square, which is a box across the edge.
struct BlurredStep {
    double value, slope, by_blur;  // -1..1; its derivatives by the distance and by the Gaussian
};

BlurredStep blurred_step(double distance, double blur, double box) {
    const double sigma_slope = std::sqrt(2.0 * std::numbers::inv_pi);
    double integral[2], step[2], bell[2];
    for (const int i : {0, 1}) {
        const double end = distance + (i - 0.5) * box;
        step[i] = std::erf(end / blur * std::sqrt(0.5));
        bell[i] = sigma_slope * std::exp(-0.5 * end * end / (blur * blur));
        integral[i] = end * step[i] + blur * bell[i];
    }
    return {(integral[1] - integral[0]) / box, (step[1] - step[0]) / box,
            (bell[1] - bell[0]) / box};
}

struct Modelled {
    double value;
    Parameters gradient;
};

// What the product of two steps from zero lacks where the edges are not square to each other. With
// a = d1 / s1, b = d2 / s2 and r = n1 . n2 the blurred quadrant is the bivariate normal integral,
// whose derivative by the correlation is its density (R. L. Plackett, Biometrika 41, 1954).
struct Skew {
    double value, by[2];  // its derivatives by a and b
};

Skew skew_of(double a, double b, double correlation) {
    // Gauss and Legendre's four places on (0, 1): to 1e-5 up to a correlation of 0.9.
    constexpr std::array<std::array<double, 2>, 4> places{
        {{0.0694318442029737, 0.1739274225687269},
         {0.3300094782075719, 0.3260725774312731},
         {0.6699905217924281, 0.3260725774312731},
         {0.9305681557970263, 0.1739274225687269}}};
    Skew skew{0.0, {0.0, 0.0}};
    for (const auto& [place, weight] : places) {
        const double r = place * correlation, rest = 1.0 - r * r;
        const double density = std::exp(-0.5 * (a * a - 2.0 * r * a * b + b * b) / rest) /
                               (2.0 * std::numbers::pi * std::sqrt(rest));
        const double part = weight * correlation * density;
        skew.value += part;
        skew.by[0] -= part * (a - r * b) / rest;
        skew.by[1] -= part * (b - r * a) / rest;
    }
    return skew;
}

Modelled model(const Parameters& p, const Eigen::Vector2d& place, bool is_lone) {
    const double gaussian = std::exp(p[log_blur]);
    const Eigen::Vector2d from_centre = place - p.head<2>();
    double along[2], by_log_blur[2];
    BlurredStep step[2];
    Eigen::Vector2d normal[2];
    for (const int i : {0, 1}) {
        const double c = std::cos(p[angle_1 + i]), s = std::sin(p[angle_1 + i]);
        const double longer = std::max(std::abs(c), std::abs(s)),
                     shorter = std::min(std::abs(c), std::abs(s));
        const double blur = std::sqrt(gaussian * gaussian + shorter * shorter / 12.0);
        normal[i] = {-s, c};
        along[i] = c * from_centre.x() + s * from_centre.y();
        step[i] = blurred_step(normal[i].dot(from_centre), blur, longer);
        if (is_lone)  // from 0 to 1 in place of -1 to 1: dark in one quadrant only
            step[i] = {0.5 * (1.0 + step[i].value), 0.5 * step[i].slope, 0.5 * step[i].by_blur};
        by_log_blur[i] = step[i].by_blur * gaussian * gaussian / blur;
    }
    double product = step[0].value * step[1].value;
    const double light = 1.0 + p.segment<2>(gradient_x).dot(place), a = light * p[contrast];
    Modelled result;
    result.gradient.setZero();
    if (is_lone) {
        const double blur = std::sqrt(gaussian * gaussian + 1.0 / 12.0);
        const double at[2] = {normal[0].dot(from_centre) / blur, normal[1].dot(from_centre) / blur};
        const Skew skew = skew_of(at[0], at[1], normal[0].dot(normal[1]));
        product += skew.value;
        for (const int i : {0, 1}) {
            const double by = a * skew.by[i] / blur;
            result.gradient.head<2>() -= by * normal[i];
            result.gradient[angle_1 + i] -= by * along[i];
            result.gradient[log_blur] -= by * at[i] * gaussian * gaussian / blur;
        }
    }
    const double pattern = p[brightness] + p[contrast] * product;
    result.value = light * pattern;
    result.gradient.head<2>() += -a * (step[0].slope * step[1].value * normal[0] +
                                       step[0].value * step[1].slope * normal[1]);
    // The change of the box and of the correlation with the angle is left out: LM needs no more.
    result.gradient[angle_1] -= a * step[0].slope * along[0] * step[1].value;
    result.gradient[angle_2] -= a * step[0].value * step[1].slope * along[1];
    result.gradient[log_blur] +=
        a * (by_log_blur[0] * step[1].value + step[0].value * by_log_blur[1]);
    result.gradient[brightness] = light;
    result.gradient[contrast] = light * product;
    result.gradient.segment<2>(gradient_x) = pattern * place;
    return result;
}

using Held = std::initializer_list<int>;

// Rows weighted by the samples' weights; no derivatives by what is held.
ResidualsAndJacobian linearised(const std::vector<Sample>& samples, bool is_lone, const Held& held,
                                const Parameters& p) {
    ResidualsAndJacobian all{Eigen::VectorXd(std::ssize(samples)),
                             Eigen::MatrixXd(std::ssize(samples), 9)};
    for (Eigen::Index i = 0; i < all.residuals.size(); ++i) {
        const Sample& sample = samples[static_cast<std::size_t>(i)];
        const Modelled modelled = model(p, sample.place, is_lone);
        const double weight = std::sqrt(sample.weight);
        all.residuals[i] = weight * (modelled.value - sample.value);
        all.jacobian.row(i) = weight * modelled.gradient.transpose();
    }
    for (const int i : held)
        all.jacobian.col(i).setZero();
    return all;
}

// With some parameters held. Returns the weighted sum of squares.
double fit(const std::vector<Sample>& samples, double radius, bool is_lone, const Held& held,
           Parameters& p, double enough_part) {
    // A step that gains less than 1e-7 moves the crossing by some 1e-5 px.
    const LeastSquaresRule rule{
        {.first_damping = 1e-3, .max_damping = 1e6, .max_tries = 40, .enough_part = enough_part}};
    constexpr double max_step_px = 1.5;
    const auto equations = [&](const Parameters& at) {
        return std::optional(linearised(samples, is_lone, held, at));
    };
    const auto moved = [&](const Parameters& from, const Eigen::VectorXd& step) {
        Parameters next = from + step;
        next[log_blur] = std::clamp(next[log_blur], std::log(sharpest_px), std::log(radius));
        return next.allFinite() && step.head<2>().norm() <= max_step_px ? std::optional(next)
                                                                        : std::nullopt;
    };
    const auto found = least_squares(p, rule, equations, moved);
    p = found->place.unknowns;
    return 2.0 * found->place.loss();
}

// Of a place in the window from the nearer of the two edges, which meet at its centre.
double distance_from_edges(const Parameters& p, const Eigen::Vector2d& place) {
    const auto from = [&](double angle) {
        return std::abs(std::cos(angle) * place.y() - std::sin(angle) * place.x());
    };
    return std::min(from(p[angle_1]), from(p[angle_2]));
}

// Angles such that both steps are positive in the quadrant between the edges.
Parameters start_of(const SaddleGuess& guess) {
    Parameters p = Parameters::Zero();
    const auto angle = [](const Eigen::Vector2d& v) { return std::atan2(v.y(), v.x()); };
    const double turn = cross(guess.edges[0], guess.edges[1]);
    p[angle_1] = angle(turn > 0 ? guess.edges[0] : Eigen::Vector2d(-guess.edges[0]));
    p[angle_2] = angle(turn > 0 ? Eigen::Vector2d(-guess.edges[1]) : guess.edges[1]);
    p[log_blur] = std::log(2.0);
    return p;
}

}  // namespace

double saddle_window_px(double room_px) {
    constexpr double usual = 5.5, least = 2.0;
    const double window = std::min(std::max(usual, room_px / 6.0), 0.8 * room_px);
    return window >= least ? window : 0.0;
}

std::optional<Eigen::Vector2d> refine_saddle(const cv::Mat& pixels, const SaddleGuess& guess) {
    const double radius = saddle_window_px(guess.room_px);
    if (radius == 0.0 || !guess.pixel.allFinite())
        return std::nullopt;
    Eigen::Vector2d centre = guess.pixel;
    const Parameters start = start_of(guess);
    Parameters p = start;
    constexpr int max_windows = 6;
    constexpr double settled_px = 0.05;  // the window fades: its place no longer matters
    constexpr double rough_px = 12.0;
    const int step = std::max(1, static_cast<int>(std::lround(radius / rough_px)));
    bool is_rough = step > 1;
    for (int i = 0; i < max_windows; ++i) {
        const double enough = is_rough ? 1e-4 : 1e-7;
        const std::vector<Sample> samples =
            window_around(pixels, centre, radius, step, [&](const Eigen::Vector2d& place) {
                return !is_rough &&
                       distance_from_edges(p, place) < 3.0 * std::exp(p[log_blur]) + 2.0;
            });
        if (samples.empty())
            return std::nullopt;
        p.head<2>().setZero();
        if (i == 0) {
            // Levels from the darkest and the brightest pixel. A guess some pixels off is met by a
            // wide blur first, the rest as it was guessed.
            const auto [dark, bright] = std::ranges::minmax(samples, {}, &Sample::value);
            p[brightness] = guess.is_lone ? bright.value : 0.5 * (bright.value + dark.value);
            p[contrast] = (guess.is_lone ? -1.0 : -0.5) * (bright.value - dark.value);
            fit(samples, radius, guess.is_lone, {angle_1, angle_2, gradient_x, gradient_y}, p,
                enough);
        }
        const double cost = fit(samples, radius, guess.is_lone, {}, p, enough);
        double weights = 0.0;
        for (const Sample& sample : samples)
            weights += sample.weight;
        const Eigen::Vector2d shift = p.head<2>();
        if (!p.allFinite() || (centre + shift - guess.pixel).norm() > 0.5 * guess.room_px)
            return std::nullopt;
        centre += shift;
        if (shift.norm() > settled_px)
            continue;
        if (std::exchange(is_rough, false))
            continue;
        const bool is_crossing =
            p[contrast] <= -min_contrast &&
            std::sqrt(cost / weights) <= worst_misfit * std::abs(p[contrast]) &&
            std::abs(p[angle_1] - start[angle_1]) < max_turn &&
            std::abs(p[angle_2] - start[angle_2]) < max_turn;
        return is_crossing ? std::optional(centre) : std::nullopt;
    }
    return std::nullopt;
}

}  // namespace etalon
