// The library, first of five doors: what a calibrated camera sees of a marker.
//
//     read_camera()              calibrations of this and other tools
//     parse_marker()             tags and boards by name
//     Renderer                   a scene as linear radiance
//     SensorModel                code values from radiance, with noise
//
// Used in examples/library/render.cpp. Link etalon::sim.
#pragma once

#include "calib/files/camera_file.h"
#include "core/image/image.h"
#include "core/program/errors.h"
#include "sim/marker/marker.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"
