// A sensor of temperature and humidity on Modbus TCP (127.0.0.1), for the twin and tests. Input
// register 0: 0.01 degrees C (int16); 1: 0.1 %. It answers to every unit, only to function 4.
#pragma once

#include <atomic>

#include "mocks/stage/modbus_server.h"

namespace etalon {

// A room whose temperature goes up and down as its air conditioning does.
struct SimulatedRoom {
    double temperature_c = 20.0, swing_k = 0.0, period_s = 60.0;  // mean, amplitude of a sine
    double humidity_percent = 45.0;
};

class RoomSensorServer final : public ModbusUnits {
public:
    // The clock, from now on, is the room's time and must outlive the server. Throws as
    // ModbusServer.
    RoomSensorServer(const SimulatedRoom& room, const Clock& clock, int port = 0)
        : room_(room), clock_(clock), start_(clock.now()), server_(*this, port) {}

    int port() const { return server_.port(); }

    // From now on it hears requests and says nothing. Safe from every thread.
    void fall_silent() { is_silent_ = true; }

    bool has_unit(int) const override { return true; }
    ModbusAnswer handle(const ModbusRequest& request) override {
        constexpr int read_input_registers = 4;
        const double seconds = std::chrono::duration<double>(clock_.now() - start_).count();
        const double temperature =
            room_.temperature_c +
            room_.swing_k * std::sin(2.0 * std::numbers::pi * seconds / room_.period_s);
        ModbusAnswer answer;
        answer.reaction.reply = !is_silent_;
        const int end = request.address + request.count;
        if (request.function != read_input_registers)
            answer.exception = illegal_function;
        else if (request.address < 0 || end > 2)
            answer.exception = illegal_address;
        else
            for (int address = request.address; address < end; ++address) {
                const double number =
                    address == 0 ? 100.0 * temperature : 10.0 * room_.humidity_percent;
                answer.values.push_back(
                    static_cast<std::uint16_t>(static_cast<std::int16_t>(std::lround(number))));
            }
        return answer;
    }

private:
    SimulatedRoom room_;
    const Clock& clock_;
    Instant start_;
    std::atomic<bool> is_silent_ = false;
    ModbusServer server_;  // last: its thread uses the others
};

}  // namespace etalon
