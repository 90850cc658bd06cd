// One open video node: checked questions and its image formats. Source: the kernel's Video for
// Linux API, part I (linux/videodev2.h).
#pragma once

#include <sys/types.h>

#include "capture/frame/camera.h"
#include "capture/frame/pixel_formats.h"

namespace etalon {

// The V4L2 backend's system calls, for a scripted device in tests. Results are the kernel's: 0 or
// more, or the negative error number. Nothing throws or retries.
class V4l2System {
public:
    virtual ~V4l2System() = default;

    // Paths of the video nodes that exist now ("/dev/video0"), by number.
    virtual std::vector<std::string> nodes() = 0;

    // Of the USB device behind a node; empty where there is none.
    virtual std::string serial_number(const std::string& node) = 0;

    virtual int open(const std::string& node) = 0;  // for reading and writing, not blocking
    virtual int close(int file) = 0;
    virtual int ioctl(int file, unsigned long request, void* argument) = 0;

    // Shared memory of a buffer, for reading; null when refused.
    virtual void* map(int file, std::size_t length, off_t offset) = 0;
    virtual void unmap(void* memory, std::size_t length) = 0;

    // Waits for a filled buffer: the kernel's event bits (POLLIN, POLLERR ...), 0 at the time-out.
    virtual int poll(int file, std::chrono::milliseconds timeout) = 0;
};

// The machine's own. Safe from every thread.
V4l2System& v4l2_system();

// What a node says of itself.
struct V4l2Identity {
    std::string driver, card;  // "uvcvideo", "Synthetic UVC camera"
    std::string bus;     // where it is plugged in, "usb-0000:00:14.0-1": the same after replug
    std::string serial;  // empty where unknown
    bool operator==(const V4l2Identity&) const = default;
};

// The format in force. Lines may be longer than their pixels.
struct V4l2ImageFormat {
    const PixelFormat* pixels = nullptr;
    int width = 0, height = 0;
    std::size_t bytes_per_line = 0;  // 0 for compressed formats
};

class V4l2Device {
public:
    // Opens the node. Throws DeviceError when it cannot be opened or captures no video. `name` is
    // for errors ("camera v4l2:/dev/video0"); the system outlives the device.
    V4l2Device(V4l2System& system, const std::string& node, std::string name);
    ~V4l2Device();
    V4l2Device(const V4l2Device&) = delete;
    V4l2Device& operator=(const V4l2Device&) = delete;

    const V4l2Identity& identity() const { return identity_; }
    bool multi_planar() const { return multi_planar_; }
    V4l2System& system() const { return system_; }
    int file() const { return file_; }

    // The v4l2_buf_type of this node's buffers.
    unsigned buffer_type() const;

    // One ioctl, repeated after signals: 0 or the positive error. From ENODEV on it is lost.
    int ask(unsigned long request, void* argument);

    // The same, for what must succeed: `what` says it in an error ("start the stream").
    void require(unsigned long request, void* argument, const std::string& what);

    [[noreturn]] void fail(const std::string& what, const std::string& cause) const;
    [[noreturn]] void fail(const std::string& what, int error) const;

    // Whether the device has gone: every further request would fail.
    bool lost() const { return lost_; }
    void set_lost() { lost_ = true; }

    std::vector<CameraFormat> formats();

    // Sets and reads back; throws DeviceError when the driver changes anything. 0 keeps a size.
    V4l2ImageFormat set_format(const PixelFormat& pixels, int width, int height);

    // Between two frames, as the driver says; 0 where it does not.
    Duration frame_period();

    // No control of V4L2's, but set and listed like one (Hz, to a hundredth). Nothing: unknown.
    std::optional<double> frame_rate();
    void set_frame_rate(double hz);  // throws where it is none or the driver refuses
    std::optional<CameraControl> frame_rate_control();

private:
    void read_capability();
    std::vector<FrameSizes> sizes(std::uint32_t fourcc);
    void list_frame_rates(CameraControl& control);

    V4l2System& system_;
    std::string name_;
    int file_ = -1;
    bool multi_planar_ = false;
    bool lost_ = false;
    V4l2Identity identity_;
};

constexpr const char* frame_rate_name = "frame_rate";  // in CaptureSettings::controls

// How long a hanging driver is waited for: twice (stream, file) within 3 s.
inline constexpr std::chrono::milliseconds v4l2_patience{1200};

// As PixelFormat::v4l2 has it.
std::string v4l2_format_name(std::uint32_t fourcc);

// What is wrong, in words: "No such device (ENODEV)".
std::string describe_error(int error);

}  // namespace etalon
