// Bytes that answer a request, on TCP and on a serial line, through libmodbus as it is used here.
// They lie ready before the request is sent, so nothing is waited for but a serial frame that is
// too short. Input: line, function and count, a byte each, then the answer.
#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "mocks/stage/serial_pair.h"
#include "stage/link/modbus_transport.h"
#include "stage/link/register_numbers.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

constexpr std::size_t head = 3;
constexpr std::chrono::milliseconds timeout(1);
constexpr std::chrono::seconds patience(60);   // with a machine that does other things

// A port of this machine that connections can be made to.
struct Listener {
    int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int port = 0;

    Listener() {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        const auto as_any = reinterpret_cast<sockaddr*>(&address);
        require(bind(socket, as_any, size) == 0 && listen(socket, 1) == 0 &&
                    getsockname(socket, as_any, &size) == 0,
                "no port of its own");
        port = ntohs(address.sin_port);
    }
};

ModbusRequest request_of(std::uint8_t function, std::uint8_t count) {
    constexpr std::array functions{1, 2, 3, 4, 5, 6, 15, 16};
    ModbusRequest request{1, functions[function % functions.size()], 3, 1 + count % 60, {}};
    if (request.function == 5 || request.function == 6)
        request.count = 1;
    if (request.function >= 5)
        request.values.assign(static_cast<std::size_t>(request.count), 1);
    return request;
}

void check(const ModbusRequest& request, const ModbusReply& reply) {
    if (reply.outcome != ModbusReply::Outcome::answered)
        return require(!reply.cause.empty() && reply.values.empty(), "a failure without a cause");
    const std::size_t wanted = request.values.empty() ? static_cast<std::size_t>(request.count) : 0;
    require(reply.values.size() == wanted, "an answer of another length");
    for (std::size_t i = 0; i + 1 < reply.values.size(); ++i)
        for (const NumberType type : {NumberType::int16, NumberType::uint16, NumberType::int32})
            require_finite(number_from_registers(std::span(reply.values).subspan(i, 2), type,
                                                 WordOrder::high_first));
}

void answer_on_tcp(const ModbusRequest& request, std::span<const std::uint8_t> answer) {
    static const Listener listener;
    StageLink link;
    link.address = TcpAddress{"127.0.0.1", listener.port};
    const auto transport = make_modbus_transport(link);
    require(transport->connect(patience).empty(), "no connection");
    const int controller = accept4(listener.socket, nullptr, nullptr, SOCK_CLOEXEC);
    require(send(controller, answer.data(), answer.size(), MSG_NOSIGNAL) ==
                static_cast<ssize_t>(answer.size()),
            "not sent");
    shutdown(controller, SHUT_WR);
    check(request, transport->exchange(request, timeout));
    transport->close();
    ::close(controller);
}

// As many writes as it takes: a pseudo-terminal may be full while the machine does other things.
void write_all(int line, std::span<const std::uint8_t> bytes) {
    while (!bytes.empty()) {
        pollfd ready{line, POLLOUT, 0};
        const int wait = static_cast<int>(std::chrono::milliseconds(patience).count());
        require(poll(&ready, 1, wait) > 0, "the line takes no bytes");
        const ssize_t written = write(line, bytes.data(), bytes.size());
        require(written >= 0 || errno == EAGAIN || errno == EINTR, "not written");
        bytes = bytes.subspan(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
    }
}

// One line for all inputs; it is read empty before each.
void answer_on_line(const ModbusRequest& request, std::span<const std::uint8_t> answer) {
    static const SerialPair line;
    static const auto transport = [] {
        StageLink link;
        link.address = SerialPort{.device = line.device(), .baud = 115200};
        auto made = make_modbus_transport(link);
        require(made->connect(patience).empty(), "no line");
        return made;
    }();
    std::array<std::uint8_t, 512> sent;
    while (::read(line.controller_end(), sent.data(), sent.size()) > 0) {
    }
    while (transport->discard(Duration::zero()) == ModbusTransport::Heard::something) {
    }
    write_all(line.controller_end(), answer);
    check(request, transport->exchange(request, timeout));
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    if (size <= head || size > 300)
        return 0;
    const auto request = request_of(data[1], data[2]);
    const std::span answer(data + head, size - head);
    (data[0] % 2 == 0 ? answer_on_tcp : answer_on_line)(request, answer);
    return 0;
}
