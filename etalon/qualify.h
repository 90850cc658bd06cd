// The library, last of five doors: is the camera on this stage within its limits?
//
//     read_station()             devices, marker, plan and limits
//     open_camera(), open_stage()    or classes of your own that implement Camera and Stage
//     run_qualification()        from the plan to the written record
//     qualify()                  its judgement alone, of poses that were measured elsewhere
//
// Used in examples/library/qualify.cpp. Link etalon::station.
#pragma once

#include "capture/frame/camera.h"
#include "compare/qualification/qualification.h"
#include "stage/motion/stage.h"
#include "station/qualify/runner.h"
#include "station/setup/station_file.h"
