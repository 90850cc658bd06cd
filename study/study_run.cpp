#include "study/study_run.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <opencv2/imgproc.hpp>

#include "calib/files/camera_file.h"
#include "core/file/text.h"
#include "core/program/ordered_pipeline.h"
#include "study/external_detector.h"

namespace etalon {
namespace {

// The poses of a study one after another, with what is drawn along with them.
class StudyPoseSource {
public:
    explicit StudyPoseSource(const StudyFile& study) : study_(study) {
        const int extra = static_cast<int>(study.disturbances.size()) + !study.focus_mm.empty();
        const StudyPoses& poses = study.poses;
        if (!poses.file.empty() && extra > 0)
            sequence_.emplace(poses.sequence, extra, poses.seed);
        if (!poses.file.empty())
            return;
        std::vector<CellGrid> grids;
        for (const StudiedDetector& one : study.detectors)
            grids.push_back(one.marker.grid);
        sampler_.emplace(study.camera, grids, poses.volume, poses.sequence, poses.seed, extra);
    }

    std::size_t next_index() const { return index_; }

    StudyPose next() {
        StudyPose pose;
        pose.index = index_++;
        std::vector<double> drawn;
        if (sampler_) {
            const PoseSampler::Sample sample = sampler_->next();
            pose.camera_from_marker = sample.camera_from_marker;
            drawn = sample.extra;
        } else {
            pose.camera_from_marker = study_.poses.listed.at(pose.index);
            if (sequence_)
                drawn = sequence_->point(pose.index + 1);
        }
        for (std::size_t i = 0; i < study_.disturbances.size(); ++i)
            pose.disturbances.*study_.disturbances[i].axis->value =
                study_.disturbances[i].values.at(drawn[i]);
        if (!study_.focus_mm.empty())
            pose.focus = static_cast<std::size_t>(drawn.back() *
                                                  static_cast<double>(study_.focus_mm.size()));
        return pose;
    }

private:
    const StudyFile& study_;
    std::size_t index_ = 0;
    std::optional<PoseSampler> sampler_;
    std::optional<PointSequence> sequence_;
};

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

// Root of the area of the points' convex hull; of a bitmap without points, of its corners'.
double apparent_size_px(const Projector& projector, const Marker& marker,
                        const Rigid& camera_from_marker) {
    std::vector<Eigen::Vector3d> points = marker.points_mm;
    if (points.empty())
        for (const auto& [column, row] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}})
            points.push_back(
                marker.grid.point_mm(column * marker.grid.columns(), row * marker.grid.rows()));
    std::vector<cv::Point2f> pixels, hull;
    for (const Eigen::Vector3d& point : points)
        if (const auto pixel = projector.project(camera_from_marker * point))
            pixels.emplace_back(static_cast<float>(pixel->x()), static_cast<float>(pixel->y()));
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

// One thread's detectors.
class StudyWorker {
public:
    // External programs get their images as files in `scratch`, a folder of this worker's own.
    // Throws ConfigError when one cannot be started. `optics` must outlive it.
    StudyWorker(const StudyOptics& optics, const std::filesystem::path& scratch)
        : optics_(optics), scratch_(scratch) {
        const std::vector<StudiedDetector>& detectors = optics.study().detectors;
        times_.detectors.resize(detectors.size());
        for (std::size_t i = 0; i < detectors.size(); ++i) {
            const StudiedDetector& one = detectors[i];
            const bool is_external = one.detector == "external";
            finders_.push_back(is_external ? nullptr : one.make_finder());
            externals_.push_back(is_external ? std::make_unique<ExternalDetector>(
                                                   one.command, one.time_out, one.name)
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

    // By variant, then by detector. A pure function of the pose, however it is called (as far as
    // external programs are). A render that is refused is a failure in words of all that needed it.
    std::vector<StudyFinding> evaluate(const StudyPose& pose) {
        const StudyFile& study = optics_.study();
        std::vector<StudyFinding> findings(optics_.variants().size() * study.detectors.size());
        for (const std::vector<std::size_t>& detectors : by_marker_) {
            evaluate_marker(detectors, pose, findings);
            const double size_px = apparent_size_px(optics_.true_projector(),
                                                    study.detectors[detectors.front()].marker,
                                                    pose.camera_from_marker);
            for (const std::size_t detector : detectors)
                for (std::size_t variant = 0; variant < optics_.variants().size(); ++variant)
                    findings[variant * study.detectors.size() + detector].size_px = size_px;
        }
        return findings;
    }

    const StudyTimes& times() const { return times_; }

private:
    void evaluate_marker(const std::vector<std::size_t>& detectors, const StudyPose& pose,
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

    void judge_image(const CodeImage& image, const StudyOptics::Imaging& imaging,
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
                    optics_.variants()[variant].switches.contains(StudySwitch::undistortion);
                const auto [same, is_first] = photometric.try_emplace(undistortion, variant);
                finding = is_first ? judge_photometric(image, sighting, variant, detector, truth)
                                   : findings[same->second * detectors + detector];
            }
        }
    }

    StudyFinding judge_corners(const Detection& sighting, std::size_t variant, std::size_t detector,
                               const Rigid& truth) {
        const Stopwatch watch(times_.estimate);
        const StudiedDetector& one = optics_.study().detectors[detector];
        if (!sighting.corners)
            return {.failure = sighting.reason};
        DetectedCorners corners = *sighting.corners;
        if (optics_.variants()[variant].switches.contains(StudySwitch::half_pixel))
            for (Eigen::Vector2d& pixel : corners.pixels)
                pixel.array() += finders_[detector]->library_offset_px();
        const std::vector<Eigen::Vector3d> points = seen_points_mm(one.marker, corners);
        const auto estimate = estimate_pose(optics_.projector(variant), points, corners.pixels);
        if (!estimate)
            return {.failure = no_pose};
        return {
            .error = detected_error(estimate->camera_from_marker, truth, is_flip(*estimate, truth)),
            .corner_rms_px = corner_rms_px(optics_.true_projector(), points, corners, truth)};
    }

    StudyFinding judge_photometric(const CodeImage& image, const Detection& sighting,
                                   std::size_t variant, std::size_t detector, const Rigid& truth) {
        if (!sighting.corners)
            return {.failure = sighting.reason};
        const Stopwatch watch(times_.detectors[detector]);
        const auto start = estimate_pose(
            optics_.projector(variant),
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

    StudyFinding judge_external(const CodeImage& image, std::size_t variant, std::size_t detector,
                                const Rigid& truth) {
        const Stopwatch watch(times_.detectors[detector]);
        const std::filesystem::path file = scratch_ / "image.png";
        write_image(file, image);
        const ExternalAnswer answer =
            externals_[detector]->detect(file, scratch_ / fmt::format("camera-{}.yml", variant));
        if (!answer.camera_from_marker)
            return {.failure = answer.failure};
        return {.error = detected_error(*answer.camera_from_marker, truth, /*flip=*/false)};
    }

    const StudyOptics& optics_;
    std::filesystem::path scratch_;
    std::vector<std::unique_ptr<Detector>> finders_;            // null of external ones
    std::vector<std::unique_ptr<ExternalDetector>> externals_;  // null of others
    std::vector<std::vector<std::size_t>> by_marker_;           // detectors that share a marker
    StudyTimes times_;
};

struct EvaluatedPose {
    StudyPose pose;
    std::vector<StudyFinding> findings;
};

// Of the external detectors' images.
struct ScratchFolder {
    std::filesystem::path path;

    ~ScratchFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
};

}  // namespace

StudyRun run_study(const StudyOptics& optics, const Shard& shard, StudyRecord& record,
                   std::stop_token stop, Progress& progress) {
    const StudyFile& study = optics.study();
    const double cpu_start = process_cpu_ms();
    const auto start = std::chrono::steady_clock::now();
    const auto poses = static_cast<std::size_t>(study.poses.count);
    const std::size_t of = shard.units(poses), before = record.poses_done();
    StudyPoseSource source(study);
    for (std::size_t done = 0; done < before;)
        done += shard.holds(source.next().index);
    const ScratchFolder scratch{record.folder() / "scratch"};
    std::atomic<int> worker_count = 0;
    tbb::enumerable_thread_specific<StudyWorker> workers(
        [&] { return StudyWorker(optics, scratch.path / fmt::format("{}", ++worker_count)); });
    tbb::enumerable_thread_specific<tbb::task_arena> serial([] { return tbb::task_arena(1); });
    workers.local();  // whether its programs can be started

    const auto next_pose = [&]() -> std::optional<StudyPose> {
        while (source.next_index() < poses && !stop.stop_requested()) {
            const StudyPose pose = source.next();
            if (shard.holds(pose.index))
                return pose;
        }
        return std::nullopt;
    };
    // A pose is one task in an arena of one thread: tasks inside it would only wait for each other,
    // and a waiting thread must not begin another pose with its detectors.
    const auto evaluate = [&](const StudyPose& pose) {
        StudyWorker& worker = workers.local();
        return serial.local().execute([&] { return EvaluatedPose{pose, worker.evaluate(pose)}; });
    };
    const auto keep = [&](const EvaluatedPose& evaluated) {
        std::vector<double> values;
        for (const StudiedDisturbance& one : study.disturbances)
            values.push_back(evaluated.pose.disturbances.*one.axis->value);
        if (!study.focus_mm.empty())
            values.push_back(study.focus_mm[evaluated.pose.focus]);
        record.add(evaluated.pose, values, evaluated.findings);
        progress.step();
    };
    if (before < of)
        progress.begin("study", static_cast<int>(of - before));
    process_in_order(next_pose, evaluate, keep);
    progress.end();

    StudyRun result{.poses = record.poses_done() - before, .complete = record.poses_done() == of};
    for (const StudyWorker& worker : workers)
        result.times.add(worker.times());
    result.cpu_ms = process_cpu_ms() - cpu_start;
    const std::chrono::duration<double, std::milli> wall = std::chrono::steady_clock::now() - start;
    result.wall_ms = wall.count();
    return result;
}

}  // namespace etalon
