#include "compare/diagnosis/image_agreement.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/statistics/covariance.h"

namespace etalon {
namespace {

constexpr double k = pixel_coverage_factor;
constexpr double render_tolerance_gray = 0.1;  // compare/photometric/photometric_equations.h

struct PixelEstimate {
    PixelDeviation value = PixelDeviation::Zero();
    PixelInformation covariance = PixelInformation::Zero();  // rows of 0: not asked for
    std::vector<int> asked;
};

// A factor of the formal covariance: the photographs' scatter in units of it, and what a render
// that is off by its tolerance may add.
double widening(const RunEvidence& pixels, const PixelDeviation& step,
                const std::vector<int>& asked) {
    double scatter = 0.0, noise_squares = 0.0, count = 0.0;
    for (const PhotoEvidence& photo : pixels.photos) {
        const Eigen::MatrixXd information = photo.information(asked, asked);
        const Eigen::VectorXd left =
            Eigen::VectorXd(photo.score(asked)) - information * Eigen::VectorXd(step(asked));
        if (const auto covariance = covariance_from_information(information))
            scatter += left.dot(*covariance * left) / static_cast<double>(asked.size());
        noise_squares += photo.noise_gray * photo.noise_gray;
        count += photo.pixels;
    }
    const auto photos = static_cast<double>(pixels.photos.size());
    if (!(noise_squares > 0.0))
        return std::max(1.0, scatter / photos);
    const double tolerance = render_tolerance_gray * render_tolerance_gray * photos / noise_squares;
    return std::max(1.0, scatter / photos) + tolerance * count / photos;
}

// Standard deviation by renders that are all off by their tolerance where a deviation changes most,
// by c: a photograph weighs by c^2 and errs by tolerance / c.
double of_renders(const std::vector<PhotoEvidence>& photos, int i) {
    constexpr double full_scale_gray = 255.0;
    double sum = 0.0, squares = 0.0;
    for (const PhotoEvidence& photo : photos) {
        sum += photo.largest_change[i];
        squares += photo.largest_change[i] * photo.largest_change[i];
    }
    return squares > 0.0 ? render_tolerance_gray / full_scale_gray * sum / squares : 0.0;
}

// Of a curve only the bow t is fitted, not how it leans, q s (1 - s) (1 - 2 s): of powers from 0.45
// to 2.2 and Rec. 709 q / t is -0.1 to 0.9. An edge of variance sigma^2 then looks wider by
// 0.70 q sigma^2 (least squares). The score of photographs blurrier by that, at q / t = 0.9.
PixelDeviation score_of_leaning_curve(const RunEvidence& pixels, const CameraModel& camera,
                                      const PixelDeviation& deviating) {
    constexpr double leaning = 0.9, variance_by_leaning = 0.70;
    PixelDeviation score = PixelDeviation::Zero();
    for (const PhotoEvidence& photo : pixels.photos)
        score += photo.information.col(deviation::blur) * variance_by_leaning * leaning *
                 deviating[deviation::tone] *
                 std::pow(blur_sigma_px(camera, photo.depth_mm, deviating), 2);
    return score;
}

// One step of Newton's from where the photographs were compared: linear to 2 % of a step, and mean
// codes follow the stated noise, which may be 10 % off.
PixelEstimate estimate_of(const RunEvidence& pixels, const CameraModel& camera) {
    constexpr double curved = 0.02, noise_known = 0.1;
    PixelEstimate estimate;
    PixelInformation information = deviation_prior();
    PixelDeviation score = -information * pixels.at, step = PixelDeviation::Zero(),
                   by_log_noise = PixelDeviation::Zero();
    for (const PhotoEvidence& photo : pixels.photos) {
        information += photo.information;
        score += photo.score;
        by_log_noise += photo.score_by_log_noise;
    }
    for (int i = 0; i < deviation::count; ++i)
        if (pixels.asked[static_cast<std::size_t>(i)])
            estimate.asked.push_back(i);
    const std::vector<int>& asked = estimate.asked;
    const Eigen::MatrixXd inverse = Eigen::MatrixXd(information(asked, asked)).inverse();
    step(asked) = inverse * Eigen::VectorXd(score(asked));
    estimate.value = pixels.at + step;
    const Eigen::VectorXd of_noise = noise_known * inverse * Eigen::VectorXd(by_log_noise(asked));
    const Eigen::VectorXd of_curve =
        inverse * Eigen::VectorXd(score_of_leaning_curve(pixels, camera, estimate.value)(asked));
    estimate.covariance(asked, asked) = inverse * widening(pixels, step, asked) +
                                        of_noise * of_noise.transpose() +
                                        of_curve * of_curve.transpose();
    for (const int i : asked)
        estimate.covariance(i, i) +=
            std::pow(curved * estimate.value[i], 2) + std::pow(of_renders(pixels.photos, i), 2);
    return estimate;
}

// The deviations that are needed, the others being 0, with their covariance: each must be worth
// k^2 of chi-square.
PixelEstimate needed(const PixelEstimate& all) {
    PixelEstimate best;
    double best_cost = std::numeric_limits<double>::infinity();
    const std::size_t n = all.asked.size();
    for (unsigned set = 0; set < (1U << n); ++set) {
        std::vector<int> in, out;
        for (std::size_t i = 0; i < n; ++i)
            (set >> i & 1U ? in : out).push_back(all.asked[i]);
        const Eigen::MatrixXd among = all.covariance(out, out), across = all.covariance(in, out);
        const Eigen::VectorXd dropped = all.value(out);
        const Eigen::LDLT<Eigen::MatrixXd> solver(among);
        const Eigen::VectorXd solved = solver.solve(dropped);
        const double cost = dropped.dot(solved) + k * k * static_cast<double>(in.size());
        if (cost >= best_cost)
            continue;
        best_cost = cost;
        best = {};
        best.asked = in;
        best.value(in) = Eigen::VectorXd(all.value(in)) - across * solved;
        best.covariance(in, in) = Eigen::MatrixXd(all.covariance(in, in)) -
                                  across * solver.solve(Eigen::MatrixXd(across.transpose()));
    }
    return best;
}

PixelFigure figure_of(const PixelEstimate& estimate, int i, double unit = 1.0) {
    return {unit * estimate.value[i], unit * k * std::sqrt(estimate.covariance(i, i))};
}

double mean_contrast(const std::vector<PhotoEvidence>& photos) {
    double sum = 0.0;
    for (const PhotoEvidence& photo : photos)
        sum += photo.contrast_gray;
    return sum / static_cast<double>(photos.size());
}

// RMS over the photographs of how much wider or sharper edges are; what noise makes of it is taken
// off. The sign is that of the mean.
PixelFigure blur_of(const RunEvidence& pixels, const PixelEstimate& estimate,
                    const CameraModel& camera) {
    constexpr double part = 1e-3;  // of a standard deviation, for differences
    double squares = 0.0, noise = 0.0, mean = 0.0;
    for (const PhotoEvidence& photo : pixels.photos) {
        const double there = blur_sigma_px(camera, photo.depth_mm, estimate.value);
        const double wider = there - blur_sigma_px(camera, photo.depth_mm);
        PixelDeviation slope = PixelDeviation::Zero();
        for (const int i : {deviation::f_number, deviation::inverse_focus, deviation::blur}) {
            const double step = part * std::sqrt(estimate.covariance(i, i));
            PixelDeviation more = estimate.value;
            more[i] += step;
            if (step > 0.0)
                slope[i] = (blur_sigma_px(camera, photo.depth_mm, more) - there) / step;
        }
        squares += wider * wider;
        noise += slope.dot(estimate.covariance * slope);
        mean += wider;
    }
    const auto n = static_cast<double>(pixels.photos.size());
    return {std::copysign(std::sqrt(std::max(0.0, (squares - noise) / n)), mean),
            k * std::sqrt(noise / n)};
}

// How far the residuals are above the noise that the camera's file states.
std::optional<PixelFigure> residual_of(const RunEvidence& pixels) {
    double squares = 0.0, noise_squares = 0.0, count = 0.0;
    for (const PhotoEvidence& photo : pixels.photos) {
        if (!photo.noise_ratio)
            continue;
        squares += photo.squares;
        noise_squares += photo.noise_gray * photo.noise_gray * photo.pixels;
        count += photo.pixels;
    }
    if (count == 0.0)
        return std::nullopt;
    const double noise = std::sqrt(noise_squares / count), ratio = std::sqrt(squares / count);
    const double of_render = std::hypot(noise, render_tolerance_gray) - noise;
    return PixelFigure{noise * (ratio - 1.0),
                       k * noise * ratio / std::sqrt(2.0 * count) + of_render};
}

// Mean over those that have one, with the uncertainty that their scatter gives it, and `floor`
// (standard) besides.
template <class Of>
std::optional<PixelFigure> mean_figure(const std::vector<PhotoEvidence>& photos, double floor,
                                       const Of& of) {
    std::vector<double> values;
    for (const PhotoEvidence& photo : photos)
        if (const std::optional<double> value = of(photo))
            values.push_back(*value);
    if (values.size() < min_compared_photos)
        return std::nullopt;
    const auto found = Eigen::Map<const Eigen::ArrayXd>(values.data(), std::ssize(values));
    const auto n = static_cast<double>(values.size());
    const double variance = (found - found.mean()).square().sum() / (n - 1.0) / n;
    return PixelFigure{found.mean(), k * std::hypot(std::sqrt(variance), floor)};
}

// Of what is beside the marker, where it is as bright as stated: freed of the tone that was found.
std::optional<PixelFigure> background_of(const RunEvidence& pixels, const PixelEstimate& estimate,
                                         double floor) {
    const double tone = estimate.value[deviation::tone] - pixels.at[deviation::tone];
    auto figure = mean_figure(pixels.photos, floor, [&](const PhotoEvidence& photo) {
        return photo.background_gray
                   ? std::optional(*photo.background_gray - tone * photo.background_by_tone_gray)
                   : std::nullopt;
    });
    if (!figure)
        return std::nullopt;
    double by_tone = 0.0;
    for (const PhotoEvidence& photo : pixels.photos)
        by_tone += photo.background_by_tone_gray / static_cast<double>(pixels.photos.size());
    const double of_tone =
        by_tone * std::sqrt(estimate.covariance(deviation::tone, deviation::tone));
    figure->expanded_uncertainty = std::hypot(figure->expanded_uncertainty, k * of_tone);
    return figure;
}

PixelFigure shading_of(const std::vector<PhotoEvidence>& photos) {
    constexpr double floor_percent = 0.2, percent = 100.0;
    const auto along = [&](int axis) {
        return *mean_figure(photos, floor_percent, [&](const PhotoEvidence& photo) {
            return std::optional(percent * photo.shading[axis]);
        });
    };
    const PixelFigure x = along(0), y = along(1);
    return {std::hypot(x.value, y.value), std::max(x.expanded_uncertainty, y.expanded_uncertainty)};
}

// With two digits of the uncertainty.
std::string plus_minus(double value, double u, const std::string& unit) {
    const int decimals =
        u > 0.0 ? std::clamp(1 - static_cast<int>(std::floor(std::log10(u))), 0, 6) : 3;
    return fmt::format("{:.{}f} +- {:.{}f}{}", value, decimals, u, decimals,
                       unit.empty() ? "" : " " + unit);
}

std::string distance_words(double inverse, double u) {
    const double distance = 1.0 / inverse;
    if (inverse > u)
        return plus_minus(distance, u * distance * distance, "mm");
    return inverse + u > 0.0 ? fmt::format("{:.0f} mm or farther", 1.0 / (inverse + u))
                             : std::string("infinity");
}

// A tone that is far off takes blur, levels and noise with it: then they say nothing of their own.
bool is_tone_far(const PixelEstimate& estimate) {
    constexpr double far = 0.1;
    return std::abs(estimate.value[deviation::tone]) > far;
}

void add_lens_findings(const PixelEstimate& shown, const CameraModel& camera,
                       std::vector<std::string>& findings) {
    for (const int i : shown.asked) {
        const double value = shown.value[i], u = k * std::sqrt(shown.covariance(i, i));
        if (i == deviation::inverse_focus)
            findings.push_back(
                fmt::format("the lens focuses at {}, its file says {:.4g} mm",
                            distance_words(1.0 / camera.lens->focus_distance_mm + value, u),
                            camera.lens->focus_distance_mm));
        if (i == deviation::f_number) {
            const double f_number = camera.lens->f_number * std::exp(value);
            findings.push_back(fmt::format("the lens is at f/{}, its file says f/{:.3g}",
                                           plus_minus(f_number, f_number * u, ""),
                                           camera.lens->f_number));
        }
        if (i == deviation::blur)
            findings.push_back(fmt::format(
                "at all distances alike edges are {} by a variance of {}: look for vibration, "
                "motion and another point spread",
                value > 0 ? "wider" : "sharper", plus_minus(std::abs(value), u, "px^2")));
    }
}

void add_findings(const PixelEstimate& shown, const CameraModel& camera, ImageAgreement& match) {
    const auto add = [&](const std::optional<PixelFigure>& figure, const char* more,
                         const char* less, const std::string& unit, const char* what_else) {
        if (figure && figure->is_shown())
            match.findings.push_back(
                fmt::format("{} by {}{}", figure->value > 0 ? more : less,
                            plus_minus(std::abs(figure->value), figure->expanded_uncertainty, unit),
                            what_else));
    };
    const auto is_in = [&](int i) {
        return std::ranges::find(shown.asked, i) != shown.asked.end();
    };
    const auto add_tone = [&] {
        add(match.tone_gray, "half tones are brighter than the calibration's tone curve",
            "half tones are darker than the calibration's tone curve", "gray", "");
    };
    if (is_tone_far(shown))
        return add_tone();
    add(match.blur_px, "the photographs are blurrier than the calibration says, edges",
        "the photographs are sharper than the calibration says, edges", "px", " (RMS)");
    add_lens_findings(shown, camera, match.findings);
    if (is_in(deviation::tone))
        add_tone();
    if (is_in(deviation::print_gain))
        add(match.edge_px, "dark parts are wider at each edge",
            "dark parts are narrower at each edge", "px",
            ": look at print, exposure and tone curve");
    add(match.noise_ratio, "the noise is larger than the calibration says",
        "the noise is smaller than the calibration says", "of it", ": gain or light is another");
    add(match.background_gray,
        "what is beside the marker is brighter than the station's background",
        "what is beside the marker is darker than the station's background", "gray", "");
    add(match.black_gray, "black is brighter than the calibration's black level",
        "black is darker than the calibration's black level", "gray",
        ": stray light, the print's black, or another black level");
    add(match.shading_percent, "white changes over the image", "white changes over the image", "%",
        " from side to side beyond the calibration's illumination: the light on the marker, or "
        "vignetting");
    if (match.findings.empty())
        add(match.residual_gray, "the photographs differ from their renders beyond the noise",
            "the photographs differ from their renders by less than the stated noise", "gray", "");
}

// What single photographs show, where more than 1 in 20 of them do.
void add_common_findings(const RunEvidence& pixels, ImageAgreement& match) {
    std::map<std::string, std::pair<int, std::string>> all;  // count and sentence
    for (const auto& of_photo : pixels.findings)
        for (const PhotoFinding& finding : of_photo)
            all[finding.name] = {all[finding.name].first + 1, finding.sentence};
    for (const auto& [name, seen] : all) {
        const auto& [count, sentence] = seen;
        const bool is_a_figure = name == "blur_differs" || name == "unexplained";
        if (!is_a_figure && is_common(count, pixels.findings))
            match.findings.push_back(
                fmt::format("{} of {} photographs: {}", count, pixels.findings.size(), sentence));
    }
    match.is_overexposed = is_overexposed(pixels.findings);
}

PixelEvidence evidence_of(const PixelEstimate& estimate, const ImageAgreement& match) {
    constexpr const char* names[] = {"f-number", "focus distance", "blur", "tone curve",
                                     "edge shrink"};
    PixelDeviation sign = PixelDeviation::Ones();
    sign[deviation::print_gain] = -1.0;  // dark parts shrink
    const PixelDeviation value = sign.cwiseProduct(estimate.value);
    const PixelInformation covariance = sign.asDiagonal() * estimate.covariance * sign.asDiagonal();
    PixelEvidence evidence;
    for (const int i : estimate.asked)
        evidence.errors.emplace_back(names[i]);
    evidence.observed = value(estimate.asked);
    evidence.covariance = covariance(estimate.asked, estimate.asked);
    for (const auto& [name, figure] :
         {std::pair("noise", match.noise_ratio), std::pair("background", match.background_gray),
          std::pair("black level", match.black_gray)}) {
        if (!figure || is_tone_far(estimate))
            continue;
        const Eigen::Index at = evidence.observed.size();
        evidence.errors.emplace_back(name);
        evidence.observed.conservativeResize(at + 1);
        evidence.observed[at] = figure->value;
        evidence.covariance.conservativeResizeLike(Eigen::MatrixXd::Zero(at + 1, at + 1));
        evidence.covariance(at, at) = std::pow(figure->expanded_uncertainty / k, 2);
    }
    return evidence;
}

}  // namespace

ImageAgreement match_pixels(const RunEvidence& pixels, const CameraModel& camera) {
    constexpr double noise_floor = 0.01, level_floor_gray = 0.1, quarter = 0.25;
    ImageAgreement match;
    match.photos = static_cast<int>(pixels.photos.size());
    add_common_findings(pixels, match);
    if (pixels.photos.size() < min_compared_photos || match.is_overexposed)
        return match;
    const std::vector<PhotoEvidence>& photos = pixels.photos;
    const PixelEstimate estimate = estimate_of(pixels, camera);
    match.residual_gray = residual_of(pixels);
    if (pixels.asked[deviation::blur])
        match.blur_px = blur_of(pixels, estimate, camera);
    if (pixels.asked[deviation::tone])
        match.tone_gray = figure_of(estimate, deviation::tone, quarter * mean_contrast(photos));
    match.edge_px = figure_of(estimate, deviation::print_gain);
    match.shading_percent = shading_of(photos);
    match.noise_ratio = mean_figure(photos, noise_floor, [](const PhotoEvidence& photo) {
        return photo.noise_ratio ? std::optional(*photo.noise_ratio - 1.0) : std::nullopt;
    });
    match.background_gray = background_of(pixels, estimate, level_floor_gray);
    match.black_gray = mean_figure(photos, level_floor_gray,
                                   [](const PhotoEvidence& photo) { return photo.black_gray; });
    add_findings(needed(estimate), camera, match);
    match.evidence = evidence_of(estimate, match);
    return match;
}

}  // namespace etalon
