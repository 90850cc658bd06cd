// The photometric poses of a run's photographs, from all pixels of the marker
// (compare/photometric/photometric_detector.h), what the pixels show beside the pose
// (compare/match/pixel_measurement.h), and how the detector is off there
// (compare/pose/pose_bias.h).
#pragma once

#include <tbb/task_group.h>

#include "compare/expect/expected_view.h"
#include "compare/match/pixel_measurement.h"
#include "station/qualify/image_result_cache.h"

namespace etalon {

// Of poses whose marker was detected: of hold-out poses from all their whole frames in the record,
// of training poses, where only the detector's bias is wanted, from the first. They start at the
// detector's pose and are a pure function of these frames. All is found on other threads while the
// stage moves on, in 0.2 s of CPU time per pose, or taken from what the record has kept of this
// program's. Used from one thread.
class PhotometricPoses {
public:
    // Of `result`, which must outlive it, station, settings and folder are read and must stay as
    // they are. Throws what PhotometricDetector throws.
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

    // The first whole photographs of the hold-out poses that were set, against their renders; of
    // overexposed ones only what they show. Costs some 10 s of CPU time where a tone curve or a
    // focus has to be found.
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
