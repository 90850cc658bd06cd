// A GenICam device under our control: opened, its transport set up, its errors turned into
// DeviceErrors, its loss noticed. What is asked of it is in genicam_settings.h, what comes from it
// in genicam_camera.cpp. Aravis' headers stay in .cpp files.
#pragma once

#include <atomic>

#include "capture/frame/camera.h"

typedef struct _ArvCamera ArvCamera;  // Aravis' own declarations
typedef struct _ArvDevice ArvDevice;
typedef struct _GError GError;

namespace etalon {

// Printable; "" where the library has no text.
std::string text_or_empty(const char* text);

// Receives an error of the library.
class ErrorSlot {
public:
    ErrorSlot() = default;
    ~ErrorSlot();
    ErrorSlot(const ErrorSlot&) = delete;
    ErrorSlot& operator=(const ErrorSlot&) = delete;

    GError** out() { return &error_; }
    explicit operator bool() const { return error_ != nullptr; }
    std::string message() const;
    bool is_silence() const;  // the device did not answer, or no longer obeys us

private:
    GError* error_ = nullptr;
};

struct UnrefObject {
    void operator()(void* object) const;
};

// On a thread: the library still tells a lost device something, for 2.5 s each time.
void release_in_background(std::shared_ptr<void> object) noexcept;

// Checks a camera's GenICam description, which Aravis (0.8.26) follows as it comes. Refuses what is
// not well-formed; a value that refers to itself, to more than 64 others one after another or to
// 100 000 in all; a register above 1 GiB. Throws Error with line and name. pLength is not seen.
void require_sound_description(const std::string& xml);

class GenicamDevice {
public:
    // `id`: an IP address or a device id. Throws DeviceError; CameraBusy: another program controls.
    GenicamDevice(const std::string& id, const CameraLink& link);
    ~GenicamDevice();

    ArvCamera* camera() const { return camera_.get(); }
    const CameraIdentity& identity() const { return identity_; }
    const std::vector<std::string>& remarks() const { return remarks_; }

    bool lost() const;
    void lose() { *lost_ = true; }

    [[noreturn]] void fail(const std::string& request, const std::string& cause) const;

    // One call of the library; its error becomes a DeviceError with the request. Silence: lost.
    template <typename Call>
    auto ask(const std::string& request, Call call) const {
        ErrorSlot error;
        if constexpr (std::is_void_v<decltype(call(error.out()))>) {
            call(error.out());
            require_answer(request, error);
        } else {
            const auto result = call(error.out());
            require_answer(request, error);
            return result;
        }
    }

    // The same of a function of the library that takes the camera, these arguments and an error.
    template <typename Result, typename... Parameters, typename... Arguments>
    Result call(const std::string& request, Result function(ArvCamera*, Parameters...),
                const Arguments&... arguments) const {
        return ask(request, [&](GError** e) { return function(camera(), arguments..., e); });
    }

    // The answer to a yes-or-no question; a device without the feature answers with an error or no.
    template <typename Call>
    bool says_yes(Call call) const {
        ErrorSlot error;
        const bool yes = call(error.out());
        if (error.is_silence())
            require_answer("ask for a feature", error);
        return yes && !error;
    }
    bool has(const char* feature) const;

private:
    void require_answer(const std::string& request, const ErrorSlot& error) const;
    void open(const std::string& id, const CameraLink& link);
    void check_description(ArvDevice* device) const;
    std::chrono::milliseconds heartbeat_timeout() const;
    void watch_control();
    void end_stream_of_another();
    void read_identity(const std::string& id);
    void set_up_transport(const CameraLink& link);
    void set_packets(const CameraLink& link);

    std::string name_;  // for errors
    CameraIdentity identity_;
    std::vector<std::string> remarks_;
    std::unique_ptr<ArvCamera, UnrefObject> camera_;
    // Set here, or by a thread of the library, which may outlive this object.
    std::shared_ptr<std::atomic<bool>> lost_ = std::make_shared<std::atomic<bool>>(false);
};

// Asked of the kernel for a stream, in bytes; without it a 1.3-megapixel camera at 50 Hz delivers
// nothing on loopback (measured).
inline constexpr int receive_buffer_bytes = 4 << 20;

// What the kernel grants of a UDP receive buffer of `asked` bytes; `asked` where it will not say.
int granted_receive_buffer(int asked);

// What an ArvBufferStatus means for the frame, and in words.
struct BufferVerdict {
    FrameStatus status;
    const char* detail;
};
BufferVerdict verdict_of_buffer(int status);

// Latches and reads the device's clock: its value at some moment within the window. Nothing without
// a readable clock, or no latch in 50 ms. Throws DeviceError without an answer. About 1 ms.
struct GenicamClockReading {
    std::uint64_t device_ns = 0;
    TimeWindow window;
};
std::optional<GenicamClockReading> read_genicam_clock(const GenicamDevice& device,
                                                      const Clock& clock);

// The device's clock in the Precision Time Protocol (IEEE 1588). While neither synchronised nor
// master it may be set at any moment, and a reading is worth nothing.
struct PtpState {
    std::string status;                     // in the device's words: "Listening", "Slave"
    std::optional<std::int64_t> offset_ns;  // of a slave from its master, by its own estimate

    bool steady() const { return status == "Slave" || status == "Master"; }
};

// Nothing where the device has no PTP or it is switched off; it is never switched here. Throws
// DeviceError when the device does not answer. About 1 ms on a network where it is on.
std::optional<PtpState> read_ptp(const GenicamDevice& device);

// Of the counter that GigE Vision devices stamp frames with; 0 for others, which count ns.
std::uint64_t genicam_tick_frequency(const GenicamDevice& device);
std::uint64_t nanoseconds_of_ticks(std::uint64_t ticks, std::uint64_t frequency);

}  // namespace etalon
