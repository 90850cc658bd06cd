// How the USB camera answers its control endpoint: the standard requests (USB 2.0, 9.4), its
// controls, and the negotiation of a stream (UVC 1.1, 4.3.1.1). No sockets, no threads, no
// pictures.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace etalon::usb {

// What a USB Video Class camera says about itself: one camera, one processing unit, one stream of
// uncompressed pictures over a bulk endpoint.
// Sources: USB 2.0, chapter 9; USB Device Class Definition for Video Devices 1.1, chapter 3.

enum class UsbPixels { grey, y12, y16, yuyv };

constexpr int bytes_per_pixel(UsbPixels pixels) {
    return pixels == UsbPixels::grey ? 1 : 2;
}

struct UsbCameraOptions {
    std::vector<UsbPixels> formats{UsbPixels::yuyv, UsbPixels::grey, UsbPixels::y16,
                                   UsbPixels::y12};
    std::vector<cv::Size> sizes{{640, 480}, {320, 200}};  // px, each format has all of them
    int frames_per_second = 30;
    std::string serial = "USB7";
    int sharpness = 3;  // after power-up, 0..7; 0 is neutral
};

// Entities of the camera's control interface, and where things are.
constexpr int control_interface = 0, stream_interface = 1;
constexpr int camera_terminal = 1, processing_unit = 2, output_terminal = 3;
constexpr int stream_endpoint = 1;  // to the host
constexpr const char* usb_camera_vendor = "Etalon";
constexpr const char* usb_camera_model = "Test camera";

using Bytes = std::vector<std::uint8_t>;

// Descriptor types and subtypes (USB 2.0 table 9-5; UVC 1.1 tables ).
constexpr int device = 1, configuration = 2, string = 3, interface = 4, endpoint = 5,
              interface_association = 0x0B;
constexpr int class_interface = 0x24;
constexpr int control_header = 1, input_terminal = 2, output_terminal_type = 3,
              processing_unit_type = 5;
constexpr int input_header = 1, format_uncompressed = 4, frame_uncompressed = 5;
constexpr int video_class = 0x0E, video_control = 1, video_streaming = 2, video_collection = 3;
constexpr int bulk = 2, packet_size = 512;
constexpr int vendor_string = 1, model_string = 2, serial_string = 3;

// Pixel formats are named by a GUID: a four-character code and the same tail for all.
constexpr std::array<std::string_view, 4> four_characters{"Y800", "Y12 ", "Y16 ", "YUY2"};
constexpr std::array<std::uint8_t, 12> guid_tail{0x00, 0x00, 0x10, 0x00, 0x80, 0x00,
                                                 0x00, 0xAA, 0x00, 0x38, 0x9B, 0x71};

// Appends the lowest `bytes` bytes of a number, little-endian.
inline void put(Bytes& out, int bytes, std::uint32_t value) {
    for (int i = 0; i < bytes; ++i)
        out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

// ---- controls

// Requests (UVC 1.1, table A-8).
constexpr int get_current = 0x81, get_minimum = 0x82, get_maximum = 0x83, get_step = 0x84,
              get_length = 0x85, get_info = 0x86, get_default = 0x87;
constexpr std::uint8_t can_get = 1, can_set = 2, disabled_by_automatic = 4;
constexpr std::int32_t manual = 1, aperture_priority = 8;  // of the exposure mode, a bit each

struct Control {
    int entity, selector;
    int bit;   // in the entity's descriptor
    int size;  // bytes
    std::int32_t minimum, maximum, step, initial;
};

enum Index : std::size_t {  // of the table
    mode_index,
    exposure_index,
    gain_index,
    sharpness_index
};

// Exposure in 100 us, gain in 0.1 dB. The mode's "step" is the set of its possible values.
constexpr std::array<Control, 8> table{{
    {camera_terminal, 0x02, 1, 1, manual, aperture_priority, manual | aperture_priority,
     aperture_priority},                             // exposure mode
    {camera_terminal, 0x04, 3, 4, 1, 5000, 1, 157},  // exposure time
    {processing_unit, 0x04, 9, 2, 0, 240, 1, 30},    // gain
    {processing_unit, 0x08, 4, 2, 0, 7, 1, 3},       // sharpness
    {processing_unit, 0x03, 1, 2, 0, 100, 1, 50},    // contrast
    {processing_unit, 0x02, 0, 2, -64, 64, 1, 0},    // brightness
    {processing_unit, 0x05, 10, 1, 0, 2, 1, 1},      // against lamps' flicker: 0 is off
    {processing_unit, 0x01, 8, 2, 0, 2, 1, 1},       // backlight compensation: 0 is off
}};

inline std::optional<std::size_t> find(int entity, int selector) {
    for (std::size_t i = 0; i < table.size(); ++i)
        if (table[i].entity == entity && table[i].selector == selector)
            return i;
    return std::nullopt;
}

inline Bytes encoded(std::int32_t value, int size) {
    Bytes out;
    put(out, size, static_cast<std::uint32_t>(value));
    return out;
}

inline std::int32_t decoded(std::span<const std::uint8_t> bytes, bool with_sign) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
        value |= static_cast<std::uint32_t>(bytes[i]) << (8 * i);
    if (with_sign && bytes.size() == 2)
        return static_cast<std::int16_t>(value);
    return static_cast<std::int32_t>(value);
}

// The adjustable values of the USB camera (UVC 1.1, 4.2): exposure, gain, and what a measuring
// client has to switch off. They start as a consumer's camera has them: everything automatic and
// sharpened. Whoever wants to set the exposure has to end the automatic first, as with real ones.
class UsbVideoControls {
public:
    explicit UsbVideoControls(int sharpness) {
        for (const Control& control : table)
            values_.push_back(control.initial);
        values_[sharpness_index] = sharpness;
    }

    // The answer to GET_xxx `request` of the selector of an entity; nothing: unknown, refused.
    std::optional<Bytes> get(int entity, int selector, int request) const {
        const auto index = find(entity, selector);
        if (!index)
            return std::nullopt;
        const Control& control = table[*index];
        const bool disabled = *index == exposure_index && automatic_exposure();
        if (request == get_length)
            return encoded(control.size, 2);
        if (request == get_info)
            return encoded(can_get | can_set | (disabled ? disabled_by_automatic : 0), 1);
        const std::map<int, std::int32_t> values{{get_current, values_[*index]},
                                                 {get_minimum, control.minimum},
                                                 {get_maximum, control.maximum},
                                                 {get_step, control.step},
                                                 {get_default, control.initial}};
        const auto value = values.find(request);
        return value == values.end() ? std::nullopt
                                     : std::optional(encoded(value->second, control.size));
    }

    // SET_CUR; false: unknown, out of range or refused.
    bool set(int entity, int selector, std::span<const std::uint8_t> bytes) {
        const auto index = find(entity, selector);
        if (!index || bytes.size() != static_cast<std::size_t>(table[*index].size))
            return false;
        const Control& control = table[*index];
        const std::int32_t value = decoded(bytes, control.minimum < 0);
        if (value < control.minimum || value > control.maximum)
            return false;
        if (*index == mode_index && value != manual && value != aperture_priority)
            return false;
        if (*index == exposure_index && automatic_exposure())
            return false;
        values_[*index] = value;
        return true;
    }

    std::chrono::microseconds exposure() const {
        return std::chrono::microseconds(100 * values_[exposure_index]);
    }
    bool automatic_exposure() const { return values_[mode_index] != manual; }
    double gain_db() const { return 0.1 * values_[gain_index]; }
    int sharpness() const { return values_[sharpness_index]; }  // 0 is neutral

private:
    std::vector<std::int32_t> values_;  // in the order of the table
};

// The entity's bits of supported controls, as its descriptor has them.
inline std::uint32_t control_bits(int entity) {
    std::uint32_t bits = 0;
    for (const Control& control : table)
        if (control.entity == entity)
            bits |= 1u << control.bit;
    return bits;
}

// ---- descriptors

// The time from one frame to the next in the class' unit of 100 ns.
inline std::uint32_t frame_interval(const UsbCameraOptions& options) {
    return 10'000'000u / static_cast<std::uint32_t>(options.frames_per_second);
}

inline void append(Bytes& out, const Bytes& more) {
    out.insert(out.end(), more.begin(), more.end());
}

// A number in so many bytes.
struct Field {
    int bytes;
    std::uint32_t value;
};
constexpr Field u8(auto value) {
    return {1, static_cast<std::uint32_t>(value)};
}
constexpr Field u16(auto value) {
    return {2, static_cast<std::uint32_t>(value)};
}
constexpr Field u32(auto value) {
    return {4, static_cast<std::uint32_t>(value)};
}

// Every descriptor begins with its own length and its type.
inline Bytes described(int type, std::initializer_list<Field> fields) {
    Bytes out{0, static_cast<std::uint8_t>(type)};
    for (const auto& [bytes, value] : fields)
        put(out, bytes, value);
    out[0] = static_cast<std::uint8_t>(out.size());
    return out;
}

inline Bytes interface_descriptor(int number, int endpoints, int subclass) {
    return described(interface, {u8(number), u8(0 /*alternate setting*/), u8(endpoints),
                                 u8(video_class), u8(subclass), u8(0), u8(model_string)});
}

inline Bytes units() {
    Bytes out = described(
        class_interface,
        {u8(input_terminal), u8(camera_terminal), u16(0x0201 /*a camera sensor*/), u8(0), u8(0),
         u16(0), u16(0), u16(0 /*no zoom*/), u8(3), Field{3, control_bits(camera_terminal)}});
    append(out, described(class_interface,
                          {u8(processing_unit_type), u8(processing_unit), u8(camera_terminal),
                           u16(0), u8(2), u16(control_bits(processing_unit)), u8(0), u8(0)}));
    append(out, described(class_interface,
                          {u8(output_terminal_type), u8(output_terminal),
                           u16(0x0101 /*to the host*/), u8(0), u8(processing_unit), u8(0)}));
    return out;
}

inline Bytes control_part() {
    constexpr std::uint32_t header_length = 13;
    const Bytes entities = units();
    Bytes out = interface_descriptor(control_interface, 0, video_control);
    append(out, described(class_interface, {u8(control_header), u16(0x0110 /*UVC 1.1*/),
                                            u16(header_length + entities.size()), u32(48'000'000),
                                            u8(1), u8(stream_interface)}));
    append(out, entities);
    return out;
}

inline Bytes format_descriptor(UsbPixels pixels, std::size_t index, std::size_t frames) {
    Bytes out = described(class_interface, {u8(format_uncompressed), u8(index), u8(frames)});
    const std::string_view code = four_characters[static_cast<std::size_t>(pixels)];
    out.insert(out.end(), code.begin(), code.end());
    out.insert(out.end(), guid_tail.begin(), guid_tail.end());
    put(out, 1, static_cast<std::uint32_t>(8 * bytes_per_pixel(pixels)));
    put(out, 1, 1);  // the default size
    put(out, 4, 0);  // no aspect ratio, not interlaced, no copy protection
    out[0] = static_cast<std::uint8_t>(out.size());
    return out;
}

inline Bytes frame_descriptor(UsbPixels pixels, cv::Size size, std::size_t index,
                              const UsbCameraOptions& options) {
    const auto bytes = static_cast<std::uint32_t>(size.area() * bytes_per_pixel(pixels));
    const auto rate = 8 * bytes * static_cast<std::uint32_t>(options.frames_per_second);
    return described(class_interface,
                     {u8(frame_uncompressed), u8(index), u8(0), u16(size.width), u16(size.height),
                      u32(rate), u32(rate), u32(bytes), u32(frame_interval(options)),
                      u8(1 /*one interval follows*/), u32(frame_interval(options))});
}

inline Bytes formats(const UsbCameraOptions& options) {
    Bytes out;
    for (std::size_t f = 0; f < options.formats.size(); ++f) {
        append(out, format_descriptor(options.formats[f], f + 1, options.sizes.size()));
        for (std::size_t s = 0; s < options.sizes.size(); ++s)
            append(out, frame_descriptor(options.formats[f], options.sizes[s], s + 1, options));
    }
    return out;
}

inline Bytes stream_part(const UsbCameraOptions& options) {
    const auto count = static_cast<std::uint32_t>(options.formats.size());
    const Bytes all_formats = formats(options);
    const std::uint32_t header_length = 13 + count;
    Bytes header = described(
        class_interface,
        {u8(input_header), u8(count), u16(header_length + all_formats.size()),
         u8(0x80 | stream_endpoint), u8(0), u8(output_terminal), u8(0), u8(0), u8(0), u8(1)});
    header.resize(header_length);  // no controls of the formats
    header[0] = static_cast<std::uint8_t>(header_length);

    Bytes out = interface_descriptor(stream_interface, 1, video_streaming);
    append(out, header);
    append(out, all_formats);
    append(out,
           described(endpoint, {u8(0x80 | stream_endpoint), u8(bulk), u16(packet_size), u8(0)}));
    return out;
}

inline Bytes device_descriptor() {
    return described(
        device,
        {u16(0x0200 /*USB 2.0*/), u8(0xEF /*the class is in the interface association*/), u8(2),
         u8(1), u8(64 /*bytes in a packet of endpoint 0*/),
         u16(0x1D6B /*Linux Foundation: gadgets without a vendor*/), u16(0x0102 /*webcam gadget*/),
         u16(0x0100), u8(vendor_string), u8(model_string), u8(serial_string), u8(1)});
}

// 0 is the list of languages; nothing for an index that no descriptor names.
inline Bytes string_descriptor(const UsbCameraOptions& options, int index) {
    if (index == 0)
        return described(string, {u16(0x0409 /*English*/)});
    const std::string text = index == vendor_string   ? usb_camera_vendor
                             : index == model_string  ? usb_camera_model
                             : index == serial_string ? options.serial
                                                      : "";
    if (text.empty())
        return {};
    Bytes out = described(string, {});
    for (const char letter : text)
        put(out, 2, static_cast<std::uint8_t>(letter));
    out[0] = static_cast<std::uint8_t>(out.size());
    return out;
}

inline std::vector<std::uint8_t> configuration_descriptor(const UsbCameraOptions& options) {
    constexpr int header_length = 9;
    Bytes parts = described(interface_association, {u8(control_interface), u8(2), u8(video_class),
                                                    u8(video_collection), u8(0), u8(model_string)});
    append(parts, control_part());
    append(parts, stream_part(options));
    Bytes out =
        described(configuration, {u16(header_length + parts.size()), u8(2 /*interfaces*/), u8(1),
                                  u8(0), u8(0x80 /*powered by the bus*/), u8(50 /*100 mA*/)});
    append(out, parts);
    return out;
}

// ---- requests

// bmRequestType: direction, kind, recipient.
constexpr int to_host = 0x80, kind_mask = 0x60, standard = 0x00, of_class = 0x20;
constexpr int to_interface = 0x01, to_endpoint = 0x02, recipient_mask = 0x1F;
// Standard requests.
constexpr int get_status = 0, clear_feature = 1, set_feature = 3, get_descriptor = 6,
              set_configuration = 9, set_interface = 11;
// Class requests and the selectors of the stream's interface.
constexpr int set_current = 0x01;
constexpr int probe = 1, commit = 2;
constexpr std::int32_t negotiation_bytes = 34;  // UVC 1.1

// A payload is one whole frame behind a header of 2 bytes.
constexpr std::uint32_t payload_header = 2;

inline std::size_t clamped_index(int index, std::size_t count) {
    return index >= 1 && static_cast<std::size_t>(index) <= count ? static_cast<std::size_t>(index)
                                                                  : 1;
}

// The first 8 bytes of a control transfer (USB 2.0, 9.3).
struct UsbSetup {
    int type = 0, request = 0;
    int value = 0, index = 0, length = 0;
};

struct StreamMode {
    UsbPixels pixels = UsbPixels::grey;
    cv::Size size;

    std::size_t frame_bytes() const {
        return static_cast<std::size_t>(size.area() * bytes_per_pixel(pixels));
    }
};

class UsbVideoDevice {
public:
    explicit UsbVideoDevice(UsbCameraOptions options)
        : options_(std::move(options)), controls_(options_.sharpness) {}

    // The answer to a request to the device or to the host; nothing: refused.
    std::optional<Bytes> read(const UsbSetup& setup) const {
        std::optional<Bytes> answer;
        if ((setup.type & kind_mask) == standard)
            answer = read_standard(setup);
        else if (setup.type == (to_host | of_class | to_interface))
            answer = (setup.index & 0xFF) == stream_interface
                         ? read_negotiation(setup)
                         : controls_.get(setup.index >> 8, setup.value >> 8, setup.request);
        if (answer && answer->size() > static_cast<std::size_t>(setup.length))
            answer->resize(static_cast<std::size_t>(setup.length));
        return answer;
    }

    // Whether a request from the host was carried out.
    bool write(const UsbSetup& setup, std::span<const std::uint8_t> data) {
        if ((setup.type & kind_mask) == standard) {
            // The host stops a bulk stream by clearing its endpoint.
            if (setup.request == clear_feature && (setup.type & recipient_mask) == to_endpoint)
                streaming_ = false;
            configured_ = configured_ || setup.request == set_configuration;
            return setup.request == clear_feature || setup.request == set_feature ||
                   setup.request == set_configuration || setup.request == set_interface;
        }
        if (setup.type != (of_class | to_interface) || setup.request != set_current)
            return false;
        if ((setup.index & 0xFF) == stream_interface)
            return write_negotiation(setup.value >> 8, data);
        return controls_.set(setup.index >> 8, setup.value >> 8, data);
    }

    const UsbVideoControls& controls() const { return controls_; }

    // Whether the host has accepted the device.
    bool configured() const { return configured_; }

    // The mode in which the host wants pictures now, if it does; and how many times it has begun.
    std::optional<StreamMode> stream() const {
        return streaming_ ? std::optional(mode()) : std::nullopt;
    }
    int streams_begun() const { return streams_begun_; }

private:
    std::optional<Bytes> read_standard(const UsbSetup& setup) const {
        if (setup.request == get_status)
            return Bytes(2, 0);
        if (setup.request != get_descriptor)
            return std::nullopt;
        const int type = setup.value >> 8;
        const Bytes descriptor = type == device          ? device_descriptor()
                                 : type == configuration ? configuration_descriptor(options_)
                                 : type == string ? string_descriptor(options_, setup.value & 0xFF)
                                                  : Bytes();
        return descriptor.empty() ? std::nullopt : std::optional(descriptor);
    }

    std::optional<Bytes> read_negotiation(const UsbSetup& setup) const {
        const int selector = setup.value >> 8;
        if (selector != probe && selector != commit)
            return std::nullopt;
        Bytes out;
        if (setup.request == get_length)
            return encoded(negotiation_bytes, 2);
        if (setup.request == get_info)
            return encoded(can_get | can_set, 1);
        const auto frame = static_cast<std::uint32_t>(mode().frame_bytes());
        put(out, 2, 0);
        put(out, 1, static_cast<std::uint32_t>(format_index_));
        put(out, 1, static_cast<std::uint32_t>(size_index_));
        put(out, 4, frame_interval(options_));
        out.resize(18, 0);
        put(out, 4, frame);
        put(out, 4, frame + payload_header);
        out.resize(negotiation_bytes, 0);
        return out;
    }

    // A wish that cannot be fulfilled becomes one that can, which the host reads back.
    bool write_negotiation(int selector, std::span<const std::uint8_t> data) {
        if ((selector != probe && selector != commit) || data.size() < 4)
            return false;
        format_index_ = clamped_index(data[2], options_.formats.size());
        size_index_ = clamped_index(data[3], options_.sizes.size());
        streaming_ = selector == commit;
        streams_begun_ += streaming_;
        return true;
    }

    StreamMode mode() const {
        return {options_.formats[format_index_ - 1], options_.sizes[size_index_ - 1]};
    }

    UsbCameraOptions options_;
    UsbVideoControls controls_;
    std::size_t format_index_ = 1, size_index_ = 1;  // as negotiated, from 1
    bool configured_ = false;
    bool streaming_ = false;
    int streams_begun_ = 0;
};

}  // namespace etalon::usb

namespace etalon {
using usb::UsbPixels, usb::UsbCameraOptions, usb::UsbSetup, usb::StreamMode, usb::UsbVideoControls,
    usb::UsbVideoDevice;
}  // namespace etalon
