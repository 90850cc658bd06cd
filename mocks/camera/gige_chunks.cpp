#include "mocks/camera/gige_chunks.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::uint8_t leader_format = 1, trailer_format = 2, payload_format = 3;
constexpr std::size_t headers = 20 + 8 + 8;  // of IP, UDP and GVSP

using Bytes = std::vector<std::uint8_t>;

void append(Bytes& out, std::uint64_t value, int bytes) {
    for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8)
        out.push_back(static_cast<std::uint8_t>(value >> shift));
}

Bytes leader_content(const GvspLeader& leader) {
    Bytes content;
    append(content, 0, 2);
    append(content, leader.payload_type, 2);
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

Bytes trailer_content(const GvspLeader& leader) {
    Bytes content;
    append(content, 0, 2);
    append(content, leader.payload_type, 2);
    append(content, static_cast<std::uint32_t>(leader.region.height), 4);
    return content;
}

}  // namespace

void append_chunk(Bytes& payload, std::uint32_t id, std::span<const std::uint8_t> data) {
    payload.insert(payload.end(), data.begin(), data.end());
    append(payload, id, 4);
    append(payload, data.size(), 4);
}

GvspSender::GvspSender() : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    if (socket_ < 0)
        throw DeviceError("camera", "open a stream socket", std::strerror(errno));
}

GvspSender::~GvspSender() {
    close(socket_);
}

void GvspSender::send(const GvspChannel& channel, const GvspLeader& leader,
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
        send_packet(payload_format, payload.subspan(sent, std::min(room, payload.size() - sent)));
    send_packet(trailer_format, trailer_content(leader));
}

void GvspSender::send_packet(std::uint8_t format, std::span<const std::uint8_t> content) {
    Bytes packet;
    append(packet, 0, 2);  // success
    append(packet, block_, 2);
    append(packet, format, 1);
    append(packet, packet_++, 3);
    packet.insert(packet.end(), content.begin(), content.end());
    if (random_.uniform(0.0, 1.0) >= loss_)
        sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to_),
               sizeof to_);
}

}  // namespace etalon
