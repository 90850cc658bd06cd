// A qualification run at corner level, in process, for studies of thousands of runs: the physics
// between the stage's encoders and the detector's corners, without a pixel.
//
// True axes carry the true marker before the true camera; the detector adds its bias and noise as
// real renders of the same poses showed them (compare/expect/expectation.h). The analysis is that
// of a real run (compare/qualification/qualification.h).
//
// Each run draws, from what the station declares: each stage term of the budget, the
// marker's print size and flatness, the temperature, repeatability and read-back noise of each axis
// at each pose, image noise of every frame. Backlash follows from the path. Not simulated: error
// maps' own uncertainties, the calibration's covariance (it is the camera under test), and drift.
#pragma once

#include "compare/expect/expectation.h"
#include "core/statistics/random.h"
#include "station/setup/plan.h"

namespace etalon {

// What is truly there; the station is told something else.
struct RunTruth {
    Projector camera;
    Rigid camera_from_base, carriage_from_marker;
    std::vector<Rigid> base_from_carriage;  // per pose, before what each run draws
    TrueMarker marker;
};

// An error that can be put into the truth, by the name that its signature has.
using InjectedError = ChangingError<RunTruth>;

// camera_from_marker of every pose of the plan as drawn. Throws ConfigError without camera_mount.
std::vector<Rigid> expected_poses(const StationFile& station, const Plan& plan);

// Immutable once built; safe from every thread.
class RunSimulator {
public:
    // `study`: of expected_poses(). Throws ConfigError without camera_mount, NumericalError when
    // the study is of another number of poses.
    RunSimulator(const StationFile& station, const Plan& plan, DetectorStudy study);
    // The analysis' input points into the simulator.
    RunSimulator(const RunSimulator&) = delete;
    RunSimulator& operator=(const RunSimulator&) = delete;

    const StationFile& station() const { return station_; }
    const Plan& plan() const { return plan_; }
    const DetectorStudy& study() const { return study_; }

    // Everything as the station is told and as drawn.
    RunTruth as_told() const;

    // All errors that have a signature, in its order: camera, marker, stage.
    std::vector<InjectedError> errors() const;

    // Of a run in which nothing is drawn: no noise, no repeatability. The detector's bias is in.
    QualificationInput exact(const RunTruth& truth) const { return input(truth, nullptr); }

    // Run `run` of series `seed`. Throws NumericalError for corners that the camera cannot see.
    QualificationInput draw(const RunTruth& truth, std::uint64_t seed, std::uint64_t run) const;

private:
    using Corners = std::vector<Eigen::Vector2d>;
    struct Draws;

    std::vector<std::vector<double>> backlash() const;
    Vector6d drawn_shift(const Draws& draws, std::size_t pose, RandomStream& random) const;
    void photograph(const RunTruth& truth, const Draws* draws, std::size_t index,
                    VisitedPose& pose) const;
    QualificationInput input(const RunTruth& truth, const Draws* draws) const;

    StationFile station_;
    Plan plan_;
    DetectorStudy study_;
    Projector told_;
    std::vector<Rigid> expected_;           // camera_from_marker per pose, as drawn
    std::vector<std::vector<double>> gap_;  // backlash per pose and axis, mm or rad
    QualificationInput declared_;           // without corners
};

// Reads the station, plans, renders and detects every pose with so many noises; progress on stderr.
// Throws ConfigError as read_station, plan_of and study_detector do.
std::unique_ptr<const RunSimulator> study_plan(const std::filesystem::path& station,
                                               int noisy_frames);

// "The detector: corner noise 0.017 px a frame, ..." as lines of at most 80 columns.
std::string detector_text(const DetectorFigures& detector);

// A size with its unit, for people: "0.182 %" of a relative one, "0.31 px".
std::string size_text(double size, const std::string& unit);

}  // namespace etalon
