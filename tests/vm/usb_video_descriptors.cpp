#include "tests/vm/usb_video_descriptors.h"

#include <array>
#include <string_view>

#include "tests/vm/usb_video_controls.h"

namespace etalon {
namespace {

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
std::string_view four_characters(UsbPixels pixels) {
    switch (pixels) {
        case UsbPixels::grey:
            return "Y800";
        case UsbPixels::y12:
            return "Y12 ";
        case UsbPixels::y16:
            return "Y16 ";
        case UsbPixels::yuyv:
            return "YUY2";
    }
    return {};
}
constexpr std::array<std::uint8_t, 12> guid_tail{0x00, 0x00, 0x10, 0x00, 0x80, 0x00,
                                                 0x00, 0xAA, 0x00, 0x38, 0x9B, 0x71};

void append(Bytes& out, const Bytes& more) {
    out.insert(out.end(), more.begin(), more.end());
}

// Every descriptor begins with its own length and its type.
Bytes described(int type, std::initializer_list<std::pair<int, std::uint32_t>> fields) {
    Bytes out{0, static_cast<std::uint8_t>(type)};
    for (const auto& [bytes, value] : fields)
        put(out, bytes, value);
    out[0] = static_cast<std::uint8_t>(out.size());
    return out;
}

Bytes interface_descriptor(int number, int endpoints, int subclass) {
    return described(interface, {{1, number},
                                 {1, 0},  // alternate setting
                                 {1, endpoints},
                                 {1, video_class},
                                 {1, subclass},
                                 {1, 0},
                                 {1, model_string}});
}

Bytes units() {
    Bytes out = described(class_interface, {{1, input_terminal},
                                            {1, camera_terminal},
                                            {2, 0x0201},  // a camera sensor
                                            {1, 0},
                                            {1, 0},
                                            {2, 0},
                                            {2, 0},
                                            {2, 0},  // no zoom
                                            {1, 3},
                                            {3, control_bits(camera_terminal)}});
    append(out, described(class_interface, {{1, processing_unit_type},
                                            {1, processing_unit},
                                            {1, camera_terminal},
                                            {2, 0},
                                            {1, 2},
                                            {2, control_bits(processing_unit)},
                                            {1, 0},
                                            {1, 0}}));
    append(out, described(class_interface, {{1, output_terminal_type},
                                            {1, output_terminal},
                                            {2, 0x0101},  // to the host
                                            {1, 0},
                                            {1, processing_unit},
                                            {1, 0}}));
    return out;
}

Bytes control_part() {
    constexpr std::uint32_t header_length = 13;
    const Bytes entities = units();
    Bytes out = interface_descriptor(control_interface, 0, video_control);
    append(out, described(class_interface,
                          {{1, control_header},
                           {2, 0x0110},  // UVC 1.1
                           {2, header_length + static_cast<std::uint32_t>(entities.size())},
                           {4, 48'000'000},
                           {1, 1},
                           {1, stream_interface}}));
    append(out, entities);
    return out;
}

Bytes format_descriptor(UsbPixels pixels, std::size_t index, std::size_t frames) {
    Bytes out = described(class_interface, {{1, format_uncompressed},
                                            {1, static_cast<std::uint32_t>(index)},
                                            {1, static_cast<std::uint32_t>(frames)}});
    const std::string_view code = four_characters(pixels);
    out.insert(out.end(), code.begin(), code.end());
    out.insert(out.end(), guid_tail.begin(), guid_tail.end());
    put(out, 1, static_cast<std::uint32_t>(8 * bytes_per_pixel(pixels)));
    put(out, 1, 1);  // the default size
    put(out, 4, 0);  // no aspect ratio, not interlaced, no copy protection
    out[0] = static_cast<std::uint8_t>(out.size());
    return out;
}

Bytes frame_descriptor(UsbPixels pixels, cv::Size size, std::size_t index,
                       const UsbCameraOptions& options) {
    const auto bytes = static_cast<std::uint32_t>(size.area() * bytes_per_pixel(pixels));
    const auto rate = 8 * bytes * static_cast<std::uint32_t>(options.frames_per_second);
    return described(class_interface, {{1, frame_uncompressed},
                                       {1, static_cast<std::uint32_t>(index)},
                                       {1, 0},
                                       {2, static_cast<std::uint32_t>(size.width)},
                                       {2, static_cast<std::uint32_t>(size.height)},
                                       {4, rate},
                                       {4, rate},
                                       {4, bytes},
                                       {4, frame_interval(options)},
                                       {1, 1},  // one interval follows
                                       {4, frame_interval(options)}});
}

Bytes formats(const UsbCameraOptions& options) {
    Bytes out;
    for (std::size_t f = 0; f < options.formats.size(); ++f) {
        append(out, format_descriptor(options.formats[f], f + 1, options.sizes.size()));
        for (std::size_t s = 0; s < options.sizes.size(); ++s)
            append(out, frame_descriptor(options.formats[f], options.sizes[s], s + 1, options));
    }
    return out;
}

Bytes stream_part(const UsbCameraOptions& options) {
    const auto count = static_cast<std::uint32_t>(options.formats.size());
    const Bytes all_formats = formats(options);
    const std::uint32_t header_length = 13 + count;
    Bytes header = described(class_interface,
                             {{1, input_header},
                              {1, count},
                              {2, header_length + static_cast<std::uint32_t>(all_formats.size())},
                              {1, 0x80 | stream_endpoint},
                              {1, 0},
                              {1, output_terminal},
                              {1, 0},
                              {1, 0},
                              {1, 0},
                              {1, 1}});
    header.resize(header_length);  // no controls of the formats
    header[0] = static_cast<std::uint8_t>(header_length);

    Bytes out = interface_descriptor(stream_interface, 1, video_streaming);
    append(out, header);
    append(out, all_formats);
    append(out,
           described(endpoint, {{1, 0x80 | stream_endpoint}, {1, bulk}, {2, packet_size}, {1, 0}}));
    return out;
}

}  // namespace

void put(std::vector<std::uint8_t>& out, int bytes, std::uint32_t value) {
    for (int i = 0; i < bytes; ++i)
        out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::uint32_t frame_interval(const UsbCameraOptions& options) {
    return 10'000'000u / static_cast<std::uint32_t>(options.frames_per_second);
}

std::vector<std::uint8_t> device_descriptor() {
    return described(device, {{2, 0x0200},  // USB 2.0
                              {1, 0xEF},    // the class is in the interface association
                              {1, 2},
                              {1, 1},
                              {1, 64},      // bytes in a packet of endpoint 0
                              {2, 0x1D6B},  // Linux Foundation: gadgets without a vendor
                              {2, 0x0102},  // webcam gadget
                              {2, 0x0100},
                              {1, vendor_string},
                              {1, model_string},
                              {1, serial_string},
                              {1, 1}});
}

std::vector<std::uint8_t> configuration_descriptor(const UsbCameraOptions& options) {
    constexpr int header_length = 9;
    Bytes parts = described(interface_association, {{1, control_interface},
                                                    {1, 2},
                                                    {1, video_class},
                                                    {1, video_collection},
                                                    {1, 0},
                                                    {1, model_string}});
    append(parts, control_part());
    append(parts, stream_part(options));
    Bytes out =
        described(configuration, {{2, header_length + static_cast<std::uint32_t>(parts.size())},
                                  {1, 2},  // interfaces
                                  {1, 1},
                                  {1, 0},
                                  {1, 0x80},  // powered by the bus
                                  {1, 50}});  // 100 mA
    append(out, parts);
    return out;
}

std::vector<std::uint8_t> string_descriptor(const UsbCameraOptions& options, int index) {
    if (index == 0)
        return described(string, {{2, 0x0409}});  // English
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

}  // namespace etalon
