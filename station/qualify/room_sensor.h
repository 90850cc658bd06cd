// The sensor of a station's room (station/setup/environment.h) as a device.
#pragma once

#include <functional>

#include "core/time/clock.h"
#include "station/setup/environment.h"

namespace etalon {

// Connects with the first reading, and reads as the stage is read (stage/link/modbus_link.h): each
// quantity up to three times. What a room cannot have is an error like no answer. The clock must
// outlive the function, which throws DeviceError. Throws ConfigError for a link that cannot be.
std::function<ClimateReading()> room_sensor(const RoomSensor& sensor, Clock& clock);

}  // namespace etalon
