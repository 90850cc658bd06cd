#include "station/qualify/photometric_poses.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace etalon {
namespace {

constexpr double min_log_likelihood = 3;  // below it the other planar solution is as good

// Of a pose's frames: they see the same, with noise that is independent.
PhotometricReading mean_of(const std::vector<PhotometricPose>& poses) {
    const auto n = static_cast<double>(poses.size());
    const Rigid& first = poses.front().camera_from_marker;
    Vector6d mean = Vector6d::Zero();
    Matrix6d covariance = Matrix6d::Zero();
    for (const PhotometricPose& pose : poses) {
        mean += left_difference(first, pose.camera_from_marker) / n;
        covariance += pose.covariance / (n * n);
    }
    return {left_perturbed(first, mean), covariance};
}

void require_unambiguous(const PhotometricPose& pose) {
    if (!pose.converged)
        throw NumericalError("the fit does not settle");
    if (pose.other && pose.other->log_likelihood_ratio < min_log_likelihood)
        throw NumericalError("both planar solutions match the photograph");
}

std::vector<PhotoFinding> in_words(const Findings& findings) {
    std::vector<PhotoFinding> all;
    for (const Finding& finding : findings)
        all.push_back({finding.name, finding.sentence});
    return all;
}

}  // namespace

PhotometricPoses::PhotometricPoses(const QualifyResult& result, std::stop_token stop)
    : run_(result),
      stop_(std::move(stop)),
      detector_(result.station.camera.model, result.station.marker, result.station.marker.spec,
                result.station.background),
      rendered_(expected_scene(result.station), result.station.plan.frames,
                result.station.plan.seed),
      area_(compared_area(result.station.marker, {}, result.station.marker.spec)),
      calibration_(result.station.camera.model),
      kept_(result) {
    if (result.station.marker.kind != Marker::Kind::chessboard)
        whole_ = area_;
}

PhotometricPoses::~PhotometricPoses() {
    tasks_.cancel();
    try {
        tasks_.wait();
    } catch (const std::exception&) {
        // not needed any more
    }
}

void PhotometricPoses::add(const VisitedPose& pose) {
    if (!pose.is_detected() || found_.contains(pose.index))
        return;
    ImageResultCache& found = found_[pose.index];
    if (const KeptPose* kept = kept_.of(pose); kept && kept->pixels) {
        found = *kept->pixels;
        return;
    }
    tasks_.run([this, pose, &found] {
        if (stop_.stop_requested())
            return;
        if (const auto done = attempted([&] { find(pose, found); }); !done)
            found.refusal = done.cause;
    });
}

PhotometricPose PhotometricPoses::seen_in(const FrameRecord& frame, const Rigid& start) const {
    return detector_.find(recorded_photo(run_, frame), start,
                          PhotometricDetector::detector_error_px);
}

void PhotometricPoses::find(const VisitedPose& pose, ImageResultCache& found) const {
    const auto start =
        estimate_pose(detector_.camera()->projector(), run_.station.marker.points_mm, pose.corners);
    if (!start)
        throw NumericalError("its corners determine no pose to start from");
    if (pose.hold_out)
        return read(pose, found, start->camera_from_marker);
    const PhotometricPose seen = seen_in(*first_whole(pose), start->camera_from_marker);
    require_unambiguous(seen);
    find_bias(found, seen.camera_from_marker);
}

void PhotometricPoses::read(const VisitedPose& pose, ImageResultCache& found,
                            const Rigid& start) const {
    const CodeImage first = recorded_photo(run_, *first_whole(pose));
    found.findings = in_words(
        examine_marker(first, run_.station.marker, area_, detector_.camera()->projector(), start));
    std::vector<PhotometricPose> poses;
    for (const FrameRecord& frame : pose.frames)
        if (!frame.file.empty())
            poses.push_back(seen_in(frame, start));
    const auto compared = attempted([&] { compare(found, first, poses.front()); });
    for (const PhotometricPose& seen : poses)
        require_unambiguous(seen);
    found.reading = mean_of(poses);
    find_bias(found, found.reading->camera_from_marker);
    found.refusal = compared.cause;  // its pose holds all the same
}

void PhotometricPoses::find_bias(ImageResultCache& found, const Rigid& camera_from_marker) const {
    const auto corners = rendered_.at(camera_from_marker);
    if (!corners)
        return;
    found.seen_at = camera_from_marker;
    found.detector_bias_px =
        differences(*corners, projected(detector_.camera()->projector(),
                                        run_.station.marker.points_mm, camera_from_marker));
}

// At a pose that a wrong tone curve may keep from settling: it is solved beside the deviations.
void PhotometricPoses::compare(ImageResultCache& found, const CodeImage& image,
                               const PhotometricPose& seen) const {
    const PhotometricCamera& camera = *detector_.camera();
    const Rigid& camera_from_marker = seen.camera_from_marker;
    const Marker& marker = run_.station.marker;
    found.compared_at = camera_from_marker;
    PhotoMatch match;
    match.pose = seen;
    match.refined = fit_photometry(
        {gray_of(image), marker.grid, pixel_uses(camera.projector(), camera_from_marker, area_),
         pixel_fitted, run_.station.background},
        camera, camera_from_marker);
    found.findings = in_words(examine_match(image, marker, area_, camera, match));
    found.pixels = measured(image, camera_from_marker, calibration_, std::nullopt);
}

PhotoEvidence PhotometricPoses::measured(const CodeImage& image, const Rigid& camera_from_marker,
                                         const DeviatingCamera& camera,
                                         std::optional<double> noise_scale) const {
    return camera.measure(detector_.photo_at(gray_of(image), camera_from_marker),
                          camera_from_marker, whole_, noise_scale);
}

RunEvidence PhotometricPoses::pixels() const {
    std::map<int, const VisitedPose*> hold_out;
    for (const VisitedPose& pose : run_.poses)
        if (pose.hold_out && found_.contains(pose.index))
            hold_out[pose.index] = &pose;
    std::vector<const VisitedPose*> compared;
    std::vector<PhotoEvidence> at_zero;
    std::vector<std::vector<PhotoFinding>> findings;
    for (const auto& [index, pose] : hold_out) {
        const ImageResultCache& found = found_.at(index);
        findings.push_back(found.findings);
        if (found.pixels) {
            compared.push_back(pose);
            at_zero.push_back(*found.pixels);
        }
    }
    if (is_overexposed(findings))
        return {.findings = std::move(findings)};
    const CameraModel& model = run_.station.camera.model;
    RunEvidence run = settled_pixels(
        model, std::move(at_zero),
        [&](const PixelDeviation& deviating, std::span<const std::size_t> which,
            std::optional<double> noise_scale) {
            const DeviatingCamera camera(model, deviating);
            std::vector<PhotoEvidence> all(which.size());
            tbb::parallel_for(std::size_t{0}, which.size(), [&](std::size_t i) {
                throw_if_stopped(stop_);
                const VisitedPose& pose = *compared[which[i]];
                all[i] = measured(recorded_photo(run_, *first_whole(pose)),
                                  found_.at(pose.index).compared_at, camera, noise_scale);
            });
            return all;
        });
    run.findings = std::move(findings);
    return run;
}

void PhotometricPoses::set_in(QualifyResult& result) {
    for (const VisitedPose& pose : result.poses)
        add(pose);
    tasks_.wait();
    throw_if_stopped(stop_);
    kept_.keep(found_);
    for (VisitedPose& pose : result.poses) {
        const auto found = found_.find(pose.index);
        if (found == found_.end())
            continue;
        pose.photometric = found->second.reading;
        pose.seen_at = found->second.seen_at;
        pose.detector_bias_px = found->second.detector_bias_px;
        const std::string& refusal = found->second.refusal;
        if (pose.hold_out && !refusal.empty())
            result.remarks.push_back(fmt::format(
                "pose {} {}: {}", pose.index,
                pose.photometric ? "is not among the compared pixels" : "has no photometric pose",
                refusal));
    }
}

}  // namespace etalon
