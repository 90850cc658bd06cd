// The library, second of five doors: where a marker is, from a photograph of it.
//
//     make_detector()            corners of tags and boards
//     estimate_pose()            a pose from corners
//     PhotometricDetector        a pose from all of the marker's pixels
//
// Used in examples/library/detect.cpp. Link etalon::compare.
#pragma once

#include "compare/detect/detector.h"
#include "compare/make_detector.h"
#include "compare/photo_pose.h"
#include "compare/photometric/photometric_detector.h"
#include "etalon/render.h"
