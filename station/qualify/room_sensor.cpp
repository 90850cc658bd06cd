#include "station/qualify/room_sensor.h"

#include <fmt/format.h>

#include <memory>

#include "stage/link/modbus_link.h"

namespace etalon {
namespace {

double read_quantity(ModbusLink& link, const RoomSensor& sensor, const SensorRegister& place) {
    const std::string device = "room sensor " + describe(sensor.link);
    const std::string request = fmt::format("read register {}", place.address);
    try {
        const auto registers =
            link.read(sensor.link.unit, place.space, place.address, registers_of(place.type));
        const double value =
            place.scale * number_from_registers(registers, place.type, place.order) + place.offset;
        if (!place.possible.contains(value))
            throw DeviceError(device, request,
                              fmt::format("{} is not {}", value, place.possible.words()));
        return value;
    } catch (const DeviceError& error) {
        throw DeviceError(device, request, error.cause());
    }
}

}  // namespace

std::function<ClimateReading()> room_sensor(const RoomSensor& sensor, Clock& clock) {
    const auto link = std::make_shared<ModbusLink>(sensor.link, clock);
    return [sensor, link] {
        ClimateReading reading;
        reading.temperature_c = read_quantity(*link, sensor, sensor.temperature_c);
        if (sensor.humidity_percent)
            reading.humidity_percent = read_quantity(*link, sensor, *sensor.humidity_percent);
        return reading;
    };
}

}  // namespace etalon
