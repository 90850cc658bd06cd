// What the pixels of a record's photographs gave, kept beside them in pixels.jsonl, as finding it
// is nine tenths of an analysis. It is a pure function of the program, the station's files and the
// frames. It is taken from there where all of these and the line itself are the same to the bit,
// and found again elsewhere: an analysis gives the same bytes with the file and without.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// Of one pose whose marker was detected (station/qualify/photometric_poses.h).
struct ImageResultCache {
    std::optional<PhotometricReading> reading;
    std::optional<Rigid> seen_at;
    std::vector<Eigen::Vector2d> detector_bias_px;
    std::string refusal;
    Rigid compared_at;  // the pose that `pixels` are measured at
    std::optional<PhotoEvidence> pixels;
    std::vector<PhotoFinding> findings;
};

// What was detected in one frame: FrameRecord's corners, or why there are none.
struct SeenFrame {
    std::vector<Eigen::Vector2d> corners;
    std::string detection;
};

struct KeptPose {
    std::vector<SeenFrame> frames;           // all of the pose's, as in VisitedPose::frames
    std::optional<ImageResultCache> pixels;  // nothing where the marker was not detected
};

class KeptPixels {
public:
    // Reads the file in the run's folder, if there is one. `run` must outlive it. Lines that cannot
    // be what was written are left out. Some 0.1 ms and 5 kB a pose.
    explicit KeptPixels(const QualifyResult& run);

    // Null where this program would have to look at the frames.
    const KeptPose* of(const VisitedPose& pose) const;

    // Replaces the file by what was found in all of the run's poses, by their index, unless it was
    // all there. A file that cannot be written is left out: it only saves time.
    void keep(const std::map<int, ImageResultCache>& by_index) const;

private:
    const QualifyResult& run_;
    std::map<std::string, KeptPose> poses_;  // by a hash of what they follow from
};

}  // namespace etalon
