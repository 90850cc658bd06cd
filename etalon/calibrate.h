// The library, third of five doors: a camera's intrinsics from photographs of a board.
//
//     observe()                  the board's points in a photograph
//     calibrate_camera()         intrinsics, and what they are worth
//     write_camera()             the result as a file
//
// Used in examples/library/calibrate.cpp. Link etalon::compare.
#pragma once

#include "calib/files/camera_file.h"
#include "calib/intrinsics/calibrate.h"
#include "compare/detect/board/calibration_target.h"
#include "core/program/errors.h"
