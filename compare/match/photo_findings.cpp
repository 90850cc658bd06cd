#include "compare/match/photo_findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/camera/viewing_geometry.h"
#include "compare/characterise/point_spread_estimate.h"
#include "compare/edges/edge_spread.h"
#include "compare/match/block_steps.h"
#include "compare/match/covered_areas.h"
#include "compare/match/residual_modes.h"
#include "compare/match/shown_pattern.h"
#include "core/program/errors.h"

namespace etalon {
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
    const double rest = match.refined.difference.scored.rms_gray / contrast_gray;
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
    const PixelDifference& difference = match.refined.difference;
    const double printed = printed_px(marker, shown.cell_px);
    const Findings blur = blur_findings(blur_sigma_px(camera.model(), state), printed);
    if (!blur.empty())
        return blur;
    const auto add = [&](const Findings& more) {
        findings.insert(findings.end(), more.begin(), more.end());
    };
    const CoveredAreas areas =
        covered_areas(gray, difference, printed / 3.0, max_covered, saturation);
    if (areas.share > 0)
        findings.push_back(covered(areas));
    else if (shown.clipped_white > max_clipped)
        findings.push_back(saturated(shown.clipped_white));
    add(mode_findings(
        ResidualModes(difference, (difference.use != pixel_outside) & (areas.pixels == 0), camera,
                      state.camera_from_marker, match.pose.noise_scale),
        state.photometry));
    // A smear has sharp ends, which would pass for sharpening.
    if (std::ranges::find(findings, "motion_blur", &Finding::name) == findings.end())
        add(sharpening_findings(photo, marker, area, camera, state));
    add(compression_findings(block_steps(difference, shown.expected.contrast_gray)));
    if (findings.empty())
        add(rest_findings(camera, match, shown.expected.contrast_gray));
    return findings;
}

}  // namespace etalon
