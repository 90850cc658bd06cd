// The photometric poses of a run's photographs, from all pixels of the marker
// (compare/photometric/photometric_pose.h).
#pragma once

#include <tbb/task_group.h>

#include <map>
#include <optional>
#include <stop_token>
#include <string>

#include "compare/photometric/photometric_detector.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Of hold-out poses whose marker was detected, from all their whole frames in the record, starting
// at the detector's pose: a pure function of these. They are found on other threads while the stage
// moves on, some 30 ms of CPU time per frame. Used from one thread.
class PhotometricPoses {
public:
    // Of `result`, which must outlive it, station, settings and folder are read and must stay as
    // they are. Throws what PhotometricDetector throws.
    PhotometricPoses(const QualifyResult& result, std::stop_token stop);
    ~PhotometricPoses();  // gives up what is not begun
    PhotometricPoses(const PhotometricPoses&) = delete;
    PhotometricPoses& operator=(const PhotometricPoses&) = delete;

    // Begins with a pose whose frames are in the record.
    void add(const Pose& pose);

    // Sets them in all poses of the result, also in those that were not added; one that gets none
    // is named in the remarks. The same for any number of threads and whatever was added before.
    // Throws ConfigError when a frame cannot be read and Interrupted when a stop was requested.
    void set_in(QualifyResult& result);

private:
    struct Found {
        std::optional<PhotometricReading> reading;
        std::string refusal;
    };

    const QualifyResult& run_;
    std::stop_token stop_;
    PhotometricDetector detector_;
    std::map<int, Found> found_;  // by the pose's index; its nodes stay where they are
    tbb::task_group tasks_;
};

}  // namespace etalon
