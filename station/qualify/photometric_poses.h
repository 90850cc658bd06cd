// Photometric poses of a run's photographs (compare/photometric/photometric_detector.h), what the
// pixels show beside the pose (compare/match/pixel_measurement.h), and the detector's bias there
// (compare/pose/pose_bias.h).
#pragma once

#include <tbb/task_group.h>

#include "compare/expect/expected_view.h"
#include "compare/match/pixel_measurement.h"
#include "station/qualify/image_result_cache.h"

namespace etalon {

// Of poses whose marker was detected: hold-out poses from all whole frames in the record, training
// poses (for the detector's bias) from the first. A pure function of the frames. Found on other
// threads in 0.2 s of CPU time per pose, or taken from the record. Used from one thread.
class PhotometricPoses {
public:
    // `result` must outlive it and keep station, settings, folder. Throws as PhotometricDetector.
    PhotometricPoses(const QualifyResult& result, std::stop_token stop);
    ~PhotometricPoses();  // gives up what is not begun
    PhotometricPoses(const PhotometricPoses&) = delete;
    PhotometricPoses& operator=(const PhotometricPoses&) = delete;

    // Begins with a pose whose frames are in the record.
    void add(const VisitedPose& pose);

    // Sets them in all poses of the result, also in those that were not added; a hold-out pose that
    // gets none is named in the remarks. The same for any number of threads and whatever was added
    // before. Keeps what was found in the record (station/qualify/image_result_cache.h). Throws
    // ConfigError when a frame cannot be read and Interrupted when a stop was requested.
    void set_in(QualifyResult& result);

    // The first whole photographs of the hold-out poses against their renders; of overexposed ones
    // only findings. Some 10 s of CPU time where a tone curve or a focus has to be found.
    RunEvidence pixels() const;

    const RenderedCorners& rendered() const { return rendered_; }

private:
    PhotometricPose seen_in(const FrameRecord& frame, const Rigid& start) const;
    void find(const VisitedPose& pose, ImageResultCache& found) const;
    void read(const VisitedPose& pose, ImageResultCache& found, const Rigid& start) const;
    void find_bias(ImageResultCache& found, const Rigid& camera_from_marker) const;
    void compare(ImageResultCache& found, const CodeImage& image,
                 const PhotometricPose& seen) const;
    PhotoEvidence measured(const CodeImage& image, const Rigid& camera_from_marker,
                           const DeviatingCamera& camera, std::optional<double> noise_scale) const;

    const QualifyResult& run_;
    std::stop_token stop_;
    PhotometricDetector detector_;
    RenderedCorners rendered_;
    ComparedArea area_;
    std::optional<ComparedArea> whole_;  // of what is printed, where it has a background beside it
    DeviatingCamera calibration_;
    KeptPixels kept_;
    std::map<int, ImageResultCache> found_;  // by the pose's index; its nodes stay where they are
    tbb::task_group tasks_;
};

}  // namespace etalon
