#include "capture/libcamera/libcamera_device.h"

#include <libcamera/camera.h>
#include <libcamera/camera_manager.h>
#include <libcamera/control_ids.h>
#include <libcamera/framebuffer_allocator.h>
#include <libcamera/logging.h>
#include <libcamera/property_ids.h>
#include <libcamera/version.h>
#include <linux/dma-buf.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <ctime>

#include "capture/frame/handover_queue.h"

namespace etalon {
namespace {

std::string reason(int negative_errno) {
    return std::generic_category().message(-negative_errno);
}

// ---- the one camera manager ----------------------------------------------------------------

// libcamera allows one manager in a process. It lives while somebody holds a lease; the next one
// looks for cameras afresh, which finds one that came back without udev.
class ManagerLease {
public:
    ManagerLease() {
        const std::lock_guard lock(shared().mutex);
        if (shared().leases == 0)
            shared().manager = started_manager();
        ++shared().leases;
    }
    ~ManagerLease() {
        const std::lock_guard lock(shared().mutex);
        if (--shared().leases == 0)
            shared().manager.reset();
    }
    ManagerLease(const ManagerLease&) = delete;
    ManagerLease& operator=(const ManagerLease&) = delete;

    libcamera::CameraManager* operator->() const { return shared().manager.get(); }

    // Null if there is none, nor soon: one that was plugged in a moment ago takes some time.
    std::shared_ptr<libcamera::Camera> find(const std::string& id) const {
        constexpr auto patience = std::chrono::milliseconds(200);
        auto camera = shared().manager->get(id);
        while (!camera && shared().arrivals.pop(patience, {}))
            camera = shared().manager->get(id);
        return camera;
    }

private:
    struct Shared {
        std::mutex mutex;
        std::unique_ptr<libcamera::CameraManager> manager;
        int leases = 0;
        HandoverQueue<bool> arrivals;

        // Comes on libcamera's thread.
        void camera_added(std::shared_ptr<libcamera::Camera>) { arrivals.push(true); }
    };
    static Shared& shared() {
        static Shared& one = *new Shared;  // for as long as the background may still use it
        return one;
    }

    static std::unique_ptr<libcamera::CameraManager> started_manager() {
        // It would write to stderr, which is the program's; an operator can still ask it to.
        if (!std::getenv("LIBCAMERA_LOG_LEVELS") && !std::getenv("LIBCAMERA_LOG_FILE"))
            libcamera::logSetTarget(libcamera::LoggingTargetNone);
        auto manager = std::make_unique<libcamera::CameraManager>();
        manager->cameraAdded.connect(&shared(), &Shared::camera_added);
        if (const int result = manager->start(); result < 0)
            throw DeviceError("libcamera", "start", reason(result));
        return manager;
    }
};

// ---- values --------------------------------------------------------------------------------

// Calls `use` with a zero of the scalar's type; not at all for rectangles and texts.
template <class Use>
void with_scalar(libcamera::ControlType type, const Use& use) {
    switch (type) {
        case libcamera::ControlTypeBool:
            return use(bool{});
        case libcamera::ControlTypeByte:
            return use(std::uint8_t{});
        case libcamera::ControlTypeInteger32:
            return use(std::int32_t{});
        case libcamera::ControlTypeInteger64:
            return use(std::int64_t{});
        case libcamera::ControlTypeFloat:
            return use(float{});
        default:
            return;
    }
}

std::optional<double> number_in(const libcamera::ControlValue& value) {
    std::optional<double> number;
    if (!value.isArray())
        with_scalar(value.type(),
                    [&](auto zero) { number = static_cast<double>(value.get<decltype(zero)>()); });
    return number;
}

libcamera::ControlValue value_of(libcamera::ControlType type, double number) {
    libcamera::ControlValue value;
    with_scalar(type, [&](auto zero) { value.set(static_cast<decltype(zero)>(number)); });
    return value;
}

LibcameraValues values_in(const libcamera::ControlList& list) {
    LibcameraValues values;
    if (!list.idMap())
        return values;
    for (const auto& [id, value] : list) {
        const auto known = list.idMap()->find(id);
        const std::optional<double> number = number_in(value);
        if (known != list.idMap()->end() && number)
            values[known->second->name()] = *number;
    }
    return values;
}

CameraIdentity identity_of(const libcamera::Camera& camera) {
    CameraIdentity identity{"libcamera:" + printable(camera.id()), "", "", ""};
    if (const auto model = camera.properties().get(libcamera::properties::Model))
        identity.model = printable(*model);
    return identity;
}

cv::Size size_of(const libcamera::Size& size) {
    return {static_cast<int>(size.width), static_cast<int>(size.height)};
}

std::vector<FrameSizes> sizes_of(const libcamera::StreamFormats& formats,
                                 const libcamera::PixelFormat& format) {
    const libcamera::SizeRange range = formats.range(format);
    if (range.hStep && range.vStep)
        return {{size_of(range.min), size_of(range.max),
                 cv::Size(static_cast<int>(range.hStep), static_cast<int>(range.vStep))}};
    std::vector<FrameSizes> sizes;
    for (const libcamera::Size& size : formats.sizes(format))
        sizes.push_back({size_of(size), size_of(size)});
    return sizes;
}

// ---- buffers -------------------------------------------------------------------------------

// The first plane of a frame buffer, mapped for reading: all of a frame, or its luma.
class MappedPlane {
public:
    explicit MappedPlane(const libcamera::FrameBuffer& buffer)
        : buffer_(buffer), plane_(buffer.planes()[0]), length_(plane_.offset + plane_.length) {
        memory_ = mmap(nullptr, length_, PROT_READ, MAP_SHARED, plane_.fd.get(), 0);
        if (memory_ == MAP_FAILED)
            throw std::system_error(errno, std::generic_category());
    }
    ~MappedPlane() { munmap(memory_, length_); }
    MappedPlane(const MappedPlane&) = delete;
    MappedPlane& operator=(const MappedPlane&) = delete;

    // Reading begins or ends, for caches that the device's writing passes by; others refuse.
    void synchronise(std::uint64_t begin_or_end) const {
        dma_buf_sync sync{DMA_BUF_SYNC_READ | begin_or_end};
        ioctl(plane_.fd.get(), DMA_BUF_IOCTL_SYNC, &sync);
    }

    std::span<const std::uint8_t> filled() const {
        const auto planes = buffer_.metadata().planes();
        const std::size_t used = planes.empty() ? 0 : planes[0].bytesused;
        return {static_cast<const std::uint8_t*>(memory_) + plane_.offset,
                std::min<std::size_t>(used, plane_.length)};
    }

private:
    const libcamera::FrameBuffer& buffer_;
    const libcamera::FrameBuffer::Plane& plane_;
    std::size_t length_;
    void* memory_ = nullptr;
};

// ---- devices that are gone ------------------------------------------------------------------

// Whether the kernel has taken away a video device that this process has open. libcamera does not
// say which devices are its own, so all of them are asked: a question that changes nothing.
bool a_video_device_is_gone() {
    constexpr unsigned video4linux_major = 81;
    std::error_code unreadable;
    for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", unreadable)) {
        const int descriptor = std::atoi(entry.path().filename().c_str());
        struct stat file {};
        v4l2_capability capability{};
        if (fstat(descriptor, &file) == 0 && S_ISCHR(file.st_mode) &&
            major(file.st_rdev) == video4linux_major &&
            ioctl(descriptor, VIDIOC_QUERYCAP, &capability) < 0 && errno == ENODEV)
            return true;
    }
    return false;
}

// ---- the device ----------------------------------------------------------------------------

class Device final : public LibcameraDevice {
public:
    explicit Device(std::shared_ptr<libcamera::Camera> camera)
        : camera_(std::move(camera)), identity_(identity_of(*camera_)) {
        if (const int result = camera_->acquire(); result == -EBUSY)
            fail("open", "another program uses it");
        else
            require("open", result);
        camera_->requestCompleted.connect(this, &Device::request_completed);
        camera_->disconnected.connect(this, &Device::camera_disconnected);
    }

    ~Device() override {
        stop();
        camera_->disconnected.disconnect(this);
        camera_->requestCompleted.disconnect(this);
        configuration_.reset();
        camera_->release();
        camera_.reset();  // before the manager
    }

    const CameraIdentity& identity() const override { return identity_; }

    std::vector<LibcameraFormat> formats() const override {
        std::vector<LibcameraFormat> formats;
        for (const auto& proposal : proposals()) {
            const libcamera::StreamFormats& offered = proposal->at(0).formats();
            for (const libcamera::PixelFormat& format : offered.pixelformats()) {
                const std::string name = format.toString();
                if (std::none_of(formats.begin(), formats.end(),
                                 [&](const LibcameraFormat& known) { return known.name == name; }))
                    formats.push_back({name, sizes_of(offered, format)});
            }
        }
        return formats;
    }

    std::map<std::string, LibcameraRange> controls() const override {
        std::map<std::string, LibcameraRange> controls;
        for (const auto& [id, info] : camera_->controls()) {
            const auto low = number_in(info.min()), high = number_in(info.max());
            if (low && high && *low <= *high)  // some drivers' limits are nonsense
                controls[id->name()] = {*low, *high, number_in(info.def()).value_or(*low)};
        }
        return controls;
    }

    LibcameraStream configure(const std::string& format, cv::Size size) override {
        const auto wanted = libcamera::PixelFormat::fromString(format);
        configuration_ = proposal_with(wanted);
        if (!configuration_)
            fail("set pixel format " + format, "the camera does not offer it");
        libcamera::StreamConfiguration& stream = configuration_->at(0);
        stream.pixelFormat = wanted;
        if (!size.empty())
            stream.size = {static_cast<unsigned>(size.width), static_cast<unsigned>(size.height)};
        const std::string request = "configure " + stream.toString();
        if (configuration_->validate() == libcamera::CameraConfiguration::Invalid)
            fail(request, "libcamera finds it invalid");
        require(request, camera_->configure(configuration_.get()));
        const auto& colour = stream.colorSpace;
        return {stream.pixelFormat.toString(), size_of(stream.size), stream.stride,
                colour && colour->ycbcrEncoding != libcamera::ColorSpace::YcbcrEncoding::None &&
                    colour->range == libcamera::ColorSpace::Range::Limited};
    }

    void start(const std::vector<LibcameraValues>& controls) override {
        if (!configuration_)
            fail("start", "the camera is not configured");
        make_requests();
        require("start", camera_->start());
        running_ = true;
        for (std::size_t i = 0; i < requests_.size(); ++i) {
            if (i < controls.size())
                set_controls(*requests_[i], controls[i]);
            queue(*requests_[i]);
        }
    }

    std::optional<LibcameraFrame> next(Duration at_most, const std::stop_token& stop) override {
        const std::optional<libcamera::Request*> completed = completed_.pop(at_most, stop);
        if (!completed)
            return std::nullopt;
        --queued_;
        libcamera::Request& request = **completed;
        LibcameraFrame frame;
        frame.buffer = static_cast<int>(request.cookie());
        const libcamera::FrameMetadata& buffer = request.buffers().begin()->second->metadata();
        frame.status = request.status() == libcamera::Request::RequestCancelled
                           ? LibcameraFrame::Status::cancelled
                       : buffer.status == libcamera::FrameMetadata::FrameSuccess
                           ? LibcameraFrame::Status::complete
                           : LibcameraFrame::Status::error;
        if (frame.status == LibcameraFrame::Status::cancelled)
            return frame;
        frame.sequence = buffer.sequence;
        frame.timestamp_ns = request.metadata().get(libcamera::controls::SensorTimestamp);
        frame.metadata = values_in(request.metadata());
        const MappedPlane& plane = *planes_[request.cookie()];
        plane.synchronise(DMA_BUF_SYNC_START);
        frame.data = plane.filled();
        return frame;
    }

    void give_back(int buffer) override {
        const auto index = static_cast<std::size_t>(buffer);
        planes_.at(index)->synchronise(DMA_BUF_SYNC_END);
        requests_[index]->reuse(libcamera::Request::ReuseBuffers);
        queue(*requests_[index]);
    }

    KernelTime time() const override {
        const auto read = [](clockid_t clock) {
            timespec time{};
            clock_gettime(clock, &time);
            return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
        };
        return {read(CLOCK_MONOTONIC), read(CLOCK_BOOTTIME)};
    }

    bool disconnected() const override { return disconnected_; }
    bool is_silently_gone() const override { return a_video_device_is_gone(); }

    void stop() noexcept override {
        if (running_) {
            wait_until_stopping_is_safe();
            camera_->stop();
        }
        running_ = false;
        queued_ = 0;
        completed_.clear();
        requests_.clear();
        planes_.clear();
        allocator_.reset();
    }

private:
    void require(const std::string& request, int result) const {
        if (result < 0)
            fail(request, disconnected_ ? "the camera is gone" : reason(result));
    }

    [[noreturn]] void fail(const std::string& request, const std::string& cause) const {
        throw DeviceError("camera " + identity_.uri, request, cause);
    }

    // One stream each: the sensor's own codes, and what a processor makes of them. A USB camera
    // proposes the same for both.
    std::vector<std::unique_ptr<libcamera::CameraConfiguration>> proposals() const {
        std::vector<std::unique_ptr<libcamera::CameraConfiguration>> proposals;
        for (const libcamera::StreamRole role :
             {libcamera::StreamRole::Raw, libcamera::StreamRole::Viewfinder}) {
            auto proposal = camera_->generateConfiguration({role});
            if (proposal && !proposal->empty())
                proposals.push_back(std::move(proposal));
        }
        return proposals;
    }

    std::unique_ptr<libcamera::CameraConfiguration> proposal_with(
        const libcamera::PixelFormat& format) const {
        for (auto& proposal : proposals()) {
            const auto offered = proposal->at(0).formats().pixelformats();
            if (std::find(offered.begin(), offered.end(), format) != offered.end())
                return std::move(proposal);
        }
        return nullptr;
    }

    void make_requests() {
        libcamera::Stream* stream = configuration_->at(0).stream();
        allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
        require("allocate buffers", allocator_->allocate(stream));
        for (const auto& buffer : allocator_->buffers(stream)) {
            if (buffer->planes().empty())
                fail("allocate buffers", "one has no memory");
            auto request = camera_->createRequest(planes_.size());
            if (!request)
                fail("create a request", "libcamera gave none");
            require("create a request", request->addBuffer(stream, buffer.get()));
            try {
                planes_.push_back(std::make_unique<MappedPlane>(*buffer));
            } catch (const std::system_error& error) {
                fail("map a buffer", error.code().message());
            }
            requests_.push_back(std::move(request));
        }
    }

    void set_controls(libcamera::Request& request, const LibcameraValues& values) const {
        for (const auto& [id, info] : camera_->controls())
            if (const auto value = values.find(id->name()); value != values.end())
                request.controls().set(id->id(), value_of(id->type(), value->second));
    }

    void queue(libcamera::Request& request) {
        require("queue a request", camera_->queueRequest(&request));
        ++queued_;
    }

    // libcamera ends the program (assertion in PipelineHandler::stop()) when it stops a device that
    // is gone, unknown to it, with queued requests. So they must have come back, or it must know.
    void wait_until_stopping_is_safe() {
        while (queued_ > 0 && !disconnected_ && a_video_device_is_gone())
            if (completed_.pop(std::chrono::seconds(1), {}))
                --queued_;
    }

    // These two come on libcamera's thread.
    void request_completed(libcamera::Request* request) { completed_.push(request); }
    void camera_disconnected() {
        disconnected_ = true;
        completed_.end();
    }

    ManagerLease manager_;
    std::shared_ptr<libcamera::Camera> camera_;
    CameraIdentity identity_;

    std::unique_ptr<libcamera::CameraConfiguration> configuration_;
    std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
    std::vector<std::unique_ptr<MappedPlane>> planes_;
    std::vector<std::unique_ptr<libcamera::Request>> requests_;  // one for each plane
    bool running_ = false;
    int queued_ = 0;  // requests that have not come back

    HandoverQueue<libcamera::Request*> completed_;
    std::atomic<bool> disconnected_{false};
};

}  // namespace

// Twice: libcamera misses what udev announces after its look and before it listens.
std::unique_ptr<LibcameraDevice> open_libcamera_device(const std::string& id) {
    for (int look = 1; look <= 2; ++look) {
        const ManagerLease manager;
        if (auto camera = manager.find(id))
            return std::make_unique<Device>(std::move(camera));
    }
    throw DeviceError("camera libcamera:" + id, "open",
                      "no such camera; `etalon devices` lists those that there are");
}

std::vector<CameraIdentity> list_libcamera_cameras() {
    std::vector<CameraIdentity> found;
    try {
        const ManagerLease manager;
        for (const auto& camera : manager->cameras())
            found.push_back(identity_of(*camera));
    } catch (const DeviceError&) {
        // Without a look at the devices there are none to show.
    }
    return found;
}

namespace {

struct Neutral {
    const char* control;
    double value;
};

// libcamera's definitions of the controls say these values. Modes: manual or off.
constexpr Neutral neutral_values[] = {
    {"AeEnable", 0},
    {"ExposureTimeMode", 1},
    {"AnalogueGainMode", 1},
    {"AeFlickerMode", 0},
    {"AwbEnable", 0},
    {"AfMode", 0},
    {"HdrMode", 0},
    {"WdrMode", 0},
    {"NoiseReductionMode", 0},
    {"Sharpness", 0},
    {"Brightness", 0},
    {"Contrast", 1},
    {"Saturation", 1},
    {"Gamma", 1},
};

LibcameraValues asked_values(const CaptureSettings& wanted) {
    LibcameraValues asked(wanted.controls.begin(), wanted.controls.end());
    if (wanted.exposure.count())
        asked["ExposureTime"] = static_cast<double>(wanted.exposure.count());
    asked["AnalogueGain"] = gain_factor(wanted.gain_db);
    return asked;
}

// What the difference between two readings of one control may be: the step of the exposure, that of
// the gain (0.05 dB), else rounding to the sensor's own steps.
double tolerance(const std::string& control, double value, double exposure_step_us) {
    if (control == "ExposureTime")
        return exposure_step_us;
    if (control == "AnalogueGain")
        return value * (gain_factor(0.05) - 1.0);
    return 0.005 * std::abs(value);
}

}  // namespace

// ---- formats -------------------------------------------------------------------------------

const PixelFormat* choose_libcamera_format(const CaptureSettings& wanted,
                                           const std::vector<LibcameraFormat>& offered) {
    const PixelFormat* chosen = nullptr;
    for (const LibcameraFormat& format : offered) {
        const PixelFormat* known = find_libcamera_format(format.name);
        if (!known || known->bits < wanted.bits)
            continue;
        if (format.name == wanted.format)
            return known;
        const bool same_container = (known->bits <= 8) == (wanted.bits <= 8);
        const bool monochrome = known->mosaic == Mosaic::none && !known->lossy();
        if (wanted.format.empty() && same_container && monochrome &&
            (!chosen || known->bits < chosen->bits))
            chosen = known;
    }
    return chosen;
}

std::optional<SettingDifference> stream_difference(const std::string& format, cv::Size size,
                                                   const LibcameraStream& stream) {
    if (stream.format != format)
        return SettingDifference{"set pixel format " + format,
                                 "libcamera adjusts it to " + stream.format};
    if ((size.width && size.width != stream.size.width) ||
        (size.height && size.height != stream.size.height))
        return SettingDifference{
            fmt::format("set image size {}x{}", size.width, size.height),
            fmt::format("libcamera adjusts it to {}x{}", stream.size.width, stream.size.height)};
    return std::nullopt;
}

// ---- controls ------------------------------------------------------------------------------

LibcameraPlanning plan_libcamera_controls(const CaptureSettings& wanted,
                                          const std::map<std::string, LibcameraRange>& offered) {
    LibcameraPlan plan;
    for (const auto& [control, neutral] : neutral_values) {
        const auto range = offered.find(control);
        if (range == offered.end() || wanted.controls.count(control))
            continue;
        const double nearest = std::clamp(neutral, range->second.low, range->second.high);
        plan.automatics[control] = nearest;
        if (nearest != neutral)
            plan.remarks.push_back(
                fmt::format("{} stays at {}: it cannot be switched off", control, nearest));
    }
    for (const auto& [control, value] : asked_values(wanted)) {
        const auto range = offered.find(control);
        const bool wish_for_nothing = control == "AnalogueGain" && wanted.gain_db == 0.0;
        if (range == offered.end() && wish_for_nothing)
            continue;
        const std::string request = "set " + in_words(control, value);
        if (range == offered.end())
            return {plan, SettingDifference{request, "the camera has no control " + control}};
        const auto& [low, high, standard] = range->second;
        if (value < low || value > high)
            return {plan, SettingDifference{
                              request, fmt::format("possible are {} to {}", in_words(control, low),
                                                   in_words(control, high))}};
        plan.asked[control] = value;
    }
    return {plan, std::nullopt};
}

std::optional<SettingDifference> contradicted(const LibcameraValues& asked,
                                              const LibcameraValues& metadata,
                                              double exposure_step_us) {
    for (const auto& [control, value] : asked) {
        const auto actual = metadata.find(control);
        if (actual != metadata.end() &&
            !(std::abs(actual->second - value) <= tolerance(control, value, exposure_step_us)))
            return SettingDifference{"set " + in_words(control, value),
                                     "the frames say " + in_words(control, actual->second)};
    }
    return std::nullopt;
}

std::string in_words(const std::string& control, double value) {
    if (control == "ExposureTime")
        return fmt::format("exposure {} us", value);
    if (control == "AnalogueGain")
        return fmt::format("gain {:.4g} dB", gain_db(value));
    return fmt::format("{} {:.6g}", control, value);
}

double gain_factor(double gain_db) {
    return std::pow(10.0, gain_db / 20.0);
}

double gain_db(double gain_factor) {
    return 20.0 * std::log10(gain_factor);
}

// ---- time ----------------------------------------------------------------------------------

SensorClock::Age SensorClock::age(std::int64_t stamp_ns, const KernelTime& now) {
    using std::chrono::nanoseconds;
    constexpr nanoseconds too_short_to_tell = std::chrono::seconds(1);
    const nanoseconds suspended(now.boot_ns - now.monotonic_ns);
    counts_suspension_ = counts_suspension_ || stamp_ns > now.monotonic_ns;
    const std::int64_t reference = counts_suspension_ ? now.boot_ns : now.monotonic_ns;
    return {nanoseconds(reference - stamp_ns),
            suspended < too_short_to_tell ? std::max(suspended, nanoseconds(0)) : nanoseconds(0)};
}

std::optional<Duration> FrameTiming::period() const {
    if (!first_ || last_->sequence <= first_->sequence)
        return std::nullopt;
    const auto frames = static_cast<std::int64_t>(last_->sequence - first_->sequence);
    return std::chrono::nanoseconds((last_->time_ns - first_->time_ns) / frames);
}

// How long before its stamp the exposure of the newest frame may have begun.
std::optional<Duration> FrameTiming::longest_age(const LibcameraFrame& frame) const {
    if (const auto exposure = frame.metadata.find("ExposureTime"); exposure != frame.metadata.end())
        return std::chrono::microseconds(std::llround(exposure->second));
    return usb_delay_.longest();
}

FrameTiming::Start FrameTiming::place(const LibcameraFrame& frame, const KernelTime& now,
                                      Instant station_now) {
    if (!frame.timestamp_ns)
        return {"the frame has no SensorTimestamp"};
    const Stamp stamp{frame.sequence, *frame.timestamp_ns};
    usb_delay_.came(frame.sequence, std::chrono::nanoseconds(stamp.time_ns));
    const auto before = std::exchange(last_, stamp);
    if (before && stamp.time_ns <= before->time_ns) {
        first_ = stamp;
        return {fmt::format("stamped {} ns before the frame that came before it",
                            before->time_ns - stamp.time_ns)};
    }
    if (!first_)
        first_ = stamp;
    const SensorClock::Age stamped = clock_.age(stamp.time_ns, now);
    if (stamped.age + stamped.uncertainty < Duration(0))
        return {fmt::format("stamped {} ns in the future", -stamped.age.count())};
    Start start;
    start.latest = std::min(station_now - stamped.age + stamped.uncertainty, station_now);
    if (const auto longest = longest_age(frame))
        start.earliest = station_now - stamped.age - stamped.uncertainty - *longest;
    return start;
}

}  // namespace etalon
