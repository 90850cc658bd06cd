#include "station/qualify/run_expectation.h"

#include <fmt/format.h>

#include "station/foresee/expectation_report.h"

namespace etalon {
namespace {

// Of the frames of one pose, as poses.
std::optional<SixErrors> noise_of(const PoseRecord& pose, const Rigid& predicted,
                                  const std::vector<Eigen::Vector3d>& points_mm,
                                  const Projector& projector) {
    ErrorSpread spread;
    for (const FrameRecord& frame : pose.frames) {
        if (frame.corners.empty())
            continue;
        const PoseBias bias =
            pose_bias(projector, points_mm, predicted, frame.corners, std::nullopt);
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
    for (std::size_t i = 0; i < result.analysis->poses.size(); ++i) {
        const QualifiedPose& qualified = result.analysis->poses[i];
        if (!qualified.hold_out)
            continue;
        const Rigid& predicted = qualified.bias.predicted;
        ExpectedPose pose{predicted, place_of(projector, predicted)};
        if (qualified.bias.b1)
            pose.bias = components_of(*qualified.bias.b1, predicted);
        pose.noise =
            noise_of(result.poses.at(i), predicted, result.station.marker.points_mm, projector);
        pose.detections = result.poses[i].detections;
        expectation.poses.push_back(pose);
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
