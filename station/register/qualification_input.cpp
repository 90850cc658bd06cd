#include "station/register/qualification_input.h"

#include "compare/expect/expected_view.h"
#include "station/register/stage_registration.h"

namespace etalon {
namespace {

// A render's gray values are right to the renderer's tolerance. All of them off the same way move
// an edge by that over its slope: the marker's contrast over the width of a somewhat blurred edge.
double render_edge_bound_px(const StationFile& station) {
    constexpr double full_scale_gray = 255.0;
    constexpr double edge_width_px = 2.0;
    return edge_width_px * ExpectedView::tolerance_gray / (full_scale_gray * station.white_level);
}

}  // namespace

QualificationInput declared_input(const StationFile& station, std::vector<VisitedPose> poses,
                                  const RunEnvironment& environment) {
    const std::vector<Axis>& axes = station.stage.axes;
    const Rigid& mount = station.carriage_from_marker_nominal;
    QualificationInput input;
    input.camera = &station.camera.model;
    input.points_mm = station.marker.points_mm;
    input.nominal_carriage_from_marker = mount;
    input.marker_size_uncertainty = station.marker_size_uncertainty;
    input.marker_flatness_mm = station.marker_flatness_mm;
    input.temperature = temperature_of_run(station, environment);
    input.render_noise_ratio = RenderedCorners::noise_ratio(station.camera.model);
    input.render_edge_bound_px = render_edge_bound_px(station);
    input.limits = station.limits;
    input.options.seed = station.plan.seed;
    input.stage_reach = stage_reach(axes, station.plan.volume);
    input.stage_terms = declared_stage_terms(axes, poses);
    input.repeatability = declared_repeatability(axes, poses, mount);
    input.error_maps = declared_error_maps(axes, poses, mount);
    input.axis_motions = stage_axis_motions(axes, poses);
    input.poses = std::move(poses);
    return input;
}

}  // namespace etalon
