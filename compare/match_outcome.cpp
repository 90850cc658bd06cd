#include "compare/match_outcome.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "compare/code_statistics.h"
#include "compare/covered_areas.h"
#include "compare/residual_modes.h"
#include "compare/shown_pattern.h"
#include "core/errors.h"

namespace etalon {
namespace {

// The limits; docs/validation.md has the reasons.
constexpr double least_explained = 0.5;       // of the cells' variance, by any pattern
constexpr double most_clipped = 0.05;         // of the light cells' samples
constexpr double least_contrast_gray = 20.0;  // 8-bit steps are 5 % of it
constexpr double most_blur_cells = 0.35;      // sigma: a cell's middle misses its level by 15 %
constexpr double most_covered = 0.25;         // of the contrast, in a window
constexpr double bright_part = 0.3;           // of a covered area, for it to be called glare

double saturation_gray(const CodeImage& photo) {
    return 255.0 * saturation_code({&photo, 1}) / photo.full_scale();
}

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
            least_explained,
            "",
            fmt::format("the marker is not where the pose says, or covered: its pattern explains "
                        "{:.0f} % of what is seen there",
                        100 * score.explained),
            true};
}

Finding low_contrast(double contrast_gray) {
    return {"low_contrast",
            contrast_gray,
            least_contrast_gray,
            "gray",
            fmt::format("white and black are only {:.1f} gray values apart", contrast_gray),
            true};
}

Finding saturated(double clipped) {
    return {"saturated",
            100.0 * clipped,
            100.0 * most_clipped,
            "%",
            fmt::format("{:.0f} % of the light cells are at the end of the scale: expose less",
                        100.0 * clipped),
            true};
}

bool is_tag(const Marker& marker) {
    return marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco;
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
    if (another && shown.best.explained > least_explained)
        return {other_pattern(marker, shown)};
    if (expected.explained < least_explained)
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
    if (shown.clipped_white > most_clipped)
        return {saturated(shown.clipped_white)};
    if (expected.contrast_gray < least_contrast_gray)
        return {low_contrast(expected.contrast_gray)};
    if (shown.visible < 1.0)
        return {not_in_image(shown.visible)};
    return {};
}

}  // namespace

bool is_refused(const Findings& findings) {
    return std::any_of(findings.begin(), findings.end(),
                       [](const Finding& finding) { return finding.is_refusal; });
}

Findings examine_marker(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                        const Projector& projector, const Rigid& camera_from_marker) {
    return pattern_findings(marker, shown_pattern(gray_of(photo), saturation_gray(photo), projector,
                                                  marker, area, camera_from_marker));
}

Findings examine_match(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                       const PhotometricCamera& camera, const PhotoMatch& match) {
    const double saturation = saturation_gray(photo);
    const cv::Mat gray = gray_of(photo);
    const PhotoState& state = match.refined.state;
    const ShownPattern shown =
        shown_pattern(gray, saturation, camera.projector(), marker, area, state.camera_from_marker);
    Findings findings = pattern_findings(marker, shown);
    return findings;
}

Findings examine_missing_marker(const CodeImage&, Detector&) {
    return {};
}

}  // namespace etalon
