#include "station/qualify/run_analysis.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/image/picture_codec.h"
#include "station/planning/expectation_report.h"
#include "station/record/run_json.h"
#include "station/record/run_record.h"
#include "station/register/qualification_input.h"

namespace etalon {
namespace {

// On the scale of the renders: the marker's white is `white_level`.
PhotoResidual residual_of(const CodeImage& photo, const StationFile& station,
                          const ComparedArea& area, const PhotometricCamera& camera,
                          const Rigid& camera_from_marker) {
    CellGrid marker = station.marker.grid;
    marker.cells = cv::Mat(marker.cells * station.white_level);  // not in the station's own cells
    const PhotoOfMarker seen{gray_of(photo), marker,
                             pixel_uses(camera.projector(), camera_from_marker, area), pixel_fitted,
                             station.background * station.white_level};
    const PhotoFit fit = fit_photometry(seen, camera, camera_from_marker);
    return {fit.scored.rms_gray, fit.scored.p99_gray, fit.state.photometry.psf_sigma_px};
}

// Each hold-out photograph against its render at the registered pose. The renders are kept.
void compare_photos(QualifyResult& result, const ExpectedView& view, Progress& progress,
                    const std::stop_token& stop) {
    const StationFile& station = result.station;
    const PhotometricCamera camera(station.camera.model);
    const ComparedArea area = compared_area(station.marker, {}, station.marker.spec);
    std::vector<AnalysedPose*> judged;
    for (AnalysedPose& pose : result.poses)
        if (pose.is_judged())
            judged.push_back(&pose);
    std::vector<std::string> refusals(judged.size());
    tbb::parallel_for(std::size_t{0}, judged.size(), [&](std::size_t i) {
        throw_if_stopped(stop);
        AnalysedPose& pose = *judged[i];
        pose.render_file = fmt::format("renders/{:04}.png", pose.index);
        const std::vector<unsigned char> png = encode_png(view.at(pose.bias.predicted).pixels);
        write_text(result.folder / pose.render_file, std::string(png.begin(), png.end()));
        const CodeImage photo = recorded_photo(result, *first_whole(pose));
        auto residual = attempted(
            [&] { return residual_of(photo, station, area, camera, pose.bias.predicted); });
        if (residual)
            pose.residual = *residual;
        refusals[i] = residual.cause;
    });
    for (std::size_t i = 0; i < judged.size(); ++i) {
        if (!refusals[i].empty())
            result.remarks.push_back(
                fmt::format("pose {} has no pixel difference: {}", judged[i]->index, refusals[i]));
        progress.step();
    }
}

// Where no frames tell the noise of corners: what the calibration states makes of them.
void find_stated_noise(std::vector<AnalysedPose>& poses, const RenderedCorners& rendered,
                       const std::stop_token& stop) {
    if (std::ranges::any_of(poses, [](const auto& pose) { return pose.corner_noise.has_value(); }))
        return;
    for (AnalysedPose& pose : poses) {
        throw_if_stopped(stop);
        if (!pose.is_detected() || !pose.seen_at)
            continue;
        if (const auto noise = rendered.noise_at(*pose.seen_at))
            pose.stated_noise = noise;
    }
}

RunOutcome outcome_of(Outcome verdict) {
    if (verdict == Outcome::pass)
        return RunOutcome::pass;
    return verdict == Outcome::fail ? RunOutcome::fail : RunOutcome::inconclusive;
}

void attach_all(QualifyResult& result) {
    result.attachments.clear();
    // A file that could not be written has no hash: the run says so elsewhere.
    const auto attach = [&](const std::string& path) {
        std::error_code ignored;
        if (std::filesystem::is_regular_file(result.folder / path, ignored))
            result.attachments.push_back({path, sha256_of_file(result.folder / path)});
    };
    for (const char* file : {log_file, "poses.csv", "convergence.csv", "junit.xml", "report.html"})
        attach(file);
    for (const InputFile& input : result.station.inputs)
        result.attachments.push_back({input.copy, input.sha256});
    for (const AnalysedPose& pose : result.poses) {
        for (const FrameRecord& frame : pose.frames)
            if (!frame.file.empty())
                result.attachments.push_back({frame.file, frame.sha256});
        if (!pose.render_file.empty())
            attach(pose.render_file);
    }
}

// Of the frames of one pose, as poses.
std::optional<SixErrors> noise_of(const AnalysedPose& pose,
                                  const std::vector<Eigen::Vector3d>& points_mm,
                                  const Projector& projector) {
    const Rigid& predicted = pose.bias.predicted;
    std::vector<SixErrors> errors;
    for (const FrameRecord& frame : pose.frames) {
        if (frame.corners.empty())
            continue;
        const PoseBias bias = pose_bias(projector, points_mm, predicted, frame.corners, {});
        if (bias.b2)
            errors.push_back(components_of(*bias.b2, predicted));
    }
    return deviations_of(errors);
}

}  // namespace

void analyse_run(QualifyResult& result, PhotometricPoses& photometric, Progress& progress,
                 const std::stop_token& stop) {
    const StationFile& station = result.station;
    photometric.set_in(result);
    find_stated_noise(result.poses, photometric.rendered(), stop);
    QualificationInput input =
        declared_input(station, {result.poses.begin(), result.poses.end()}, result.environment);
    input.options.monte_carlo = true;
    input.options.stop = stop;
    input.options.look_for_causes = true;
    input.pixels = match_pixels(photometric.pixels(), station.camera.model);
    input.render_and_detect = [&](const Rigid& camera_from_marker) {
        throw_if_stopped(stop);
        return photometric.rendered().at(camera_from_marker);
    };
    const auto hold_out = std::ranges::count(result.poses, true, &AnalysedPose::hold_out);
    progress.begin("analysing", static_cast<int>(hold_out));
    result.analysis = qualify(input);
    result.poses = std::move(result.analysis->poses);
    compare_photos(result, photometric.rendered().view(), progress, stop);
    result.outcome = outcome_of(result.analysis->verdict);
    result.reason.clear();
    progress.end();
}

void write_results(QualifyResult& result) {
    write_text(result.folder / "poses.csv", poses_csv(result));
    write_text(result.folder / "convergence.csv", convergence_csv(result));
    write_text(result.folder / "junit.xml", junit_xml(result));
    write_qualify_report(result, result.folder / "report.html");
    attach_all(result);
    write_text(result.folder / "run.json", run_json(result));
}

Expectation run_expectation(const QualifyResult& result) {
    Expectation expectation;
    if (!result.analysis)
        return expectation;
    const Projector projector(result.station.camera.model);
    expectation.frames = result.station.plan.frames;
    for (const AnalysedPose& pose : result.poses) {
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
    expectation.fit_maps(result.station.plan.seed);
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
