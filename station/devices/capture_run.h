// Taking frames with one camera into a record: what `etalon capture` does.
//
//     capture.json   what was asked and what came out; `etalon: capture/1`
//     events.jsonl   one JSON object per frame, as in a run's (station/record/run_record.h)
//     frames/        raw frames, 8 or 16 bit PNG: NNNNNN.png, from 0
//     mean.tiff      mean of the frames, code value / full scale, 32-bit float
//
// The record can be replayed with the camera files:DIR.
#pragma once

#include <unistd.h>

#include "station/devices/commands.h"

namespace etalon {

struct CaptureRequest {
    CaptureSettings settings;
    int frames = 0;  // 0: until a stop is requested
    int retries = 5;
    std::filesystem::path out;  // empty: nothing is recorded
};

// What a camera was used for, and how that ended.
struct CameraUse {
    CameraIdentity camera;
    CaptureSettings settings;  // in force
    CaptureStatistics statistics;
    std::vector<std::string> remarks;
    std::string started_utc;
    std::string reason;  // why it ended early: "interrupted", an error; empty: it did not
};

// Arms a configured camera for the time of `work`. An error of this project ends it.
void use_camera(Camera& camera, CameraUse& use, const std::function<void()>& work);

// Reason and remarks, on stderr.
void print_remarks(const CameraUse& use);

// On a terminal one line on stderr that is drawn again and again; elsewhere a line each time.
class StatusLine {
public:
    StatusLine() = default;
    StatusLine(const StatusLine&) = delete;
    StatusLine& operator=(const StatusLine&) = delete;
    ~StatusLine();

    bool is_terminal() const { return is_terminal_; }
    void show(const std::string& text);  // at most 79 columns

private:
    bool is_terminal_ = isatty(STDERR_FILENO) != 0, is_drawn_ = false;
};

struct CaptureResult : CameraUse {
    int asked = 0, complete = 0;
    std::optional<double> mean, noise;  // code values; of 2 or more complete frames
    double duration_s = 0.0;
};

// Takes the frames and hands each to `seen`, incomplete ones too. A failing camera, a full disk
// and, if frames were asked for, a stop request end it with a reason; what was taken stays on disk.
// Throws DeviceError for a camera that cannot be configured, ConfigError for a record.
CaptureResult capture_frames(Camera& camera, const CaptureRequest& request, Clock& clock,
                             const std::stop_token& stop,
                             const std::function<void(const Frame&)>& seen);

// Throws ConfigError for a --set that is no NAME=NUMBER.
CaptureSettings capture_settings(const CaptureArguments& arguments);

// Waits for a camera that another program controls, and says so on stderr: open_when_free().
std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop);

}  // namespace etalon
