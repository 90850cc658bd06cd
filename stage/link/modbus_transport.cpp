#include "stage/link/modbus_transport.h"

#include <fmt/format.h>
#include <modbus.h>
#include <poll.h>
#include <sys/file.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace etalon {
namespace {

// The device answered, but with a refusal; the connection is in order.
bool is_modbus_exception(int error) {
    return error >= EMBXILFUN && error <= EMBXGTAR;
}

modbus_t* make_context(const TcpAddress& address) {
    return modbus_new_tcp_pi(address.host.c_str(), std::to_string(address.port).c_str());
}

modbus_t* make_context(const SerialPort& port) {
    return modbus_new_rtu(port.device.c_str(), port.baud, port.parity, port.data_bits,
                          port.stop_bits);
}

// A second master on a serial line would take replies that are not its own.
bool takes_line_alone(modbus_t* context) {
    return flock(modbus_get_socket(context), LOCK_EX | LOCK_NB) == 0;
}

class LibmodbusTransport final : public ModbusTransport {
public:
    explicit LibmodbusTransport(const StageLink& link) : link_(link) {}
    ~LibmodbusTransport() override { close(); }
    LibmodbusTransport(const LibmodbusTransport&) = delete;
    LibmodbusTransport& operator=(const LibmodbusTransport&) = delete;

    // No error recovery flags: libmodbus' own reconnecting hangs for ever when the server is gone.
    // Byte time-out 0: the response time-out then bounds the whole reply, however it trickles in.
    std::string connect(std::chrono::milliseconds timeout) override {
        context_ =
            std::visit([](const auto& address) { return make_context(address); }, link_.address);
        const bool connected = context_ && set_timeout(timeout) &&
                               modbus_set_byte_timeout(context_, 0, 0) == 0 &&
                               modbus_connect(context_) == 0;
        std::string failure;
        if (!connected)
            failure = fmt::format("cannot connect: {}", modbus_strerror(errno));
        else if (link_.is_serial() && !takes_line_alone(context_))
            failure = "cannot connect: another program uses the line";
        if (!failure.empty())
            close();
        return failure;
    }

    // What a serial line has not sent yet must not go out later, and closing would wait for it.
    void close() noexcept override {
        if (!context_)
            return;
        if (link_.is_serial() && modbus_get_socket(context_) >= 0)
            tcflush(modbus_get_socket(context_), TCOFLUSH);
        modbus_close(context_);
        modbus_free(context_);
        context_ = nullptr;
    }

    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds timeout) override {
        ModbusReply reply;
        reply.values.resize(request.values.empty() ? static_cast<std::size_t>(request.count) : 0);
        const bool set = modbus_set_slave(context_, request.unit) == 0 && set_timeout(timeout);
        const int done = set ? call(request, reply.values) : -1;
        const int error = done < 0 ? errno : EMBBADDATA;
        if (done == request.count) {
            reply.outcome = ModbusReply::Outcome::answered;
            return reply;
        }
        reply.values.clear();
        if (is_modbus_exception(error)) {
            reply.outcome = ModbusReply::Outcome::refused;
            reply.exception = error - MODBUS_ENOBASE;
        }
        reply.cause = error == ETIMEDOUT ? fmt::format("no answer within {} ms", timeout.count())
                                         : modbus_strerror(error);
        return reply;
    }

    Heard discard(Duration wait) override {
        const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(wait);
        const timespec limit{seconds.count(), (wait - seconds) / std::chrono::nanoseconds(1)};
        pollfd line{modbus_get_socket(context_), POLLIN, 0};
        const int ready = ppoll(&line, 1, &limit, nullptr);
        if (ready <= 0)
            return ready == 0 ? Heard::nothing : Heard::hang_up;
        std::uint8_t bytes[512];
        return ::read(line.fd, bytes, sizeof bytes) > 0 ? Heard::something : Heard::hang_up;
    }

private:
    bool set_timeout(std::chrono::milliseconds timeout) {
        const auto microseconds = static_cast<std::uint32_t>(timeout.count() % 1000 * 1000);
        return modbus_set_response_timeout(
                   context_, static_cast<std::uint32_t>(timeout.count() / 1000), microseconds) == 0;
    }

    // The number of values read or written, or -1 and errno.
    int call(const ModbusRequest& request, std::vector<std::uint16_t>& values) {
        const int at = request.address, count = request.count;
        std::vector<std::uint8_t> bits(request.values.begin(), request.values.end());
        switch (request.function) {
            case 1:
            case 2: {
                bits.resize(values.size());
                const auto read = request.function == 1 ? modbus_read_bits : modbus_read_input_bits;
                const int got = read(context_, at, count, bits.data());
                std::ranges::copy(bits, values.begin());
                return got;
            }
            case 3:
                return modbus_read_registers(context_, at, count, values.data());
            case 4:
                return modbus_read_input_registers(context_, at, count, values.data());
            case 5:
                return modbus_write_bit(context_, at, bits.front());
            case 15:
                return modbus_write_bits(context_, at, count, bits.data());
            default:
                return modbus_write_registers(context_, at, count, request.values.data());
        }
    }

    StageLink link_;
    modbus_t* context_ = nullptr;  // null: not connected
};

}  // namespace

std::unique_ptr<ModbusTransport> make_modbus_transport(const StageLink& link) {
    return std::make_unique<LibmodbusTransport>(link);
}

}  // namespace etalon
