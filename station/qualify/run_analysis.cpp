#include "station/qualify/run_analysis.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>

#include "compare/photometric/photo_match.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "station/register/qualification_input.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

void throw_if_stopped(const std::stop_token& stop) {
    if (stop.stop_requested())
        throw Interrupted();
}

std::string png_of(const CodeImage& image) {
    std::vector<unsigned char> bytes;
    cv::imencode(".png", image.pixels, bytes);
    return {bytes.begin(), bytes.end()};
}

// On the scale of the renders: the marker's white is `white_level`.
PhotoResidual residual_of(const CodeImage& photo, const StationFile& station,
                          const ComparedArea& area, const PhotometricCamera& camera,
                          const Rigid& camera_from_marker) {
    CellGrid marker = station.marker.grid;
    marker.cells = cv::Mat(marker.cells * station.white_level);  // not in the station's own cells
    const PhotoOfMarker seen{gray_of(photo), marker,
                             pixel_uses(camera.projector(), camera_from_marker, area), pixel_fitted,
                             station.background * station.white_level};
    const PixelDifference difference = fit_photometry(seen, camera, camera_from_marker).difference;
    return {difference.scored.rms_gray, difference.scored.p99_gray, difference.model.psf_sigma_px};
}

std::vector<Pose*> judged_poses(std::vector<Pose>& poses) {
    std::vector<Pose*> judged;
    for (Pose& pose : poses)
        if (pose.is_judged())
            judged.push_back(&pose);
    return judged;
}

// Each hold-out photograph against the calibration at its registered pose. The renders are kept,
// for people and for re-analysis.
void compare_photos(QualifyResult& result, const ExpectedView& view, Progress& progress,
                    const std::stop_token& stop) {
    const StationFile& station = result.station;
    const PhotometricCamera camera(station.camera.model);
    const ComparedArea area = compared_area(station.marker, {}, station.marker.spec);
    const std::vector<Pose*> judged = judged_poses(result.poses);
    std::vector<std::string> refusals(judged.size());
    tbb::parallel_for(std::size_t{0}, judged.size(), [&](std::size_t i) {
        throw_if_stopped(stop);
        Pose& pose = *judged[i];
        pose.render_file = fmt::format("renders/{:04}.png", pose.index);
        write_text(result.folder / pose.render_file, png_of(view.at(pose.bias.predicted)));
        try {
            pose.residual = residual_of(recorded_photo(result, *first_whole(pose)), station, area,
                                        camera, pose.bias.predicted);
        } catch (const NumericalError& error) {
            refusals[i] = error.what();
        }
    });
    for (std::size_t i = 0; i < judged.size(); ++i) {
        if (!refusals[i].empty())
            result.remarks.push_back(
                fmt::format("pose {} has no pixel difference: {}", judged[i]->index, refusals[i]));
        progress.step();
    }
}

// Where no frames tell the noise of corners: what the calibration states makes of them.
void find_stated_noise(std::vector<Pose>& poses, const RenderedCorners& rendered,
                       const std::stop_token& stop) {
    if (std::ranges::any_of(poses, [](const Pose& pose) { return pose.corner_noise.has_value(); }))
        return;
    for (Pose& pose : poses) {
        throw_if_stopped(stop);
        if (!pose.is_detected() || !pose.seen_at)
            continue;
        if (const auto noise = rendered.noise_at(*pose.seen_at))
            pose.stated_noise = CornerNoise{noise->variance_px2, noise->degrees_of_freedom};
    }
}

RunOutcome outcome_of(Outcome verdict) {
    if (verdict == Outcome::pass)
        return RunOutcome::pass;
    return verdict == Outcome::fail ? RunOutcome::fail : RunOutcome::inconclusive;
}

}  // namespace

void analyse_run(QualifyResult& result, PhotometricPoses& photometric, Progress& progress,
                 const std::stop_token& stop) {
    const StationFile& station = result.station;
    photometric.set_in(result);
    find_stated_noise(result.poses, photometric.rendered(), stop);
    QualificationInput input = declared_input(station, result.poses, result.environment);
    input.monte_carlo = true;
    input.look_for_causes = true;
    input.pixels = match_pixels(photometric.pixels(), station.camera.model);
    input.render_and_detect = [&](const Rigid& camera_from_marker) {
        throw_if_stopped(stop);
        return photometric.rendered().at(camera_from_marker);
    };
    const auto hold_out = std::ranges::count(result.poses, true, &Pose::hold_out);
    progress.begin("analysing", static_cast<int>(hold_out), hold_out * 10ms);
    result.analysis = qualify(input);
    result.poses = std::move(input.poses);
    compare_photos(result, photometric.rendered().view(), progress, stop);
    result.outcome = outcome_of(result.analysis->verdict);
    result.reason.clear();
    progress.end();
}

}  // namespace etalon
