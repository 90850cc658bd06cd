#include "mocks/stage/room_sensor_server.h"

#include <cmath>
#include <numbers>

namespace etalon {

double SimulatedRoom::temperature_at(double seconds) const {
    return temperature_c + swing_k * std::sin(2.0 * std::numbers::pi * seconds / period_s);
}

ModbusAnswer RoomSensorServer::handle(const ModbusRequest& request) {
    constexpr int read_input_registers = 4;
    ModbusAnswer answer;
    answer.reaction.reply = !is_silent_;
    const int end = request.address + request.count;
    if (request.function != read_input_registers)
        answer.exception = illegal_function;
    else if (request.address < 0 || end > 2)
        answer.exception = illegal_address;
    else
        for (int address = request.address; address < end; ++address)
            answer.values.push_back(value_at(address));
    return answer;
}

std::uint16_t RoomSensorServer::value_at(int address) const {
    const double passed = std::chrono::duration<double>(clock_.now() - start_).count();
    const double number =
        address == 0 ? 100.0 * room_.temperature_at(passed) : 10.0 * room_.humidity_percent;
    return static_cast<std::uint16_t>(static_cast<std::int16_t>(std::lround(number)));
}

}  // namespace etalon
