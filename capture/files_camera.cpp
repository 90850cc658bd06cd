#include "capture/files_camera.h"

#include <cctype>

#include "capture/frame/device_camera.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

class FilesCamera final : public DeviceCamera {
public:
    FilesCamera(const fs::path& folder, Clock& clock)
        : DeviceCamera("files:" + folder.string(), {}, clock), recorded_(recorded_frames(folder)) {}

    // A recorded frame that is bad is not taken again.
    Frame frame_after(Instant t, int, std::stop_token stop) override {
        return DeviceCamera::frame_after(t, 0, stop);
    }

private:
    Frame next_frame(Instant t, std::stop_token stop) override {
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
        return frame;
    }

    // What is known of the recording: from its log, and from its first image. A plain image file
    // does not say how many of its bits are used, so `bits` is believed; 0 means all.
    CaptureSettings settings_of_recording(int bits) const {
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

    CodeImage image_of(const FrameRecord& frame) const {
        const fs::path path = recorded_.folder / frame.file;
        CodeImage image{read_image(path).pixels, settings_->bits};
        if (image.pixels.cols != settings_->width || image.pixels.rows != settings_->height ||
            !bits_fit_depth(settings_->bits, image.pixels.depth()) || exceeds_full_scale(image))
            fail("take a frame", fmt::format("{} is not {}x{} with {} bits", path.string(),
                                             settings_->width, settings_->height, settings_->bits));
        return image;
    }

    CaptureSettings apply(const CaptureSettings& wanted) override {
        const CaptureSettings actual = settings_of_recording(wanted.bits);
        CaptureSettings comparable = wanted;
        if (wanted.gain_db == 0.0)  // a recording's own
            comparable.gain_db = actual.gain_db;
        if (const auto difference = first_difference(comparable, actual, 0.5))
            fail(difference->request, "a recording cannot be taken again: " + difference->cause);
        return actual;
    }

    RecordedFrames recorded_;
    std::size_t next_ = 0;
};

bool is_image_name(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 5> known{".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    return std::find(known.begin(), known.end(), extension) != known.end();
}

// The folder's images in the order of their names; hidden files are none.
std::vector<FrameRecord> images_in(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> paths;
    fs::directory_iterator entries(folder, error);
    for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
        const fs::path& path = entries->path();
        if (is_image_name(path) && path.filename().string().front() != '.')
            paths.push_back(path);
    }
    if (error)
        throw ConfigError({folder.string()}, "cannot be read: " + error.message());
    if (paths.empty())
        throw ConfigError({folder.string()}, "holds no PNG, TIFF or JPEG image");
    std::sort(paths.begin(), paths.end());
    std::vector<FrameRecord> frames;
    for (const fs::path& path : paths) {
        FrameRecord frame;
        frame.file = frame.status_detail = path.filename().string();
        frame.status = FrameStatus::complete;
        frame.device_id = frames.size() + 1;
        frames.push_back(frame);
    }
    return frames;
}

// A file outside the record's folder is none of it.
FrameRecord frame_inside(const JsonEntry& line) {
    FrameRecord frame = read_frame_record(line);
    if (frame.status != FrameStatus::complete)
        frame.file.clear();
    const fs::path file = fs::path(frame.file).lexically_normal();
    if (file.is_absolute() || (!file.empty() && *file.begin() == ".."))
        line.at("file").fail("the frame " + frame.file + " lies outside the record");
    return frame;
}

// A frame is logged before its image is written: the last images may be missing.
void leave_out_unwritten_end(const fs::path& folder, std::vector<FrameRecord>& frames) {
    const auto written = [&](const FrameRecord& frame) {
        std::error_code ignored;
        return !frame.file.empty() && fs::exists(folder / frame.file, ignored);
    };
    const auto after_the_last = std::find_if(frames.rbegin(), frames.rend(), written).base();
    const auto first_missing = std::find_if(
        after_the_last, frames.end(), [](const FrameRecord& frame) { return !frame.file.empty(); });
    frames.erase(first_missing, frames.end());
}

std::vector<FrameRecord> frames_in_log(const fs::path& folder) {
    std::vector<FrameRecord> frames;
    read_log(folder, [&](const JsonEntry& line) {
        if (line.at("event").text() == "frame")
            frames.push_back(frame_inside(line));
    });
    leave_out_unwritten_end(folder, frames);
    if (frames.empty())
        throw ConfigError({(folder / log_file).string()}, "lists no frame whose image is there");
    return frames;
}

}  // namespace

std::unique_ptr<Camera> open_files_camera(const fs::path& folder, Clock& clock) {
    return std::make_unique<FilesCamera>(folder, clock);
}

RecordedFrames recorded_frames(const fs::path& folder) {
    std::error_code ignored;
    const bool are_logged = fs::is_regular_file(folder / log_file, ignored);
    return {folder, are_logged ? frames_in_log(folder) : images_in(folder), are_logged};
}

}  // namespace etalon
