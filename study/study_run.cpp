#include "study/study_run.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include "core/program/ordered_pipeline.h"

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
    // A pose is one task in an arena of one thread: what renders and detectors do in parallel would
    // only wait for each other, and a thread that waits must not begin another pose with the
    // detectors that it is using.
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
        progress.begin("study", static_cast<int>(of - before),
                       std::chrono::milliseconds(20) * (of - before));
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
