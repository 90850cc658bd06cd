#include "capture/files_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "capture/frame_checks.h"
#include "core/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

bool is_image_name(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 5> known{".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    return std::find(known.begin(), known.end(), extension) != known.end();
}

// The folder's images in the order of their names; hidden files are none.
std::vector<fs::path> images_in(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> images;
    fs::directory_iterator entries(folder, error);
    for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
        const fs::path& path = entries->path();
        if (is_image_name(path) && path.filename().string().front() != '.')
            images.push_back(path);
    }
    if (error)
        throw ConfigError({folder.string()}, "cannot be read: " + error.message());
    if (images.empty())
        throw ConfigError({folder.string()}, "holds no PNG, TIFF or JPEG image");
    std::sort(images.begin(), images.end());
    return images;
}

class FilesCamera final : public Camera {
public:
    FilesCamera(const fs::path& folder, Clock& clock)
        : clock_(clock), name_("camera files:" + folder.string()), images_(images_in(folder)) {
        identity_.uri = "files:" + folder.string();
    }

    const CameraIdentity& identity() const override { return identity_; }
    CaptureSettings configure(const CaptureSettings& wanted) override;
    void arm() override;
    Frame frame_after(Instant t, int retries, std::stop_token stop) override;
    void disarm() noexcept override { armed_ = false; }
    CaptureStatistics statistics() const override { return statistics_; }

private:
    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError(name_, request, cause);
    }

    Clock& clock_;
    std::string name_;  // for errors
    CameraIdentity identity_;
    std::vector<fs::path> images_;
    std::size_t next_ = 0;
    std::optional<CaptureSettings> settings_;
    bool armed_ = false;
    CaptureStatistics statistics_;
};

CaptureSettings FilesCamera::configure(const CaptureSettings& wanted) {
    if (armed_)
        fail("configure", "the camera is armed");
    const CodeImage first = read_image(images_.front());
    CaptureSettings actual;
    actual.width = first.pixels.cols;
    actual.height = first.pixels.rows;
    actual.bits = wanted.bits;
    if ((wanted.width && wanted.width != actual.width) ||
        (wanted.height && wanted.height != actual.height))
        fail(fmt::format("set image size {}x{}", wanted.width, wanted.height),
             fmt::format("the recording has {}x{}", actual.width, actual.height));
    if (!bits_fit_depth(wanted.bits, first.pixels.depth()))
        fail(fmt::format("set {} bits a pixel", wanted.bits),
             fmt::format("the recording has {}-bit files", first.bits));
    if (wanted.exposure.count() != 0 || wanted.gain_db != 0.0)
        fail("set exposure and gain", "a recording cannot be exposed again: ask for 0 and 0");
    settings_ = actual;
    return actual;
}

void FilesCamera::arm() {
    if (!settings_)
        fail("arm", "the camera is not configured");
    armed_ = true;
}

Frame FilesCamera::frame_after(Instant t, int, std::stop_token stop) {
    if (!armed_)
        fail("take a frame", "the camera is not armed");
    wait_until_after(clock_, t, stop);
    if (next_ == images_.size())
        fail("take a frame", fmt::format("all {} images were shown", images_.size()));

    const fs::path& path = images_[next_];
    Frame frame;
    frame.image = {read_image(path).pixels, settings_->bits};
    if (frame.image.pixels.cols != settings_->width ||
        frame.image.pixels.rows != settings_->height ||
        !bits_fit_depth(settings_->bits, frame.image.pixels.depth()) ||
        exceeds_full_scale(frame.image))
        fail("take a frame", fmt::format("{} is not {}x{} with {} bits", path.string(),
                                         settings_->width, settings_->height, settings_->bits));
    frame.status = FrameStatus::complete;
    frame.status_detail = path.filename().string();
    frame.id = ++next_;
    frame.exposure_start = clock_.now();
    frame.settings = *settings_;
    ++statistics_.delivered;
    return frame;
}

}  // namespace

std::unique_ptr<Camera> open_files_camera(const fs::path& folder, Clock& clock) {
    return std::make_unique<FilesCamera>(folder, clock);
}

}  // namespace etalon
