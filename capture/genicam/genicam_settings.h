// What a GenICam device is told before a capture and says of itself; automatic and enhancing
// functions off, chunks on. Names follow SFNC 2; the library knows older ones of exposure, gain and
// black level.
#pragma once

#include "capture/frame/pixel_formats.h"
#include "capture/genicam/genicam_chunks.h"

namespace etalon {

struct GenicamCapture {
    CaptureSettings settings;          // in force
    const PixelFormat* format;         // of the pixels
    double exposure_step_us = 0.5;     // of the device
    GenicamChunks chunks;              // that come with a frame
    std::size_t payload = 0;           // bytes of a frame, its chunks included
    std::vector<std::string> remarks;  // what cannot be switched off
};

// Throws DeviceError when the device refuses a setting or uses another.
GenicamCapture configure_genicam(const GenicamDevice& device, const CaptureSettings& wanted);

CameraAbilities genicam_abilities(const GenicamDevice& device);

}  // namespace etalon
