// From what was read and photographed at one pose to its means: the same for a pose that was just
// visited and for one that is read from a record.
#pragma once

#include <span>

#include "compare/detect/detector.h"
#include "station/record/qualify_result.h"

namespace etalon {

// "frames/0007_1.png": frame 1 of pose 7, both from 0.
std::string frame_file(int pose, int frame);

// Sets read_back, its deviation and uncertainty, and the stage's pose from `pose.readings`: at
// least two, each with a position for every axis.
void average_readings(Pose& pose, std::span<const Axis> axes);

// Sets the frame's corners, or why there are none: all are needed, as means are taken of them.
void detect_frame(Detector& detector, const CodeImage& image, FrameRecord& frame);

// Sets the pose's corners, the mean over the frames that saw the marker, their number, and how far
// these leave the corners apart.
void average_corners(Pose& pose);

}  // namespace etalon
