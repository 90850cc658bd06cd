// A libcamera camera that runs freely on a virtual clock: frames begin on a grid, take a buffer
// where one is queued, are stamped at their readout and arrive a period later; what requests ask
// for comes into force some frames on. Faults are scripted in the world that it shares with its
// test.
#pragma once

#include "capture/frame/pixel_formats.h"
#include "capture/libcamera/libcamera_device.h"

namespace etalon {

struct LibcameraWorld {
    VirtualClock clock;
    Duration period = std::chrono::milliseconds(20);
    Duration suspended{0};         // of the machine, since it booted
    bool stamps_boot_time = true;  // else monotonic

    std::vector<LibcameraFormat> formats;
    std::map<std::string, LibcameraRange> controls;
    std::vector<std::string> mentioned;   // of the controls, in the frames' metadata
    std::map<std::string, double> stuck;  // what these controls have, whatever is asked
    int delay = 3;                        // frames
    std::string model = "Fake sensor";

    bool plugged = true;
    bool announces_unplugging = true;
    // Each frame on its way, with the beginning of its exposure; if set.
    std::function<void(LibcameraFrame&, Instant)> spoil;
    std::function<bool(Instant)> loses;  // the frame whose exposure begins then, if set
    Instant frozen_until{};              // no frame arrives before

    // What exposures beginning at a time see.
    std::function<CodeImage(Instant)> scene;

    int opened = 0, stopped = 0;
};

class FakeLibcamera final : public LibcameraDevice {
public:
    explicit FakeLibcamera(LibcameraWorld& world) : world_(world) {
        if (!world_.plugged)
            throw DeviceError("fake", "open", "no such camera");
        ++world_.opened;
        identity_ = {"libcamera:fake", "", world_.model, ""};
        for (const auto& [control, range] : world_.controls)
            values_[control] = range.standard;
    }
    ~FakeLibcamera() override { stop(); }

    const CameraIdentity& identity() const override { return identity_; }
    std::vector<LibcameraFormat> formats() const override { return world_.formats; }
    std::map<std::string, LibcameraRange> controls() const override { return world_.controls; }

    LibcameraStream configure(const std::string& format, cv::Size size) override {
        format_ = find_libcamera_format(format);
        const cv::Size largest = world_.formats.front().sizes.back().largest;
        size_ = size.empty() ? largest
                             : cv::Size(std::min(size.width, largest.width),
                                        std::min(size.height, largest.height));
        line_ = line_bytes(*format_, size_.width) + 6;  // padded
        return {format, size_, line_, format == "YUYV"};
    }

    void start(const std::vector<LibcameraValues>& controls) override {
        require_plugged();
        running_ = true;
        sequence_ = 0;
        next_begin_ = world_.clock.now() + world_.period / 3;
        carried_.assign(controls.begin(), controls.end());
        carried_.resize(buffers);
        for (int i = 0; i < buffers; ++i)
            queued_.push_back(i);
    }

    std::optional<LibcameraFrame> next(Duration at_most, const std::stop_token& stop) override {
        if (stop.stop_requested())
            throw Interrupted();
        const Instant deadline = world_.clock.now() + at_most;
        run_until(world_.clock.now());
        while (arrived_.empty() && world_.plugged && !queued_.empty() &&
               arrival(next_begin_) <= deadline) {
            world_.clock.wait_until(arrival(next_begin_), {});
            run_until(world_.clock.now());
        }
        if (arrived_.empty() || !world_.plugged) {
            if (!disconnected())
                world_.clock.wait_until(deadline, {});
            return std::nullopt;
        }
        LibcameraFrame frame = arrived_.front();
        arrived_.pop_front();
        return frame;
    }

    void give_back(int buffer) override {
        queued_.push_back(buffer);
        carried_.emplace_back();
    }

    KernelTime time() const override {
        const std::int64_t now = nanoseconds(world_.clock.now());
        return {now, now + world_.suspended.count()};
    }

    bool disconnected() const override { return !world_.plugged && world_.announces_unplugging; }

    bool is_silently_gone() const override { return !world_.plugged; }

    void stop() noexcept override {
        if (running_)
            ++world_.stopped;
        running_ = false;
        arrived_.clear();
        queued_.clear();
        carried_.clear();
        pending_.clear();
    }

private:
    static constexpr int buffers = 4;

    static std::int64_t nanoseconds(Instant t) {
        return std::chrono::nanoseconds(t.time_since_epoch() + std::chrono::hours(1)).count();
    }

    void require_plugged() const {
        if (!world_.plugged)
            throw DeviceError("fake", "start", "No such device");
    }

    Instant arrival(Instant begin) const {
        return std::max(begin + world_.period + world_.period / 4, world_.frozen_until);
    }

    // Everything that happens up to a time.
    void run_until(Instant time) {
        while (running_ && world_.plugged && arrival(next_begin_) <= time) {
            expose();
            next_begin_ += world_.period;
            ++sequence_;
        }
    }

    void expose() {
        const std::uint64_t sequence = sequence_;
        if (!pending_.empty() && pending_.front().first <= sequence) {
            for (const auto& [control, value] : pending_.front().second)
                values_[control] = value;
            pending_.pop_front();
        }
        if (queued_.empty() || (world_.loses && world_.loses(next_begin_)))
            return;
        const int buffer = queued_.front();
        queued_.pop_front();
        const LibcameraValues asked = carried_.front();
        carried_.pop_front();
        pending_.emplace_back(sequence + static_cast<std::uint64_t>(world_.delay), asked);
        arrived_.push_back(frame_in(buffer));
        if (world_.spoil)
            world_.spoil(arrived_.back(), next_begin_);
    }

    LibcameraFrame frame_in(int buffer) {
        LibcameraFrame frame;
        frame.buffer = buffer;
        frame.sequence = sequence_;
        for (const auto& [control, value] : world_.stuck)
            values_[control] = value;
        for (const std::string& control : world_.mentioned)
            frame.metadata[control] = values_.at(control);
        const auto exposure = std::chrono::microseconds(
            values_.count("ExposureTime") ? static_cast<long>(values_["ExposureTime"]) : 7000);
        frame.timestamp_ns = nanoseconds(next_begin_ + exposure) +
                             (world_.stamps_boot_time ? world_.suspended.count() : 0);
        memory_[buffer] = packed(world_.scene(next_begin_));
        frame.data = memory_[buffer];
        return frame;
    }

    // The test's own packing: words with the low byte first, or every other byte.
    std::vector<std::uint8_t> packed(const CodeImage& scene) const {
        std::vector<std::uint8_t> bytes(line_ * static_cast<std::size_t>(size_.height), 0x5A);
        for (int y = 0; y < size_.height; ++y)
            for (int x = 0; x < size_.width; ++x) {
                std::uint8_t* line = bytes.data() + static_cast<std::size_t>(y) * line_;
                if (format_->bits > 8) {
                    const int code = scene.pixels.at<std::uint16_t>(y, x);
                    line[2 * x] = static_cast<std::uint8_t>(code & 255);
                    line[2 * x + 1] = static_cast<std::uint8_t>(code / 256);
                } else {
                    line[format_->libcamera == "YUYV" ? 2 * x : x] =
                        scene.pixels.at<std::uint8_t>(y, x);
                }
            }
        return bytes;
    }

    LibcameraWorld& world_;
    CameraIdentity identity_;
    const PixelFormat* format_ = nullptr;
    cv::Size size_;
    std::size_t line_ = 0;
    bool running_ = false;
    std::uint64_t sequence_ = 0;
    Instant next_begin_{};
    std::deque<int> queued_;
    std::deque<LibcameraValues> carried_;
    std::deque<std::pair<std::uint64_t, LibcameraValues>> pending_;
    std::map<std::string, double> values_;
    std::deque<LibcameraFrame> arrived_;
    std::map<int, std::vector<std::uint8_t>> memory_;
};

}  // namespace etalon
