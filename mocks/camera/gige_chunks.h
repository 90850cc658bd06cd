// What Aravis' fake camera cannot do: frames with chunks, built and sent by hand. The layout of the
// packets and of the payload is what Wireshark's GVSP dissector and the manuals of cameras with
// chunk mode say of GigE Vision; all numbers are big-endian.
#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

namespace etalon {

// Payload types of a frame with chunks.
inline constexpr std::uint16_t image_with_chunks = 0x4001;       // GigE Vision 2
inline constexpr std::uint16_t chunks_only = 0x0004;             // its leader describes no image
inline constexpr std::uint16_t extended_chunk_payload = 0x0005;  // until GigE Vision 1.2

// Appends `data` as a chunk: followed by its id and its length.
void append_chunk(std::vector<std::uint8_t>& payload, std::uint32_t id,
                  std::span<const std::uint8_t> data);

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

class GvspSender {
public:
    GvspSender();  // throws DeviceError
    ~GvspSender();
    GvspSender(const GvspSender&) = delete;
    GvspSender& operator=(const GvspSender&) = delete;

    // One frame: leader, payload, trailer. Each packet is dropped with the chance `loss`. What the
    // network does not take is lost, as on a wire.
    void send(const GvspChannel& channel, const GvspLeader& leader,
              std::span<const std::uint8_t> payload, double loss);

private:
    void send_packet(std::uint8_t format, std::span<const std::uint8_t> content);

    int socket_;
    sockaddr_in to_{};
    double loss_ = 0.0;
    std::uint16_t block_ = 65530;  // soon wraps, from 65535 to 1
    std::uint32_t packet_ = 0;
    cv::RNG random_{75};
};

}  // namespace etalon
