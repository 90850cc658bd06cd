#include "mocks/camera/gige_camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "capture/frame/pixel_formats.h"
#include "core/file/file_descriptor.h"
#include "core/program/errors.h"
#include "mocks/camera/gige_description.h"

namespace etalon {
namespace {

constexpr const char* address = "127.0.0.1";
constexpr int gige_vision_port = 3956;  // GVCP's, fixed by the standard
// The fake camera looks for a trigger this often. Its loop polls with whole milliseconds left and
// spins through the last one: 1000 Hz would burn a whole core.
constexpr double trigger_poll_hz = 200.0;

// Where the client writes where the stream goes (GigE Vision's bootstrap registers).
constexpr guint32 stream_port_register = 0x0d00;
constexpr guint32 stream_packet_size_register = 0x0d04;
constexpr guint32 stream_address_register = 0x0d18;

const std::string device_name = fmt::format("camera {}:{}", address, gige_vision_port);

// The fake camera does not notice that its port is taken: it stays deaf. So the port is bound for a
// moment first, exclusively. What remains is the race of two twins started in the same millisecond.
void require_free_port() {
    const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(gige_vision_port);
    inet_pton(AF_INET, address, &name.sin_addr);
    if (bind(socket.get(), reinterpret_cast<const sockaddr*>(&name), sizeof name) != 0)
        throw DeviceError(device_name, "listen", std::strerror(errno));
}

void require_usable(const GigeCameraOptions& options) {
    const auto fail = [](const std::string& message) {
        throw ConfigError({"", 0, "camera"}, message);
    };
    if (options.width < 1 || options.height < 1 || options.width > 16384 || options.height > 16384)
        fail(fmt::format("a sensor of {}x{} is impossible", options.width, options.height));
    if (options.bits < 1 || options.bits > 16)
        fail(fmt::format("{} bits are impossible", options.bits));
    if (options.serial.empty() || options.serial.size() > 15)
        fail("the serial number must have 1 to 15 characters");
    for (const std::string& format : options.formats)
        if (find_pfnc_format(format) == nullptr)
            fail("there is no pixel format " + format);
    if (!(options.packet_loss >= 0.0 && options.packet_loss <= 1.0))
        fail("the packet loss must be between 0 and 1");
}

// The client's region on the sensor: the pattern callback's buffer does not know its own size yet.
cv::Rect region_of(ArvBuffer* buffer) {
    int x = 0, y = 0, width = 0, height = 0;
    arv_buffer_get_image_region(buffer, &x, &y, &width, &height);
    return {x, y, width, height};
}

void copy_region(const cv::Mat& sensor, const cv::Rect& region, cv::Mat& out) {
    out.setTo(0);
    const cv::Rect seen = region & cv::Rect(0, 0, sensor.cols, sensor.rows);
    if (seen.empty() || sensor.type() != out.type())
        return;
    sensor(seen).copyTo(out(seen - region.tl()));
}

// Codes one after the other, low bits first (PFNC "p").
void pack_stream(const cv::Mat& codes, int bits, std::uint8_t* out) {
    std::uint32_t waiting = 0;
    int count = 0;
    for (int y = 0; y < codes.rows; ++y)
        for (int x = 0; x < codes.cols; ++x) {
            waiting |= static_cast<std::uint32_t>(codes.at<std::uint16_t>(y, x)) << count;
            for (count += bits; count >= 8; count -= 8, waiting >>= 8)
                *out++ = static_cast<std::uint8_t>(waiting);
        }
}

// Two codes in three bytes: high bits, the low bits of both, high bits (GigE Vision 1.2).
void pack_pairs(const cv::Mat& codes, int bits, std::uint8_t* out) {
    const int low = bits - 8;
    const int mask = (1 << low) - 1;
    for (int i = 0; i + 1 < codes.rows * codes.cols; i += 2) {
        const int first = codes.at<std::uint16_t>(i / codes.cols, i % codes.cols);
        const int second = codes.at<std::uint16_t>((i + 1) / codes.cols, (i + 1) % codes.cols);
        *out++ = static_cast<std::uint8_t>(first >> low);
        *out++ = static_cast<std::uint8_t>((first & mask) | (second & mask) << 4);
        *out++ = static_cast<std::uint8_t>(second >> low);
    }
}

void pack(const cv::Mat& codes, const PixelFormat& format, std::uint8_t* out) {
    if (format.packing == PixelPacking::bit_stream)
        pack_stream(codes, format.bits, out);
    else if (format.packing == PixelPacking::gige_pairs)
        pack_pairs(codes, format.bits, out);
    else
        std::memcpy(out, codes.data, codes.total() * codes.elemSize());
}

guint64 nanoseconds_now() {
    return static_cast<guint64>(g_get_real_time()) * 1000;
}

// The library reads the description from a file, once, while the camera is made.
class DescriptionFile {
public:
    explicit DescriptionFile(const std::string& text) {
        path_ = (std::filesystem::temp_directory_path() / "etalon-gige-XXXXXX").string();
        const FileDescriptor file(mkstemp(path_.data()));
        if (write(file.get(), text.data(), text.size()) != std::ssize(text))
            throw DeviceError(device_name, "write its description", std::strerror(errno));
    }
    ~DescriptionFile() { unlink(path_.c_str()); }
    DescriptionFile(const DescriptionFile&) = delete;
    DescriptionFile& operator=(const DescriptionFile&) = delete;

    const char* path() const { return path_.c_str(); }

private:
    std::string path_;
};

// ---- frames with chunks, which the fake camera does not know, built and sent by hand. The layout
// is what Wireshark's GVSP dissector and manuals of cameras say of GigE Vision; all is big-endian.

constexpr std::uint8_t leader_format = 1, trailer_format = 2, payload_format = 3;
constexpr std::size_t headers = 20 + 8 + 8;  // of IP, UDP and GVSP

using Bytes = std::vector<std::uint8_t>;

void append(Bytes& out, std::uint64_t value, int bytes) {
    for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8)
        out.push_back(static_cast<std::uint8_t>(value >> shift));
}

std::array<std::uint8_t, 8> bytes_of(std::uint64_t value, std::endian order) {
    std::array<std::uint8_t, 8> bytes;
    for (std::size_t i = 0; i < bytes.size(); ++i)
        bytes[order == std::endian::big ? 7 - i : i] = static_cast<std::uint8_t>(value >> 8 * i);
    return bytes;
}

}  // namespace

void append_chunk(std::vector<std::uint8_t>& payload, std::uint32_t id,
                  std::span<const std::uint8_t> data) {
    payload.insert(payload.end(), data.begin(), data.end());
    append(payload, id, 4);
    append(payload, data.size(), 4);
}

struct GvspLeader {
    std::uint16_t payload_type = image_with_chunks;
    std::uint64_t timestamp = 0;     // ticks
    std::uint32_t pixel_format = 0;  // PFNC
    cv::Rect region;                 // px
};

// A stream channel, as the client wrote it to the device's registers.
struct GvspChannel {
    std::uint32_t address = 0;  // in the host's byte order
    std::uint16_t port = 0;
    std::uint16_t packet_size = 0;  // bytes, the headers of IP, UDP and GVSP included
};

static Bytes leader_content(const GvspLeader& leader) {
    Bytes content;
    append(content, leader.payload_type, 4);
    append(content, leader.timestamp, 8);
    if (leader.payload_type == chunks_only)
        return content;
    append(content, leader.pixel_format, 4);
    for (const int number :
         {leader.region.width, leader.region.height, leader.region.x, leader.region.y})
        append(content, static_cast<std::uint32_t>(number), 4);
    append(content, 0, 4);  // no padding
    return content;
}

static Bytes trailer_content(const GvspLeader& leader) {
    Bytes content;
    append(content, leader.payload_type, 4);
    append(content, static_cast<std::uint32_t>(leader.region.height), 4);
    return content;
}

class GvspSender {
public:
    // Throws DeviceError.
    GvspSender() : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
        if (!socket_)
            throw DeviceError("camera", "open a stream socket", std::strerror(errno));
    }

    // One frame: leader, payload, trailer. Each packet is dropped with the chance `loss`. What the
    // network does not take is lost, as on a wire.
    void send(const GvspChannel& channel, const GvspLeader& leader,
              std::span<const std::uint8_t> payload, double loss) {
        if (channel.packet_size <= headers)
            return;
        to_.sin_family = AF_INET;
        to_.sin_port = htons(channel.port);
        to_.sin_addr.s_addr = htonl(channel.address);
        loss_ = loss;
        block_ = block_ == 65535 ? 1 : static_cast<std::uint16_t>(block_ + 1);
        packet_ = 0;
        send_packet(leader_format, leader_content(leader));
        const std::size_t room = channel.packet_size - headers;
        for (std::size_t sent = 0; sent < payload.size(); sent += room)
            send_packet(payload_format,
                        payload.subspan(sent, std::min(room, payload.size() - sent)));
        send_packet(trailer_format, trailer_content(leader));
    }

private:
    void send_packet(std::uint8_t format, std::span<const std::uint8_t> content) {
        Bytes packet;
        append(packet, 0, 2);  // success
        append(packet, block_, 2);
        append(packet, format, 1);
        append(packet, packet_++, 3);
        packet.insert(packet.end(), content.begin(), content.end());
        if (random_.uniform(0.0, 1.0) >= loss_)
            sendto(socket_.get(), packet.data(), packet.size(), 0,
                   reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
    }

    FileDescriptor socket_;
    sockaddr_in to_{};
    double loss_ = 0.0;
    std::uint16_t block_ = 65530;  // soon wraps, from 65535 to 1
    std::uint32_t packet_ = 0;
    cv::RNG random_{75};
};

struct GigeCamera::Device {
    GigeCameraOptions options;
    Source source;
    ArvGvFakeCamera* camera = nullptr;

    std::mutex mutex;
    std::condition_variable changed;
    bool frozen = false;
    bool ending = false;
    int lossy_frames = 0, short_frames = 0;  // still to come
    double lossy_part = 0.0;                 // of their packets
    std::chrono::nanoseconds clock_offset{0};
    std::thread latch;

    std::optional<GvspSender> sender;  // of frames with chunks
    std::uint64_t exposures = 70000;   // as the chunks count them: not as the stream does
    std::function<void(GigeChunkValues&)> alter_values;
    std::function<void(std::vector<std::uint8_t>&)> alter_payload;

    Device(const GigeCameraOptions& given, Source shown)
        : options(given), source(std::move(shown)) {}
    ~Device() {
        {
            const std::lock_guard lock(mutex);
            ending = true;
        }
        changed.notify_all();
        if (latch.joinable())
            latch.join();
        if (camera)
            g_object_unref(camera);  // joins its thread, which may still be filling a frame
    }

    ArvFakeCamera* registers() { return arv_gv_fake_camera_get_fake_camera(camera); }
    void set(guint32 which, int value) {
        arv_fake_camera_write_register(registers(), which, static_cast<guint32>(value));
    }
    guint32 get(guint32 which) {
        guint32 value = 0;
        arv_fake_camera_read_register(registers(), which, &value);
        return value;
    }
    void set_wide(guint32 which, std::uint64_t value) {
        const guint64 big_endian = GUINT64_TO_BE(value);
        arv_fake_camera_write_memory(registers(), which, sizeof big_endian, &big_endian);
    }
    bool sends_chunks() { return sender && get(chunk_mode_register) != 0; }
    // Of the library's own packets.
    void set_loss(double part) { g_object_set(camera, "gvsp-lost-ratio", part, nullptr); }
    guint64 time_ns() { return nanoseconds_now() + static_cast<guint64>(clock_offset.count()); }

    void start() {
        const DescriptionFile description(gige_description(
            {options.formats, options.latches, options.chunk_payload_type != 0, options.ptp}));
        camera = arv_gv_fake_camera_new_full(address, options.serial.c_str(), description.path());
        if (!arv_gv_fake_camera_is_running(camera))
            throw DeviceError(device_name, "listen", "the fake camera did not start");
        set(ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, options.width);
        set(ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, options.height);
        set(ARV_FAKE_CAMERA_REGISTER_WIDTH, options.width);
        set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, options.height);
        set(ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT,
            options.bits <= 8 ? ARV_PIXEL_FORMAT_MONO_8 : ARV_PIXEL_FORMAT_MONO_16);
        // Ours is elsewhere; the fake camera's own stays at "by software", also for Line1.
        set(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOURCE, 1);
        arv_fake_camera_set_trigger_frequency(registers(), trigger_poll_hz);
        arv_fake_camera_set_fill_pattern(
            registers(),
            [](ArvBuffer* buffer, void* device, guint32 exposure_us, guint32 gain_db,
               ArvPixelFormat format) {
                static_cast<Device*>(device)->fill(buffer, exposure_us, gain_db, format);
            },
            this);
        if (options.chunk_payload_type != 0)
            sender.emplace();
        if (options.latches)
            latch = std::thread([this] { answer_latches(); });
    }

    // The fake camera has no hook for commands, so the latch is looked at often. A client that
    // waits for the answer sees a clock that was read some milliseconds after it asked.
    void answer_latches() {
        std::unique_lock lock(mutex);
        while (!changed.wait_for(lock, std::chrono::milliseconds(2), [this] { return ending; })) {
            if (get(latch_register) == 0)
                continue;
            set(latch_register, 0);
            set_wide(latched_time_register, time_ns());
        }
    }

    // On the camera's thread, once for each frame. Returns the part of its packets that are
    // dropped.
    double go_through_faults(bool chunks) {
        std::unique_lock lock(mutex);
        changed.wait(lock, [this] { return !frozen || ending; });
        if (short_frames > 0 && --short_frames == 0)
            set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, options.height);
        const double loss = lossy_frames > 0 ? lossy_part : options.packet_loss;
        lossy_frames = std::max(0, lossy_frames - 1);
        if (!ending)  // the library's object is no longer whole then
            set_loss(chunks ? 1.0 : loss);
        return loss;
    }

    CaptureSettings settings(const cv::Rect& region, const PixelFormat& format, guint32 exposure_us,
                             guint32 gain_db) {
        return {.width = region.width,
                .height = region.height,
                .bits = format.bits,
                .format = std::string(format.pfnc),
                .exposure = std::chrono::microseconds(exposure_us),
                .gain_db = static_cast<double>(gain_db),
                .black_level = get(black_level_register)};
    }

    void fill(ArvBuffer* buffer, guint32 exposure_us, guint32 gain_db, ArvPixelFormat code) {
        const bool chunks = sends_chunks();
        const double loss = go_through_faults(chunks);
        const guint64 now = stamp(buffer);
        const cv::Rect region = region_of(buffer);
        const PixelFormat* format = find_pfnc_format(code);
        std::size_t unknown_size = 0;  // reads 0 here; the payload is what the region needs
        void* data = const_cast<void*>(arv_buffer_get_data(buffer, &unknown_size));
        if (format == nullptr || data == nullptr || region.empty())
            return;
        cv::Mat codes(region.height, region.width, format->bits <= 8 ? CV_8UC1 : CV_16UC1);
        copy_region(source(settings(region, *format, exposure_us, gain_db)).pixels, region, codes);
        if (chunks)
            send_chunked(
                codes, *format,
                {options.chunk_payload_type, now, static_cast<std::uint32_t>(code), region},
                {double(exposure_us), double(gain_db), now, ++exposures}, loss);
        else
            pack(codes, *format, static_cast<std::uint8_t*>(data));
    }

    guint64 stamp(ArvBuffer* buffer) {
        const std::lock_guard lock(mutex);
        const guint64 now = time_ns();
        arv_buffer_set_timestamp(buffer, now);
        return now;
    }

    // The image and those chunks that the client chose.
    std::vector<std::uint8_t> chunked(std::span<const std::uint8_t> image, GigeChunkValues values) {
        const std::lock_guard lock(mutex);
        if (alter_values)
            alter_values(values);
        std::vector<std::uint8_t> payload;
        append_chunk(payload, image_chunk_id, image);
        const auto append = [&](const MockChunk& chunk, std::uint64_t value, std::endian order) {
            const auto bytes = bytes_of(value, order);
            if (get(chunk_enable_registers + 4 * chunk.selected) != 0)
                append_chunk(payload, chunk.id, std::span(bytes).first(chunk.bytes));
        };
        append(exposure_chunk, std::bit_cast<std::uint64_t>(values.exposure_us),
               std::endian::little);
        append(gain_chunk, static_cast<std::uint64_t>(std::llround(10.0 * values.gain_db)),
               std::endian::little);
        append(timestamp_chunk, values.timestamp_ns, std::endian::big);
        append(frame_id_chunk, values.frame_id, std::endian::big);
        if (alter_payload)
            alter_payload(payload);
        return payload;
    }

    void send_chunked(const cv::Mat& codes, const PixelFormat& format, const GvspLeader& leader,
                      const GigeChunkValues& values, double loss) {
        std::vector<std::uint8_t> image(image_bytes(format, codes.cols, codes.rows, 0));
        pack(codes, format, image.data());
        const GvspChannel channel{get(stream_address_register),
                                  static_cast<std::uint16_t>(get(stream_port_register)),
                                  static_cast<std::uint16_t>(get(stream_packet_size_register))};
        sender->send(channel, leader, chunked(image, values), loss);
    }
};

GigeCamera::GigeCamera(const GigeCameraOptions& options, Source source)
    : device_(std::make_unique<Device>(options, std::move(source))) {
    require_usable(options);
    require_free_port();
    device_->start();
}

GigeCamera::~GigeCamera() = default;

void GigeCamera::pulse_line() {
    device_->set(ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE, 1);
}

void GigeCamera::change_size_unasked(int width, int height) {
    device_->set(ARV_FAKE_CAMERA_REGISTER_WIDTH, width);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, height);
}

void GigeCamera::lose_packets(double part, int frames) {
    const std::lock_guard lock(device_->mutex);
    device_->lossy_part = part;
    device_->lossy_frames = frames;
}

void GigeCamera::cut_short(int frames) {
    const std::lock_guard lock(device_->mutex);
    device_->set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, device_->options.height - 1);
    device_->short_frames = frames;
}

void GigeCamera::freeze() {
    const std::lock_guard lock(device_->mutex);
    device_->frozen = true;
}

void GigeCamera::thaw() {
    {
        const std::lock_guard lock(device_->mutex);
        device_->frozen = false;
    }
    device_->changed.notify_all();
}

void GigeCamera::jump_clock(std::chrono::nanoseconds by) {
    const std::lock_guard lock(device_->mutex);
    device_->clock_offset += by;
}

void GigeCamera::alter_chunk_values(std::function<void(GigeChunkValues&)> alter) {
    const std::lock_guard lock(device_->mutex);
    device_->alter_values = std::move(alter);
}

void GigeCamera::alter_payload(std::function<void(std::vector<std::uint8_t>&)> alter) {
    const std::lock_guard lock(device_->mutex);
    device_->alter_payload = std::move(alter);
}

void GigeCamera::set_ptp(const std::string& status, std::chrono::nanoseconds offset) {
    for (const PtpStatusCode& code : ptp_status_codes)
        if (code.name == status)
            device_->set(ptp_status_register, static_cast<int>(code.value));
    device_->set_wide(ptp_offset_register, static_cast<std::uint64_t>(offset.count()));
}

}  // namespace etalon
