// Taking frames with one camera into a record: what `etalon capture` does.
//
//     capture.json   what was asked and what came out; `etalon: capture/1`
//     events.jsonl   one JSON object per frame, as in a run's (station/record/run_record.h)
//     frames/        raw frames, 8 or 16 bit PNG: NNNNNN.png, from 0
//     mean.tiff      mean of the frames, code value / full scale, 32-bit float
//
// The record can be replayed with the camera files:DIR.
#pragma once

#include <functional>

#include "capture/frame/camera.h"
#include "station/devices/commands.h"

namespace etalon {

struct CaptureRequest {
    CaptureSettings settings;
    int frames = 0;  // 0: until a stop is requested
    int retries = 5;
    std::filesystem::path out;  // empty: nothing is recorded
};

struct CaptureResult {
    CameraIdentity camera;
    CaptureSettings settings;  // in force
    CaptureStatistics statistics;
    std::vector<std::string> remarks;
    int asked = 0, complete = 0;
    std::optional<double> mean, noise;  // code values; of 2 or more complete frames
    std::string started_utc;
    double duration_s = 0.0;
    std::string reason;  // why it ended before all frames were taken; empty: it did not
};

// Takes the frames and hands each to `seen`, incomplete ones too. A camera that fails ends it with
// a reason, after an attempt to reconnect; so do a disk that is full and a stop request, if frames
// were asked for. What was taken before stays on disk. Throws DeviceError when the camera cannot be
// configured, and ConfigError when the record cannot be made.
CaptureResult capture_frames(Camera& camera, const CaptureRequest& request, Clock& clock,
                             const std::stop_token& stop,
                             const std::function<void(const Frame&)>& seen);

// `etalon: capture/1`, indented, keys in a fixed order. Also what --json prints.
std::string capture_json(const CaptureResult& result);

// Throws ConfigError for a --set that is no NAME=NUMBER.
CaptureSettings capture_settings(const CaptureArguments& arguments);

// Opened; one that another program controls is waited for, and it is said on stderr. Throws as
// open_when_free().
std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop);

}  // namespace etalon
