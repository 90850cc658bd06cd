#include "capture/files_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame/frame_checks.h"
#include "capture/recorded_frames.h"
#include "core/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

class FilesCamera final : public Camera {
public:
    FilesCamera(const fs::path& folder, Clock& clock)
        : clock_(clock),
          name_("camera files:" + folder.string()),
          frames_(recorded_frames(folder)) {
        identity_.uri = "files:" + folder.string();
    }

    const CameraIdentity& identity() const override { return identity_; }
    CaptureSettings configure(const CaptureSettings& wanted) override;
    void arm() override;
    Frame frame_after(Instant t, int retries, std::stop_token stop) override;
    void disarm() noexcept override { armed_ = false; }
    CaptureStatistics statistics() const override { return statistics_; }

private:
    CaptureSettings recorded(int bits) const;
    CodeImage image_of(const RecordedFrame& recorded) const;
    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError(name_, request, cause);
    }

    Clock& clock_;
    std::string name_;  // for errors
    CameraIdentity identity_;
    std::vector<RecordedFrame> frames_;
    std::size_t next_ = 0;
    std::optional<CaptureSettings> settings_;
    bool armed_ = false;
    CaptureStatistics statistics_;
};

// What is known of the recording: from its log, and from its first image. A plain image file does
// not say how many of its bits are used, so `bits` is believed; 0 means all.
CaptureSettings FilesCamera::recorded(int bits) const {
    const auto first = std::find_if(frames_.begin(), frames_.end(),
                                    [](const RecordedFrame& f) { return !f.path.empty(); });
    if (first == frames_.end())
        fail("configure", "no frame of the recording is complete");
    const CodeImage image = read_image(first->path);
    CaptureSettings settings = first->settings;
    if (!first->has_settings)
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
    const CaptureSettings actual = recorded(wanted.bits);
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

CodeImage FilesCamera::image_of(const RecordedFrame& recorded) const {
    CodeImage image{read_image(recorded.path).pixels, settings_->bits};
    if (image.pixels.cols != settings_->width || image.pixels.rows != settings_->height ||
        !bits_fit_depth(settings_->bits, image.pixels.depth()) || exceeds_full_scale(image))
        fail("take a frame", fmt::format("{} is not {}x{} with {} bits", recorded.path.string(),
                                         settings_->width, settings_->height, settings_->bits));
    return image;
}

Frame FilesCamera::frame_after(Instant t, int, std::stop_token stop) {
    if (!armed_)
        fail("take a frame", "the camera is not armed");
    wait_until_after(clock_, t, stop);
    if (next_ == frames_.size())
        fail("take a frame", fmt::format("all {} images were shown", frames_.size()));

    const RecordedFrame& recorded = frames_[next_];
    Frame frame;
    if (!recorded.path.empty())
        frame.image = image_of(recorded);
    frame.status = recorded.status;
    frame.status_detail =
        recorded.has_settings ? recorded.status_detail : recorded.path.filename().string();
    frame.id = recorded.id;
    frame.exposure_start = clock_.now();
    frame.time_source = TimeSource::recording;
    frame.settings = recorded.has_settings ? recorded.settings : *settings_;
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
