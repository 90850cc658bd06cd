#include "compare/match/photo_findings.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "calib/camera/projector.h"
#include "compare/characterise/code_statistics.h"
#include "compare/characterise/point_spread_estimate.h"
#include "compare/edges/edge_spread.h"
#include "compare/match/residual_modes.h"
#include "compare/match/shown_pattern.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// White minus black, and white, at every pixel.
struct Levels {
    cv::Mat white, contrast;

    Levels(const PhotometricModel& model, cv::Size size)
        : white(size, CV_32FC1), contrast(size, CV_32FC1) {
        for (int y = 0; y < size.height; ++y) {
            const LevelRow row(model, y, size);
            for (int x = 0; x < size.width; ++x) {
                const double black = row.black(x), full = row.white(x);
                const double light = model.between(black, full, 1.0).gray,
                             dark = model.between(black, full, 0.0).gray;
                white.at<float>(y, x) = static_cast<float>(light);
                contrast.at<float>(y, x) = static_cast<float>(std::max(light - dark, 1.0));
            }
        }
    }
};

// Where the prediction changes by less than 5 % of the contrast per px: not beside an edge, where a
// displacement of a px leaves a residual as large as a cover's.
cv::Mat flat_places(const cv::Mat& predicted, const cv::Mat& contrast) {
    cv::Mat by_x, by_y;
    constexpr double per_px = 1.0 / 8.0;  // of Sobel's filter
    cv::Sobel(predicted, by_x, CV_32F, 1, 0, 3, per_px);
    cv::Sobel(predicted, by_y, CV_32F, 0, 1, 3, per_px);
    return cv::Mat(cv::abs(by_x) + cv::abs(by_y)) < 0.05 * contrast;
}

// Means over windows, of the used pixels among them; 0 where fewer than a sixth are used. The
// values are averaged over `step` x `step` px first, and the windows stand that far apart.
cv::Mat window_means(const cv::Mat& values, const cv::Mat& used, int side, int step) {
    constexpr double min_share = 1.0 / 6.0;
    const cv::Size size((values.cols + step - 1) / step, (values.rows + step - 1) / step);
    cv::Mat weight, weighted, sum, count;
    used.convertTo(weight, CV_32F, 1.0 / 255.0);
    cv::resize(values.mul(weight), weighted, size, 0, 0, cv::INTER_AREA);
    cv::resize(weight, weight, size, 0, 0, cv::INTER_AREA);
    const cv::Size window(side / step, side / step);
    cv::boxFilter(weighted, sum, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::boxFilter(weight, count, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::Mat means = sum / cv::max(count, 0.01f);
    means.setTo(0.0f, count < min_share);
    return means;
}

}  // namespace

CoveredAreas covered_areas(const cv::Mat& photo_gray, const PhotoFit& fit, double window_px,
                           double limit, double saturation_gray) {
    if (photo_gray.size() != fit.use.size() || photo_gray.type() != CV_32FC1)
        throw NumericalError("the photograph is not the one that was compared");
    constexpr int enough_steps = 12;  // in a window
    const int side = std::max(3, static_cast<int>(std::lround(window_px)));
    const int step = std::max(1, side / enough_steps);
    const cv::Mat used = fit.use != pixel_outside;
    const Levels levels(fit.state.photometry, used.size());
    const cv::Mat means =
        window_means(fit.residual / levels.contrast,
                     used & flat_places(fit.predicted, levels.contrast), side, step);
    const cv::Mat size = cv::abs(means);

    CoveredAreas areas;
    cv::Mat used_windows, large;
    cv::resize(used, used_windows, size.size(), 0, 0, cv::INTER_NEAREST);
    cv::minMaxLoc(size, nullptr, &areas.largest, nullptr, nullptr, used_windows);
    cv::dilate(size > limit, large,
               cv::getStructuringElement(cv::MORPH_RECT, {side / step + 2, side / step + 2}));
    cv::resize(large, areas.pixels, used.size(), 0, 0, cv::INTER_NEAREST);
    const cv::Mat covered = areas.pixels & used;
    const int count = cv::countNonZero(covered), all = cv::countNonZero(used);
    if (count == 0)
        return areas;
    areas.share = static_cast<double>(count) / all;
    const cv::Mat brighter =
        (photo_gray > levels.white + 0.1 * levels.contrast) | (photo_gray >= saturation_gray);
    areas.bright_share = static_cast<double>(cv::countNonZero(brighter & covered)) / count;
    return areas;
}

double BlockSteps::excess_gray() const {
    return std::sqrt(std::max(across_gray * across_gray - inside_gray * inside_gray, 0.0));
}

BlockSteps block_steps(const PhotoFit& fit, double contrast_gray) {
    constexpr int block_px = 8;
    cv::Mat by_x, by_y;
    constexpr double per_px = 1.0 / 8.0;  // of Sobel's filter
    cv::Sobel(fit.predicted, by_x, CV_32F, 1, 0, 3, per_px);
    cv::Sobel(fit.predicted, by_y, CV_32F, 0, 1, 3, per_px);
    const cv::Mat flat =
        (cv::abs(by_x) + cv::abs(by_y) < 0.01 * contrast_gray) & (fit.use != pixel_outside);
    std::array<double, 2> squares{}, pairs{};  // inside, across
    const auto add = [&](int x, int y, int before_x, int before_y, bool across) {
        if (!flat.at<uchar>(y, x) || !flat.at<uchar>(before_y, before_x))
            return;
        const double step =
            fit.residual.at<float>(y, x) - fit.residual.at<float>(before_y, before_x);
        squares[across ? 1 : 0] += step * step;
        pairs[across ? 1 : 0] += 1.0;
    };
    for (int y = 1; y < flat.rows; ++y)
        for (int x = 1; x < flat.cols; ++x) {
            add(x, y, x - 1, y, x % block_px == 0);
            add(x, y, x, y - 1, y % block_px == 0);
        }
    if (pairs[0] == 0 || pairs[1] == 0)
        return {};
    return {std::sqrt(squares[1] / pairs[1]), std::sqrt(squares[0] / pairs[0]),
            static_cast<int>(pairs[1])};
}

namespace {

// The limits; docs/match-outcome.md has the reasons.
constexpr double min_explained = 0.5;       // of the cells' variance, by any pattern
constexpr double max_clipped = 0.05;        // of the light cells' samples
constexpr double hopelessly_clipped = 0.5;  // their median is no level any more
constexpr double min_contrast_gray = 20.0;  // 8-bit steps are 5 % of it
constexpr double max_blur_cells = 0.35;     // sigma: a cell's middle misses its level by 15 %
constexpr double max_covered = 0.25;        // of the contrast, in a window
constexpr double bright_part = 0.3;         // of a covered area, for it to be called glare
// Of 26 photographs of a printed board (hand-held, JPEG at quality 50) the largest were 0.041 px,
// 0.066 px, 2.5 px, 4.0 gray and 0.034: what good work leaves, times 1.1 or more.
constexpr double max_rows_px = 0.06, max_calibration_px = 0.09;
constexpr double max_smear_px = 3.0;
constexpr double max_block_step_gray = 4.5;
constexpr double max_rest = 0.06;            // RMS residual, of the contrast
constexpr double max_rest_over_noise = 2.0;  // where the camera's noise is known
constexpr double max_blur_difference = 0.2;  // px^2, where the camera's file gives the blur

// Not from a pile-up of equal codes below full scale: in a noise-free rendering white is one.
constexpr double saturation = 0.99 * 255.0;

Finding not_in_image(double visible) {
    return {"not_in_image",
            100.0 * visible,
            100.0,
            "%",
            fmt::format("only {:.0f} % of the marker's cells are inside the image", 100 * visible),
            visible < 0.5};
}

Finding marker_not_there(const PatternScore& score) {
    return {"marker_not_there",
            score.explained,
            min_explained,
            "",
            fmt::format("the marker is not where the pose says, or covered: its pattern explains "
                        "{:.0f} % of what is seen there",
                        100 * score.explained),
            true};
}

Finding low_contrast(double contrast_gray) {
    return {"low_contrast",
            contrast_gray,
            min_contrast_gray,
            "gray",
            fmt::format("white and black are only {:.1f} gray values apart", contrast_gray),
            true};
}

Finding saturated(double clipped) {
    return {"saturated",
            100.0 * clipped,
            100.0 * max_clipped,
            "%",
            fmt::format("{:.0f} % of the light cells are at the end of the scale: expose less",
                        100.0 * clipped),
            clipped > hopelessly_clipped};
}

Finding negative(const Marker& marker, const PatternScore& score) {
    return {"negative",
            score.contrast_gray,
            0.0,
            "gray",
            is_tag(marker)
                ? "light and dark are exchanged: a negative of the marker"
                : "light and dark are exchanged: a negative, or the board is half a turn round or "
                  "a square aside",
            true};
}

std::string position_in_words(const ShownPattern& shown) {
    const std::string turned =
        shown.quarter_turns == 0
            ? ""
            : fmt::format("turned by {} degrees clockwise", 90 * shown.quarter_turns);
    if (!shown.mirrored)
        return turned;
    return turned.empty() ? "mirrored" : "mirrored, then " + turned;
}

Finding other_pattern(const Marker& marker, const ShownPattern& shown) {
    Finding finding{"", shown.expected.explained, shown.best.explained, "", "", true};
    const std::string position = position_in_words(shown);
    if (is_tag(marker) && shown.id != marker.id) {
        finding.name = "wrong_marker";
        finding.sentence = fmt::format("this is id {} of {}, not {}{}", shown.id, marker.family,
                                       marker.id, position.empty() ? "" : ", " + position);
    } else {
        finding.name = shown.mirrored             ? "mirrored"
                       : shown.quarter_turns == 2 ? "upside_down"
                                                  : "turned";
        finding.sentence = "the marker is " + position + ", or the pose is so";
    }
    if (shown.best.contrast_gray < 0)
        finding.sentence += ", and light and dark are exchanged";
    return finding;
}

// Refusals by the pattern, worst first; one is enough.
Findings pattern_findings(const Marker& marker, const ShownPattern& shown) {
    const PatternScore& expected = shown.expected;
    if (shown.visible < 0.5)
        return {not_in_image(shown.visible)};
    const bool another =
        shown.is_another() && 1.0 - shown.best.explained < 0.5 * (1.0 - expected.explained);
    if (another && shown.best.explained > min_explained)
        return {other_pattern(marker, shown)};
    if (expected.explained < min_explained)
        return {marker_not_there(expected)};
    if (expected.contrast_gray < 0)
        return {negative(marker, expected)};
    if (is_tag(marker) && shown.flipped_to_light > 1 && shown.flipped_to_dark > 1)
        return {Finding{"wrong_marker",
                        static_cast<double>(shown.flipped_to_light + shown.flipped_to_dark), 1.0,
                        "cells",
                        fmt::format("{} dark cells are light and {} light ones dark: another "
                                    "marker, of another family or damaged",
                                    shown.flipped_to_light, shown.flipped_to_dark),
                        true}};
    if (shown.clipped_white > hopelessly_clipped)
        return {saturated(shown.clipped_white)};
    if (expected.contrast_gray < min_contrast_gray)
        return {low_contrast(expected.contrast_gray)};
    if (shown.visible < 1.0)
        return {not_in_image(shown.visible)};
    return {};
}

// Sigma of the whole blur beside the pixel: what was fitted, and what the camera's file says.
double blur_sigma_px(const CameraModel& camera, const PhotoState& state) {
    double variance = state.photometry.psf_sigma_px * state.photometry.psf_sigma_px;
    if (camera.lens) {
        const double sigma = camera.lens->psf.sigma_px;
        const double radius = blur_radius_px(
            camera, depth_mm(camera.projection, state.camera_from_marker.translation));
        variance += sigma * sigma + radius * radius / 4.0;  // of a disk along any direction
    }
    return std::sqrt(variance);
}

// Side of the smallest thing that is printed: disks are drawn with cells far smaller than they are.
double printed_px(const Marker& marker, double cell_px) {
    const double cell_mm = std::sqrt(marker.grid.cell_mm.prod());
    const bool disks = marker.kind == Marker::Kind::circles ||
                       marker.kind == Marker::Kind::acircles ||
                       marker.kind == Marker::Kind::hexcircles;
    return cell_px * std::max(cell_mm, disks ? marker.part_mm : marker.detail_mm) / cell_mm;
}

Findings blur_findings(double sigma_px, double cell_px) {
    const double limit = std::min(max_blur_cells * cell_px, 0.99 * max_psf_sigma_px);
    if (sigma_px <= limit)
        return {};
    return {{"out_of_focus", sigma_px, limit, "px",
             fmt::format("edges are blurred with a sigma of {:.1f} px, cells are {:.0f} px: out of "
                         "focus, or moved",
                         sigma_px, cell_px),
             true}};
}

Finding covered(const CoveredAreas& areas) {
    const bool glare = areas.bright_share > bright_part;
    return {glare ? "glare" : "occluded",
            100.0 * areas.largest,
            100.0 * max_covered,
            "%",
            glare ? fmt::format("a reflection (or something bright) on {:.1f} % of the marker",
                                100.0 * areas.share)
                  : fmt::format("something covers or shades {:.1f} % of the marker, or its print "
                                "is damaged",
                                100.0 * areas.share),
            false};
}

// The fit has a blur that differs along x and y, which is a part of the smear's.
Finding smeared(const ModeFit& fit, const PhotometricModel& photometry) {
    const double along_x = fit.values[0] + photometry.psf_anisotropy_px2;
    const double anisotropy = 2.0 * std::hypot(along_x, fit.values[1]);  // px^2
    const double direction = 0.5 * std::atan2(fit.values[1], along_x);
    return {"motion_blur",
            std::sqrt(12.0 * anisotropy),
            max_smear_px,
            "px",
            fmt::format("blurred along one direction ({:.0f} degrees from x towards y) as if moved "
                        "by {:.1f} px during the exposure; astigmatism would look the same",
                        direction * 180.0 / CV_PI, std::sqrt(12.0 * anisotropy)),
            false};
}

Finding of_mode(const ModeFit& fit, const PhotometricModel& photometry) {
    switch (fit.mode) {
        case ResidualMode::rows:
            return {"skewed",
                    fit.size_px,
                    max_rows_px,
                    "px",
                    fmt::format("rows are displaced in proportion to their place, edges by {:.2f} "
                                "px: moved under a rolling shutter, or the calibration's pixel "
                                "aspect is wrong",
                                fit.size_px),
                    false};
        case ResidualMode::calibration:
            return {"calibration_mismatch",
                    fit.size_px,
                    max_calibration_px,
                    "px",
                    fmt::format("edges are off by {:.2f} px in a way that another focal length, "
                                "centre or distortion explains: another camera's calibration, "
                                "another focus, or a marker that is not flat",
                                fit.size_px),
                    false};
        case ResidualMode::blur_along:
            return smeared(fit, photometry);
        case ResidualMode::sharpening:  // measured on the edges: sharpening_findings()
            break;
        case ResidualMode::blur:
            return {
                "blur_differs",
                fit.values[0],
                max_blur_difference,
                "px^2",
                fmt::format("{} than the camera's file says, by a variance of {:.2f} px^2: "
                            "another focus or aperture",
                            fit.values[0] > 0 ? "blurrier" : "sharper", std::abs(fit.values[0])),
                false};
    }
    return {};
}

// Which of the significant modes are large enough to be called a fault.
bool is_large(const Finding& finding) {
    return finding.name == "blur_differs" ? std::abs(finding.value) > finding.limit
                                          : finding.value > finding.limit;
}

// Rows that are displaced and a wrong calibration may look nearly the same: then both are named.
void name_the_rival(const ResidualModes& modes, const ModeFit& fit, Finding& finding) {
    constexpr double nearly = 0.8;
    const bool rows = fit.mode == ResidualMode::rows;
    if (!rows && fit.mode != ResidualMode::calibration)
        return;
    const double own = modes.fit(fit.mode, {}).size_px;
    const double other =
        modes.fit(rows ? ResidualMode::calibration : ResidualMode::rows, {}).size_px;
    if (other > nearly * own)
        finding.sentence +=
            fmt::format("; {} explains {:.0f} % of it as well",
                        rows ? "a wrong calibration" : "a rolling shutter", 100.0 * other / own);
}

// Of many edges so many that stand all over the marker.
std::vector<StraightEdge> every_so_many(const std::vector<StraightEdge>& edges,
                                        std::size_t enough) {
    const std::size_t step = edges.size() / enough + 1;
    std::vector<StraightEdge> some;
    for (std::size_t i = 0; i < edges.size(); i += step)
        some.push_back(edges[i]);
    return some;
}

// Measured on the edges' mean profile, as `etalon characterise` does. Nothing where the marker's
// cells are too small to have one.
Findings sharpening_findings(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                             const PhotometricCamera& camera, const PhotoState& state) {
    constexpr std::size_t enough_edges = 40;
    auto sharpening = attempted([&] {
        const TargetEdges seen =
            target_edges(linear_photo(photo, camera.model()), camera.projector(), marker,
                         state.camera_from_marker, area, {.with_clipped = true});
        return measure_sharpening(every_so_many(seen.edges, enough_edges), camera.model());
    });
    if (!sharpening || !sharpening->is_detected)
        return {};
    return {
        {"sharpened", 100.0 * std::max(sharpening->overshoot, sharpening->undershoot),
         100.0 * min_overshoot, "%",
         fmt::format("edges overshoot by {:.1f} % of their contrast and undershoot by {:.1f} %: "
                     "the camera sharpens",
                     100.0 * std::max(sharpening->overshoot, 0.0),
                     100.0 * std::max(sharpening->undershoot, 0.0)),
         false}};
}

Findings mode_findings(const ResidualModes& modes, const PhotometricModel& photometry) {
    Findings findings;
    const auto add = [&](const ModeFit& fit) {
        Finding finding = of_mode(fit, photometry);
        if (finding.name.empty() || !is_large(finding))
            return;
        name_the_rival(modes, fit, finding);
        findings.push_back(finding);
    };
    bool smear_seen = false;
    for (const ModeFit& fit : modes.significant()) {
        add(fit);
        smear_seen = smear_seen || fit.mode == ResidualMode::blur_along;
    }
    // What the fit took up of a smear leaves nothing significant behind.
    if (!smear_seen && photometry.psf_anisotropy_px2 != 0.0)
        add(modes.fit(ResidualMode::blur_along, {}));
    return findings;
}

Findings compression_findings(const BlockSteps& steps) {
    constexpr double clearly = 1.25;  // above what noise alone makes of the ratio
    const double excess = steps.excess_gray();
    if (excess <= max_block_step_gray || steps.across_gray < clearly * steps.inside_gray)
        return {};
    return {{"compressed", excess, max_block_step_gray, "gray",
             fmt::format("blocks of 8 x 8 px differ by {:.1f} gray where the marker is flat: "
                         "compress less",
                         excess),
             false}};
}

// The net under the named tests: a residual that none of them explains.
Findings rest_findings(const PhotometricCamera& camera, const PhotoMatch& match,
                       double contrast_gray) {
    if (camera.knows_noise() && match.pose.noise_scale > max_rest_over_noise)
        return {{"unexplained", match.pose.noise_scale, max_rest_over_noise, "",
                 fmt::format("the residual is {:.1f} times the camera's noise, and nothing named "
                             "explains it",
                             match.pose.noise_scale),
                 false}};
    const double rest = match.refined.scored.rms_gray / contrast_gray;
    if (rest <= max_rest)
        return {};
    return {{"unexplained", 100.0 * rest, 100.0 * max_rest, "%",
             fmt::format("the residual is {:.1f} % of the contrast, and nothing named explains it",
                         100.0 * rest),
             false}};
}

}  // namespace

bool is_refused(const Findings& findings) {
    return std::any_of(findings.begin(), findings.end(),
                       [](const Finding& finding) { return finding.is_not_assessable; });
}

Findings examine_marker(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                        const Projector& projector, const Rigid& camera_from_marker) {
    return pattern_findings(marker, shown_pattern(gray_of(photo), saturation, projector, marker,
                                                  area, camera_from_marker));
}

Findings examine_match(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                       const PhotometricCamera& camera, const PhotoMatch& match) {
    const cv::Mat gray = gray_of(photo);
    const PhotoState& state = match.refined.state;
    const ShownPattern shown =
        shown_pattern(gray, saturation, camera.projector(), marker, area, state.camera_from_marker);
    Findings findings = pattern_findings(marker, shown);
    if (is_refused(findings))
        return findings;
    const PhotoFit& fit = match.refined;
    const double printed = printed_px(marker, shown.cell_px);
    const Findings blur = blur_findings(blur_sigma_px(camera.model(), state), printed);
    if (!blur.empty())
        return blur;
    const auto add = [&](const Findings& more) {
        findings.insert(findings.end(), more.begin(), more.end());
    };
    const CoveredAreas areas = covered_areas(gray, fit, printed / 3.0, max_covered, saturation);
    if (areas.share > 0)
        findings.push_back(covered(areas));
    else if (shown.clipped_white > max_clipped)
        findings.push_back(saturated(shown.clipped_white));
    add(mode_findings(ResidualModes(fit, (fit.use != pixel_outside) & (areas.pixels == 0), camera,
                                    state.camera_from_marker, match.pose.noise_scale),
                      state.photometry));
    // A smear has sharp ends, which would pass for sharpening.
    if (std::ranges::find(findings, "motion_blur", &Finding::name) == findings.end())
        add(sharpening_findings(photo, marker, area, camera, state));
    add(compression_findings(block_steps(fit, shown.expected.contrast_gray)));
    if (findings.empty())
        add(rest_findings(camera, match, shown.expected.contrast_gray));
    return findings;
}

// Why a detector found nothing: by trying. The rest of compare/match/photo_findings.h is in
// match_outcome.cpp.

namespace {

constexpr double min_range_gray = 20.0;  // as of the contrast in match_outcome.cpp
constexpr double max_saturated = 0.5;    // of the image: a white wall beside the marker is well

// Between the darkest and the lightest per cent of the pixels.
double range_gray(const CodeImage& photo) {
    cv::Mat pixels = photo.pixels.reshape(1, 1).clone();
    cv::sort(pixels, pixels, cv::SORT_EVERY_ROW | cv::SORT_ASCENDING);
    const int n = pixels.cols;
    const auto at = [&](int i) {
        return pixels.depth() == CV_8U ? static_cast<double>(pixels.at<uchar>(0, i))
                                       : static_cast<double>(pixels.at<ushort>(0, i));
    };
    return (at(n - 1 - n / 100) - at(n / 100)) * 255.0 / photo.full_scale();
}

Finding tried(const std::string& name, const std::string& sentence) {
    return {name, 0.0, 0.0, "", sentence, true};
}

CodeImage negative_of(const CodeImage& photo) {
    return {cv::Mat(photo.full_scale() - photo.pixels), photo.bits};
}

CodeImage mirror_image_of(const CodeImage& photo) {
    CodeImage result{{}, photo.bits};
    cv::flip(photo.pixels, result.pixels, 1);
    return result;
}

CodeImage reduced(const CodeImage& photo, int factor) {
    CodeImage result{{}, photo.bits};
    cv::resize(photo.pixels, result.pixels, {}, 1.0 / factor, 1.0 / factor, cv::INTER_AREA);
    return result;
}

}  // namespace

Findings examine_missing_marker(const CodeImage& photo, Detector& detector) {
    if (photo.pixels.empty())
        return {};
    const double range = range_gray(photo);
    if (range < min_range_gray)
        return {{"low_contrast", range, min_range_gray, "gray",
                 fmt::format("the whole photograph spans {:.0f} gray values: empty, dark or "
                             "without contrast",
                             range),
                 true}};
    const double clipped = share_at_saturation(photo, photo.full_scale());
    if (clipped > max_saturated)
        return {{"saturated", 100.0 * clipped, 100.0 * max_saturated, "%",
                 fmt::format("{:.0f} % of the photograph is at the end of the scale: expose less",
                             100.0 * clipped),
                 true}};
    if (detector.detect(negative_of(photo)).corners)
        return {tried("negative",
                      "in the negative the marker is found: light and dark are "
                      "exchanged")};
    if (detector.detect(mirror_image_of(photo)).corners)
        return {tried("mirrored",
                      "in the mirrored photograph the marker is found: it is printed "
                      "or read out mirrored")};
    for (const int factor : {2, 4})
        if (std::min(photo.pixels.rows, photo.pixels.cols) / factor > 40 &&
            detector.detect(reduced(photo, factor)).corners)
            return {tried("out_of_focus",
                          fmt::format("in the photograph reduced to 1/{} the marker is found: out "
                                      "of focus, moved or noisy",
                                      factor))};
    return {};
}

}  // namespace etalon
