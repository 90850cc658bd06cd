#include "station/qualify/run_expectation.h"

#include <fmt/format.h>

#include "station/planning/expectation_report.h"

namespace etalon {
namespace {

// Of the frames of one pose, as poses.
std::optional<SixErrors> noise_of(const Pose& pose, const std::vector<Eigen::Vector3d>& points_mm,
                                  const Projector& projector) {
    const Rigid& predicted = pose.bias.predicted;
    ErrorSpread spread;
    for (const FrameRecord& frame : pose.frames) {
        if (frame.corners.empty())
            continue;
        const PoseBias bias = pose_bias(projector, points_mm, predicted, frame.corners, {});
        if (bias.b2)
            spread.add(components_of(*bias.b2, predicted));
    }
    return spread.deviations();
}

}  // namespace

Expectation run_expectation(const QualifyResult& result) {
    Expectation expectation;
    if (!result.analysis)
        return expectation;
    const Projector projector(result.station.camera.model);
    expectation.frames = result.station.plan.frames;
    for (const Pose& pose : result.poses) {
        if (!pose.hold_out)
            continue;
        const Rigid& predicted = pose.bias.predicted;
        ExpectedPose expected{predicted, place_of(projector, predicted)};
        if (pose.bias.b1)
            expected.bias = components_of(*pose.bias.b1, predicted);
        expected.noise = noise_of(pose, result.station.marker.points_mm, projector);
        expected.detections = pose.detections;
        expectation.poses.push_back(expected);
    }
    fit_maps(expectation, result.station.plan.seed);
    return expectation;
}

void add_run_expectation(HtmlPage& page, const QualifyResult& result) {
    const Expectation expectation = run_expectation(result);
    if (!expectation.bias_maps)
        return;
    page.add_heading("What to expect of this camera, marker and detector");
    page.add_paragraph(fmt::format(
        "Bias B1 of the detector at {} hold-out poses, from renders with the noise that the "
        "calibration states: what a user of this detector is off by even with a perfect "
        "calibration. Worst: of the smooth map, with depth, distance from the principal point and "
        "tilt. Noise: RMS over the poses of the deviation between frames of one pose. `etalon "
        "expect` maps the whole volume.",
        expectation.detected()));
    add_short_expectation(page, expectation);
}

}  // namespace etalon
