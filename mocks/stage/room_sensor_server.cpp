#include "mocks/stage/room_sensor_server.h"

#include <cmath>
#include <numbers>

namespace etalon {

ModbusAnswer RoomSensorServer::handle(const ModbusRequest& request) {
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

}  // namespace etalon
