#include "station/devices/capture_run.h"

#include <fmt/format.h>

#include <cmath>

#include "capture/camera_recovery.h"
#include "capture/frame/frame_average.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "station/record/record_json.h"
#include "station/record/run_events.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

// The record, or nothing where none is wanted.
class CaptureRecord {
public:
    CaptureRecord(const std::filesystem::path& folder, Instant start) : start_(start) {
        if (!folder.empty())
            record_.emplace(folder, std::initializer_list<const char*>{"frames"});
    }

    void log(Instant now, const std::string& event, const std::string& detail) {
        if (record_)
            record_->log(
                state_event(std::chrono::duration<double>(now - start_).count(), event, detail));
    }

    void add(int number, const Frame& frame) {
        if (!record_)
            return;
        FrameRecord entry = frame_record(frame, start_);
        if (frame.status == FrameStatus::complete) {
            entry.file = fmt::format("frames/{:06}.png", number);
            record_->images().write(record_->folder() / entry.file, frame.image);
        }
        record_->log(frame_event(number, entry));
    }

    // What cannot be written any more is the reason, unless there is one. capture.json comes last,
    // so that it says so: it is small and often still finds its place on a full disk.
    void finish(CaptureResult& result, const FrameAverager& averager) {
        if (!record_)
            return;
        attempt(result, [&] { record_->images().flush(); });
        attempt(result, [&] { write_mean(averager); });
        attempt(result,
                [&] { write_text(record_->folder() / "capture.json", capture_json(result)); });
    }

private:
    void write_mean(const FrameAverager& averager) const {
        if (averager.frames() < 2)
            return;
        const FrameAverage average = averager.average();
        Radiance mean;
        average.mean.convertTo(mean, CV_32F, 1.0 / ((1 << average.bits) - 1));
        write_radiance(record_->folder() / "mean.tiff", mean);
    }

    static void attempt(CaptureResult& result, const std::function<void()>& step) {
        try {
            step();
        } catch (const ConfigError& error) {
            if (result.reason.empty())
                result.reason = error.what();
        }
    }

    Instant start_;
    std::optional<RunRecord> record_;
};

void take_all(Camera& camera, const CaptureRequest& request, Clock& clock,
              const std::stop_token& stop, CaptureRecord& record, FrameAverager& averager,
              const std::function<void(const Frame&)>& seen) {
    Instant after = clock.now();
    for (int number = 0; request.frames == 0 || number < request.frames; ++number) {
        const Frame frame =
            frame_after_reconnecting(camera, after, request.retries, clock, stop,
                                     [&](const std::string& event, const std::string& detail) {
                                         record.log(clock.now(), event, detail);
                                     });
        record.add(number, frame);
        if (frame.status == FrameStatus::complete) {
            averager.add(frame);
            after = frame.exposure_start;
        }
        seen(frame);
    }
}

void sum_up(CaptureResult& result, const FrameAverager& averager) {
    result.complete = averager.frames();
    if (averager.frames() < 2)
        return;
    const FrameAverage average = averager.average();
    result.mean = cv::mean(average.mean)[0];
    result.noise = average.noise();
}

}  // namespace

CaptureResult capture_frames(Camera& camera, const CaptureRequest& request, Clock& clock,
                             const std::stop_token& stop,
                             const std::function<void(const Frame&)>& seen) {
    CaptureResult result;
    result.asked = request.frames;
    result.started_utc = utc_now();
    result.camera = camera.identity();
    result.settings = camera.configure(request.settings);
    const Instant start = clock.now();
    CaptureRecord record(request.out, start);
    camera.arm();
    FrameAverager averager;
    try {
        take_all(camera, request, clock, stop, record, averager, seen);
    } catch (const Interrupted&) {
        if (request.frames != 0)
            result.reason = "interrupted";
    } catch (const Error& error) {
        result.reason = error.what();
    }
    camera.disarm();
    sum_up(result, averager);
    result.statistics = camera.statistics();
    result.remarks = camera.remarks();
    result.duration_s = std::chrono::duration<double>(clock.now() - start).count();
    record.finish(result, averager);
    return result;
}

std::string capture_json(const CaptureResult& result) {
    RecordJson camera = device_json(result.camera);
    camera["settings"] = settings_json(result.settings);
    add_counters(camera, result.statistics);
    camera["remarks"] = result.remarks;
    RecordJson json = {{"etalon", "capture/1"},
                       {"started_utc", result.started_utc},
                       {"duration_s", result.duration_s},
                       {"reason", result.reason},
                       {"camera", camera},
                       {"frames_asked", result.asked},
                       {"frames_complete", result.complete}};
    if (result.noise)
        json["noise_dn"] = *result.noise;
    if (result.mean)
        json["mean_dn"] = *result.mean;
    json["software"] = software_json(software_versions());
    return text_of(json, 2) + "\n";
}

namespace {

// "Gamma=0.7"
std::map<std::string, double> parse_controls(const std::vector<std::string>& words) {
    std::map<std::string, double> controls;
    for (const std::string& word : words) {
        const std::size_t equals = word.find('=');
        const auto value = equals == std::string::npos
                               ? std::nullopt
                               : parse_number(std::string_view(word).substr(equals + 1));
        if (!value || equals == 0)
            throw ConfigError({"--set"}, fmt::format("must be NAME=NUMBER, not '{}'", word));
        controls[word.substr(0, equals)] = *value;
    }
    return controls;
}

CameraLink camera_link(const CaptureArguments& arguments) {
    CameraLink link;
    link.packet_size = arguments.packet_size;
    link.frame_timeout = std::chrono::milliseconds(arguments.frame_timeout_ms);
    link.interface = arguments.interface;
    return link;
}

}  // namespace

CaptureSettings capture_settings(const CaptureArguments& arguments) {
    CaptureSettings settings;
    settings.width = arguments.width;
    settings.height = arguments.height;
    settings.format = arguments.format;
    settings.bits = arguments.bits.value_or(arguments.format.empty() ? 8 : 0);
    settings.exposure = std::chrono::microseconds(std::llround(arguments.exposure_us));
    settings.gain_db = arguments.gain_db;
    settings.black_level = arguments.black_level;
    settings.trigger = arguments.trigger;
    settings.controls = parse_controls(arguments.controls);
    return settings;
}

std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop) {
    return open_when_free(
        [&] { return open_camera(arguments.camera, camera_link(arguments), clock); }, clock, stop,
        [](const std::string& text) { fmt::print(stderr, "{}\n", text); });
}

}  // namespace etalon
