#include "study/study_evaluation.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "calib/files/camera_file.h"
#include "core/file/text.h"

namespace etalon {
namespace {

// Detectors are right to some tenths of a pixel: what a photometric fit starts from.
constexpr double detector_error_px = 0.5;

constexpr const char* no_pose = "its corners determine no pose in front of the camera";

// Adds the CPU time of its life to a sum.
class Stopwatch {
public:
    explicit Stopwatch(double& sum_ms) : sum_ms_(sum_ms), start_ms_(thread_cpu_ms()) {}
    ~Stopwatch() { sum_ms_ += thread_cpu_ms() - start_ms_; }
    Stopwatch(const Stopwatch&) = delete;
    Stopwatch& operator=(const Stopwatch&) = delete;

private:
    double& sum_ms_;
    double start_ms_;
};

std::vector<cv::Point2f> projected(const Projector& projector,
                                   const std::vector<Eigen::Vector3d>& points_mm,
                                   const Rigid& camera_from_marker) {
    std::vector<cv::Point2f> pixels;
    for (const Eigen::Vector3d& point : points_mm)
        if (const auto pixel = projector.project(camera_from_marker * point))
            pixels.emplace_back(static_cast<float>(pixel->x()), static_cast<float>(pixel->y()));
    return pixels;
}

// Root of the area of the points' convex hull; of a bitmap without points, of its corners'.
double apparent_size_px(const Projector& projector, const Marker& marker,
                        const Rigid& camera_from_marker) {
    std::vector<Eigen::Vector3d> points = marker.points_mm;
    if (points.empty())
        for (const auto& [column, row] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}})
            points.push_back(
                marker.grid.point_mm(column * marker.grid.columns(), row * marker.grid.rows()));
    std::vector<cv::Point2f> hull;
    const auto pixels = projected(projector, points, camera_from_marker);
    if (pixels.size() < 3)
        return 0.0;
    cv::convexHull(pixels, hull);
    return std::sqrt(cv::contourArea(hull));
}

// Nothing where a true point has no pixel.
std::optional<double> corner_rms_px(const Projector& projector,
                                    const std::vector<Eigen::Vector3d>& points_mm,
                                    const DetectedCorners& corners, const Rigid& truth) {
    double sum = 0.0;
    for (std::size_t i = 0; i < points_mm.size(); ++i) {
        const auto pixel = projector.project(truth * points_mm[i]);
        if (!pixel)
            return std::nullopt;
        sum += (corners.pixels[i] - *pixel).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(points_mm.size()));
}

// What an image shows of the switches: poses are estimated with the others.
StudySwitches seen_in_images(StudySwitches switches) {
    for (const StudySwitch one : {StudySwitch::half_pixel, StudySwitch::undistortion})
        if (switches.has(one))
            switches.toggle(one);
    return switches;
}

bool disturbs_radiance(const Disturbances& d) {
    Disturbances before_sensor = d;
    before_sensor.jpeg_quality = Disturbances{}.jpeg_quality;
    return std::ranges::any_of(disturbance_axes, [&](const DisturbanceAxis& axis) {
        return before_sensor.*axis.value != axis.neutral();
    });
}

}  // namespace

std::vector<StudyVariant> study_variants(const StudyFile& study,
                                         const std::vector<std::string>& ablations) {
    std::vector<StudyVariant> variants{{"as is", study.switched}};
    for (const std::string& name : ablations) {
        if (std::ranges::count(ablations, name) > 1)
            throw ConfigError({"--ablate"}, "names " + name + " twice");
        StudyVariant variant{name, study.switched};
        variant.switches.toggle(parse_study_switch(name, {"--ablate"}));
        imaging_camera(study.camera, variant.switches, {"--ablate"});
        variants.push_back(variant);
    }
    return variants;
}

void StudyTimes::add(const StudyTimes& other) {
    render += other.render;
    sensor += other.sensor;
    estimate += other.estimate;
    detectors.resize(std::max(detectors.size(), other.detectors.size()));
    for (std::size_t i = 0; i < other.detectors.size(); ++i)
        detectors[i] += other.detectors[i];
}

// --------------------------------------------------------------------------------------- optics

StudyOptics::StudyOptics(const StudyFile& study, std::vector<StudyVariant> variants)
    : study_(study), variants_(std::move(variants)), true_projector_(study.camera) {
    photometric_.resize(variants_.size() * study_.detectors.size());
    for (std::size_t variant = 0; variant < variants_.size(); ++variant) {
        add_imaging(variant);
        projectors_.emplace_back(
            etalon::estimation_camera(study_.camera, variants_[variant].switches));
        add_photometric(variant);
    }
    const auto uses = [&](bool sharp) {
        return std::ranges::any_of(imagings_, [&](const auto& i) { return i.sharp == sharp; });
    };
    if (uses(true)) {
        CameraModel sharp = study_.camera;
        sharp.lens.reset();
        sharp_.emplace_back(sharp);
    }
    if (uses(false) && study_.focus_mm.empty())
        lens_.emplace_back(study_.camera);
    for (const double focus_mm : study_.focus_mm)
        if (uses(false)) {
            CameraModel focused = study_.camera;
            focused.lens->focus_distance_mm = focus_mm;
            lens_.emplace_back(focused);
        }
}

void StudyOptics::add_imaging(std::size_t variant) {
    const StudySwitches seen = seen_in_images(variants_[variant].switches);
    for (Imaging& imaging : imagings_)
        if (seen == seen_in_images(variants_[imaging.variants.front()].switches))
            return imaging.variants.push_back(variant);
    const CameraModel camera = imaging_camera(study_.camera, seen, {study_.id});
    SensorModel sensor(camera);
    Disturber disturber(camera, sensor);
    imagings_.push_back(
        {camera, std::move(sensor), std::move(disturber), seen.has(StudySwitch::blur), {variant}});
}

void StudyOptics::add_photometric(std::size_t variant) {
    const StudySwitches& switches = variants_[variant].switches;
    const CameraModel camera =
        etalon::estimation_camera(imaging_camera(study_.camera, switches, {study_.id}), switches);
    for (std::size_t i = 0; i < study_.detectors.size(); ++i)
        if (study_.detectors[i].detector == "photometric")
            photometric_[variant * study_.detectors.size() + i] =
                std::make_unique<const PhotometricDetector>(camera, study_.detectors[i].marker,
                                                            study_.detectors[i].name);
}

RenderedPart StudyOptics::radiance(const Marker& marker, const StudyPose& pose, bool sharp) const {
    const Renderer& renderer = sharp ? sharp_.front() : lens_.at(pose.focus);
    RenderedPart part =
        renderer.render_part({{{marker.grid, pose.camera_from_marker}}, study_.background});
    if (study_.white_level != 1.0) {
        part.radiance = part.radiance * study_.white_level;
        part.background *= study_.white_level;
    }
    return part;
}

CodeImage StudyOptics::image(const RenderedPart& radiance, const Marker& marker,
                             const StudyPose& pose, const Imaging& imaging) const {
    const NoiseKey key{study_.poses.seed, static_cast<std::uint32_t>(pose.index)};
    const bool has_noise = imaging.camera.sensor && imaging.camera.sensor->gain_e_per_dn > 0.0;
    const std::optional<NoiseKey> noise = has_noise ? std::optional(key) : std::nullopt;
    if (!disturbs_radiance(pose.disturbances))
        return compressed(imaging.sensor.expose(radiance, noise), pose.disturbances.jpeg_quality);
    const cv::Rect all(0, 0, imaging.camera.width, imaging.camera.height);
    const Radiance disturbed = imaging.disturber.disturbed(
        radiance.within(all), {marker.grid, pose.camera_from_marker}, pose.disturbances, key);
    return compressed(imaging.sensor.expose(disturbed, noise), pose.disturbances.jpeg_quality);
}

// --------------------------------------------------------------------------------------- worker

StudyWorker::StudyWorker(const StudyOptics& optics, const std::filesystem::path& scratch)
    : optics_(optics), scratch_(scratch) {
    const std::vector<StudiedDetector>& detectors = optics.study().detectors;
    times_.detectors.resize(detectors.size());
    for (std::size_t i = 0; i < detectors.size(); ++i) {
        const StudiedDetector& one = detectors[i];
        const bool is_external = one.detector == "external";
        finders_.push_back(is_external ? nullptr : one.make_finder());
        externals_.push_back(
            is_external ? std::make_unique<ExternalDetector>(one.command, one.time_out, one.name)
                        : nullptr);
        const auto same = std::ranges::find_if(by_marker_, [&](const auto& group) {
            return detectors[group.front()].marker.spec == one.marker.spec;
        });
        if (same == by_marker_.end())
            by_marker_.push_back({i});
        else
            same->push_back(i);
    }
    if (std::ranges::none_of(externals_, [](const auto& e) { return e != nullptr; }))
        return;
    make_folder(scratch_);
    for (std::size_t variant = 0; variant < optics.variants().size(); ++variant)
        write_camera(scratch_ / fmt::format("camera-{}.yml", variant),
                     optics.estimation_camera(variant));
}

std::vector<StudyFinding> StudyWorker::evaluate(const StudyPose& pose) {
    const StudyFile& study = optics_.study();
    std::vector<StudyFinding> findings(optics_.variants().size() * study.detectors.size());
    for (const std::vector<std::size_t>& detectors : by_marker_) {
        evaluate_marker(detectors, pose, findings);
        const double size_px =
            apparent_size_px(optics_.true_projector(), study.detectors[detectors.front()].marker,
                             pose.camera_from_marker);
        for (const std::size_t detector : detectors)
            for (std::size_t variant = 0; variant < optics_.variants().size(); ++variant)
                findings[variant * study.detectors.size() + detector].size_px = size_px;
    }
    return findings;
}

void StudyWorker::evaluate_marker(const std::vector<std::size_t>& detectors, const StudyPose& pose,
                                  std::vector<StudyFinding>& findings) {
    const StudyFile& study = optics_.study();
    const Marker& marker = study.detectors[detectors.front()].marker;
    std::array<std::optional<RenderedPart>, 2> radiance;  // through the lens, without it
    for (const StudyOptics::Imaging& imaging : optics_.imagings()) {
        auto image = attempted([&] {
            auto& part = radiance[imaging.sharp ? 1 : 0];
            if (!part) {
                const Stopwatch watch(times_.render);
                part = optics_.radiance(marker, pose, imaging.sharp);
            }
            const Stopwatch watch(times_.sensor);
            return optics_.image(*part, marker, pose, imaging);
        });
        if (!image) {
            for (const std::size_t variant : imaging.variants)
                for (const std::size_t detector : detectors)
                    findings[variant * study.detectors.size() + detector] = {
                        .failure = fmt::format("not rendered: {}", image.cause)};
            continue;
        }
        for (const std::size_t detector : detectors)
            judge_image(*image, imaging, detector, pose, findings);
    }
}

void StudyWorker::judge_image(const CodeImage& image, const StudyOptics::Imaging& imaging,
                              std::size_t detector, const StudyPose& pose,
                              std::vector<StudyFinding>& findings) {
    const std::size_t detectors = optics_.study().detectors.size();
    const bool is_external = externals_[detector] != nullptr;
    Detection sighting;
    if (!is_external) {
        const Stopwatch watch(times_.detectors[detector]);
        sighting = finders_[detector]->detect(image);
    }
    std::map<bool, std::size_t> photometric;  // by undistortion: corners do not come into it
    for (const std::size_t variant : imaging.variants) {
        const Rigid& truth = pose.camera_from_marker;
        StudyFinding& finding = findings[variant * detectors + detector];
        if (is_external) {
            finding = judge_external(image, variant, detector, truth);
        } else if (!optics_.photometric(variant, detector)) {
            finding = judge_corners(sighting, variant, detector, truth);
        } else {
            const bool undistortion =
                optics_.variants()[variant].switches.has(StudySwitch::undistortion);
            const auto [same, is_first] = photometric.try_emplace(undistortion, variant);
            finding = is_first ? judge_photometric(image, sighting, variant, detector, truth)
                               : findings[same->second * detectors + detector];
        }
    }
}

StudyFinding StudyWorker::judge_corners(const Detection& sighting, std::size_t variant,
                                        std::size_t detector, const Rigid& truth) {
    const Stopwatch watch(times_.estimate);
    const StudiedDetector& one = optics_.study().detectors[detector];
    if (!sighting.corners)
        return {.failure = sighting.reason};
    DetectedCorners corners = *sighting.corners;
    if (optics_.variants()[variant].switches.has(StudySwitch::half_pixel))
        for (Eigen::Vector2d& pixel : corners.pixels)
            pixel.array() += finders_[detector]->library_offset_px();
    const std::vector<Eigen::Vector3d> points = seen_points_mm(one.marker, corners);
    const auto estimate = estimate_pose(optics_.projector(variant), points, corners.pixels);
    if (!estimate)
        return {.failure = no_pose};
    return {.error = detected_error(estimate->camera_from_marker, truth, is_flip(*estimate, truth)),
            .corner_rms_px = corner_rms_px(optics_.true_projector(), points, corners, truth)};
}

StudyFinding StudyWorker::judge_photometric(const CodeImage& image, const Detection& sighting,
                                            std::size_t variant, std::size_t detector,
                                            const Rigid& truth) {
    if (!sighting.corners)
        return {.failure = sighting.reason};
    const Stopwatch watch(times_.detectors[detector]);
    const auto start =
        estimate_pose(optics_.projector(variant),
                      seen_points_mm(optics_.study().detectors[detector].marker, *sighting.corners),
                      sighting.corners->pixels);
    if (!start)
        return {.failure = no_pose};
    auto pose = attempted([&] {
        return optics_.photometric(variant, detector)
            ->find(image, start->camera_from_marker, detector_error_px);
    });
    if (!pose)
        return {.failure = pose.cause};
    const auto angle = [&](const Rigid& one) {
        return one.rotation.angularDistance(truth.rotation);
    };
    const bool flip =
        pose->other && angle(pose->other->camera_from_marker) < angle(pose->camera_from_marker);
    return {.error = detected_error(pose->camera_from_marker, truth, flip)};
}

StudyFinding StudyWorker::judge_external(const CodeImage& image, std::size_t variant,
                                         std::size_t detector, const Rigid& truth) {
    const Stopwatch watch(times_.detectors[detector]);
    const std::filesystem::path file = scratch_ / "image.png";
    write_image(file, image);
    const ExternalAnswer answer =
        externals_[detector]->detect(file, scratch_ / fmt::format("camera-{}.yml", variant));
    if (!answer.camera_from_marker)
        return {.failure = answer.failure};
    return {.error = detected_error(*answer.camera_from_marker, truth, /*flip=*/false)};
}

}  // namespace etalon
