#include "station/qualify/run_analysis.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/expect/rendered_corners.h"
#include "compare/photometric/photo_match.h"
#include "core/errors.h"
#include "core/image_writer.h"
#include "station/qualify/measured_poses.h"
#include "station/register/qualification_input.h"

namespace etalon {
namespace {

void throw_if_stopped(const std::stop_token& stop) {
    if (stop.stop_requested())
        throw Interrupted();
}

std::vector<StageVisit> visits_of(const std::vector<PoseRecord>& poses) {
    std::vector<StageVisit> visits;
    for (const PoseRecord& pose : poses)
        visits.push_back({pose.read_back, pose.read_back_uncertainty});
    return visits;
}

QualificationInput measured_input(QualifyResult& result, const std::stop_token& stop) {
    QualificationInput input = declared_input(result.station, visits_of(result.poses));
    input.poses = measured_poses(result, result.remarks, stop);
    input.monte_carlo = true;
    return input;
}

// On the scale of the renders: the marker's white is `white_level`.
PoseRecord::Residual residual_of(const CodeImage& photo, const StationFile& station,
                                 const ComparedArea& area, const PhotometricCamera& camera,
                                 const Rigid& camera_from_marker) {
    CellGrid marker = station.marker.grid;
    marker.cells = cv::Mat(marker.cells * station.white_level);  // not in the station's own cells
    const PhotoOfMarker seen{gray_of(photo), marker,
                             pixel_uses(camera.projector(), camera_from_marker, area), pixel_fitted,
                             station.background * station.white_level};
    const PixelDifference difference = fit_photometry(seen, camera, camera_from_marker).difference;
    return {difference.model, difference.scored};
}

// Each hold-out photograph against the render at its registered pose; the renders are kept, for
// people and for re-analysis.
void compare_with_renders(QualifyResult& result, const ExpectedView& view, Progress& progress,
                          const std::stop_token& stop) {
    const Qualification& analysis = *result.analysis;
    const StationFile& station = result.station;
    ImageWriter renders;
    const PhotometricCamera camera(station.camera.model);
    const ComparedArea area = compared_area(station.marker, {}, station.marker.spec);
    for (std::size_t i = 0; i < analysis.poses.size(); ++i) {
        if (!analysis.poses[i].hold_out || !analysis.poses[i].used)
            continue;
        throw_if_stopped(stop);
        PoseRecord& pose = result.poses[i];
        const Rigid& camera_from_marker = analysis.poses[i].bias.predicted;
        pose.render_file = fmt::format("renders/{:04}.png", pose.index);
        renders.write(result.folder / pose.render_file, view.at(camera_from_marker));
        try {
            pose.residual = residual_of(recorded_photo(result, pose), station, area, camera,
                                        camera_from_marker);
        } catch (const NumericalError& error) {
            result.remarks.push_back(
                fmt::format("pose {} has no pixel difference: {}", pose.index, error.what()));
        }
        progress.step();
    }
    renders.flush();
}

// Three rounds over the training poses at most; hold-out poses are rendered to judge and to keep.
int expected_renders(const QualificationInput& input) {
    const auto hold_out =
        std::count_if(input.poses.begin(), input.poses.end(),
                      [](const QualificationPose& pose) { return pose.hold_out; });
    return 3 * static_cast<int>(input.poses.size()) - static_cast<int>(hold_out);
}

}  // namespace

void analyse_run(QualifyResult& result, Progress& progress, const std::stop_token& stop) {
    const StationFile& station = result.station;
    const RenderedCorners rendered(expected_scene(station), station.plan.frames, station.plan.seed);
    QualificationInput input = measured_input(result, stop);
    input.render_and_detect =
        [&](const Rigid& camera_from_marker) -> std::optional<std::vector<Eigen::Vector2d>> {
        throw_if_stopped(stop);
        auto corners = rendered.at(camera_from_marker);
        progress.step();
        return corners;
    };
    const int renders = expected_renders(input);
    progress.begin("analysing", renders, renders * std::chrono::milliseconds(200));
    result.analysis = qualify(input);
    compare_with_renders(result, rendered.view(), progress, stop);
    progress.end();
}

RunOutcome outcome_of(Outcome verdict) {
    if (verdict == Outcome::pass)
        return RunOutcome::pass;
    return verdict == Outcome::fail ? RunOutcome::fail : RunOutcome::inconclusive;
}

}  // namespace etalon
