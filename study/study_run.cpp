#include "study/study_run.h"

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include "core/program/errors.h"
#include "core/time/clock.h"

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

class StudyPipeline {
public:
    StudyPipeline(const StudyOptics& optics, const Shard& shard, StudyRecord& record,
                  std::stop_token stop, Progress& progress)
        : optics_(optics),
          shard_(shard),
          record_(record),
          stop_(std::move(stop)),
          progress_(progress),
          source_(optics.study()),
          workers_([this] { return StudyWorker(optics_, scratch_of_next_worker()); }),
          serial_([] { return tbb::task_arena(1); }) {
        for (std::size_t done = 0; done < record.poses_done();)
            done += shard_.holds(source_.next().index);
        workers_.local();  // whether its programs can be started
    }
    ~StudyPipeline() {
        std::error_code ignored;
        std::filesystem::remove_all(scratch_, ignored);
    }

    StudyRun run() {
        StudyRun result;
        const std::size_t of = shard_.units(poses());
        const std::size_t before = record_.poses_done();
        if (before < of)
            progress_.begin("study", static_cast<int>(of - before),
                            std::chrono::milliseconds(20) * (of - before));
        run_pipeline();
        progress_.end();
        result.poses = record_.poses_done() - before;
        result.complete = record_.poses_done() == of;
        for (const StudyWorker& worker : workers_)
            result.times.add(worker.times());
        return result;
    }

private:
    std::size_t poses() const { return static_cast<std::size_t>(optics_.study().poses.count); }

    std::filesystem::path scratch_of_next_worker() {
        return scratch_ / fmt::format("{}", ++worker_count_);
    }

    // A pose is one task in an arena of one thread: what renders and detectors do in parallel would
    // only wait for each other, and a thread that waits must not begin another pose with the
    // detectors that it is using.
    void run_pipeline() {
        const auto in_flight =
            2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
        tbb::parallel_pipeline(
            in_flight, tbb::make_filter<void, StudyPose>(
                           tbb::filter_mode::serial_in_order,
                           [this](tbb::flow_control& control) { return next_pose(control); }) &
                           tbb::make_filter<StudyPose, EvaluatedPose>(
                               tbb::filter_mode::parallel,
                               [this](const StudyPose& pose) {
                                   StudyWorker& worker = workers_.local();
                                   return serial_.local().execute([&] {
                                       return EvaluatedPose{pose, worker.evaluate(pose)};
                                   });
                               }) &
                           tbb::make_filter<EvaluatedPose, void>(
                               tbb::filter_mode::serial_in_order,
                               [this](const EvaluatedPose& evaluated) { keep(evaluated); }));
    }

    StudyPose next_pose(tbb::flow_control& control) {
        while (source_.next_index() < poses() && !stop_.stop_requested()) {
            const StudyPose pose = source_.next();
            if (shard_.holds(pose.index))
                return pose;
        }
        control.stop();
        return {};
    }

    void keep(const EvaluatedPose& evaluated) {
        std::vector<double> values;
        for (const StudiedDisturbance& one : optics_.study().disturbances)
            values.push_back(evaluated.pose.disturbances.*one.axis->value);
        if (!optics_.study().focus_mm.empty())
            values.push_back(optics_.study().focus_mm[evaluated.pose.focus]);
        record_.add(evaluated.pose, values, evaluated.findings);
        progress_.step();
    }

    const StudyOptics& optics_;
    Shard shard_;
    StudyRecord& record_;
    std::stop_token stop_;
    Progress& progress_;
    StudyPoseSource source_;
    std::filesystem::path scratch_ = record_.folder() / "scratch";
    std::atomic<int> worker_count_ = 0;
    tbb::enumerable_thread_specific<StudyWorker> workers_;
    tbb::enumerable_thread_specific<tbb::task_arena> serial_;
};

}  // namespace

StudyRun run_study(const StudyOptics& optics, const Shard& shard, StudyRecord& record,
                   std::stop_token stop, Progress& progress) {
    const double cpu_start = process_cpu_ms();
    const auto start = std::chrono::steady_clock::now();
    StudyRun result = StudyPipeline(optics, shard, record, std::move(stop), progress).run();
    result.cpu_ms = process_cpu_ms() - cpu_start;
    const std::chrono::duration<double, std::milli> wall = std::chrono::steady_clock::now() - start;
    result.wall_ms = wall.count();
    return result;
}

}  // namespace etalon
