#include "capture/files_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame/frame_checks.h"
#include "capture/recorded_frames.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

class FilesCamera final : public Camera {
public:
    FilesCamera(const fs::path& folder, Clock& clock)
        : clock_(clock),
          name_("camera files:" + folder.string()),
          recorded_(recorded_frames(folder)) {
        identity_.uri = "files:" + folder.string();
    }

    const CameraIdentity& identity() const override { return identity_; }
    CaptureSettings configure(const CaptureSettings& wanted) override;
    void arm() override;
    Frame frame_after(Instant t, int retries, std::stop_token stop) override;
    void disarm() noexcept override { armed_ = false; }
    CaptureStatistics statistics() const override { return statistics_; }

private:
    CaptureSettings settings_of_recording(int bits) const;
    CodeImage image_of(const FrameRecord& frame) const;
    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError(name_, request, cause);
    }

    Clock& clock_;
    std::string name_;  // for errors
    CameraIdentity identity_;
    RecordedFrames recorded_;
    std::size_t next_ = 0;
    std::optional<CaptureSettings> settings_;
    bool armed_ = false;
    CaptureStatistics statistics_;
};

// What is known of the recording: from its log, and from its first image. A plain image file does
// not say how many of its bits are used, so `bits` is believed; 0 means all.
CaptureSettings FilesCamera::settings_of_recording(int bits) const {
    const auto first = std::ranges::find_if(
        recorded_.frames, [](const FrameRecord& frame) { return !frame.file.empty(); });
    if (first == recorded_.frames.end())
        fail("configure", "no frame of the recording is complete");
    const CodeImage image = read_image(recorded_.folder / first->file);
    CaptureSettings settings = first->settings;
    if (!recorded_.are_logged)
        settings.bits = bits == 0 ? image.bits : bits;
    settings.width = image.pixels.cols;
    settings.height = image.pixels.rows;
    if (!bits_fit_depth(settings.bits, image.pixels.depth()))
        fail(fmt::format("set {} bits a pixel", settings.bits),
             fmt::format("the recording has {}-bit files", image.bits));
    if (settings.format.empty())
        settings.format = image.pixels.depth() == CV_8U ? "Mono8" : "Mono16";
    return settings;
}

CaptureSettings FilesCamera::configure(const CaptureSettings& wanted) {
    if (armed_)
        fail("configure", "the camera is armed");
    settings_.reset();
    const CaptureSettings actual = settings_of_recording(wanted.bits);
    CaptureSettings comparable = wanted;
    if (wanted.gain_db == 0.0)  // a recording's own
        comparable.gain_db = actual.gain_db;
    if (const auto difference = first_difference(comparable, actual, 0.5))
        fail(difference->request, "a recording cannot be taken again: " + difference->cause);
    settings_ = actual;
    return actual;
}

void FilesCamera::arm() {
    if (!settings_)
        fail("arm", "the camera is not configured");
    armed_ = true;
}

CodeImage FilesCamera::image_of(const FrameRecord& frame) const {
    const fs::path path = recorded_.folder / frame.file;
    CodeImage image{read_image(path).pixels, settings_->bits};
    if (image.pixels.cols != settings_->width || image.pixels.rows != settings_->height ||
        !bits_fit_depth(settings_->bits, image.pixels.depth()) || exceeds_full_scale(image))
        fail("take a frame", fmt::format("{} is not {}x{} with {} bits", path.string(),
                                         settings_->width, settings_->height, settings_->bits));
    return image;
}

Frame FilesCamera::frame_after(Instant t, int, std::stop_token stop) {
    if (!armed_)
        fail("take a frame", "the camera is not armed");
    wait_until_after(clock_, t, stop);
    if (next_ == recorded_.frames.size())
        fail("take a frame", fmt::format("all {} images were shown", recorded_.frames.size()));

    const FrameRecord& recorded = recorded_.frames[next_];
    Frame frame;
    if (!recorded.file.empty())
        frame.image = image_of(recorded);
    frame.status = recorded.status;
    frame.status_detail = recorded.status_detail;
    frame.id = recorded.device_id;
    frame.exposure_start = clock_.now();
    frame.time_source = TimeSource::recording;
    frame.settings = recorded_.are_logged ? recorded.settings : *settings_;
    frame.settings.format = settings_->format;
    ++next_;
    ++(frame.status == FrameStatus::complete ? statistics_.delivered : statistics_.rejected);
    return frame;
}

}  // namespace

std::unique_ptr<Camera> open_files_camera(const fs::path& folder, Clock& clock) {
    return std::make_unique<FilesCamera>(folder, clock);
}

}  // namespace etalon
