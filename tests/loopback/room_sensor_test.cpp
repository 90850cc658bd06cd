#include "station/qualify/runner.h"

#include "mocks/stage/room_sensor_server.h"
#include "tests/test.h"

namespace etalon {
namespace {

// The sensor of the twin as a station names it.
RoomSensor sensor_at(int port) {
    return {
        .link = {.address = TcpAddress{"127.0.0.1", port}, .unit = 7, .response_timeout = 200ms},
        .temperature_c = {.scale = 0.01, .possible = {-40.0, 85.0}},
        .humidity_percent = SensorRegister{
            .address = 1, .type = NumberType::uint16, .scale = 0.1, .possible = {0.0, 100.0}}};
}

std::string failure(const std::function<ClimateReading()>& read) {
    return device_error_of([&] { read(); });
}

// A quarter of the period after the start the sine is at its top.
TEST(RoomSensor, ReadsWhatTheRoomIs) {
    VirtualClock room_time;
    const RoomSensorServer server({-3.25, 0.5, 60.0, 47.3}, room_time);
    SteadyClock clock;
    const auto read = room_sensor(sensor_at(server.port()), clock);
    EXPECT_NEAR(read().temperature_c, -3.25, 0.005001);
    room_time.wait_for(15s, {});
    const ClimateReading reading = read();
    EXPECT_NEAR(reading.temperature_c, -2.75, 0.005001);
    EXPECT_NEAR(reading.humidity_percent.value(), 47.3, 1e-9);
}

TEST(RoomSensor, SaysWhichSensorDoesNotAnswer) {
    VirtualClock room_time;
    RoomSensorServer server({}, room_time);
    SteadyClock clock;
    const auto read = room_sensor(sensor_at(server.port()), clock);
    EXPECT_EQ(failure(read), "no error");
    server.fall_silent();
    EXPECT_THAT(failure(read), HasSubstr("room sensor 127.0.0.1"));
}

TEST(RoomSensor, DoesNotBelieveWhatNoRoomHas) {
    VirtualClock room_time;
    const RoomSensorServer server({.temperature_c = 120.0}, room_time);
    SteadyClock clock;
    EXPECT_THAT(failure(room_sensor(sensor_at(server.port()), clock)),
                HasSubstr("read register 0: 120 is not"));
}

TEST(RoomSensor, IsRefusedByADeviceThatHasNoSuchRegister) {
    VirtualClock room_time;
    const RoomSensorServer server({}, room_time);
    SteadyClock clock;
    RoomSensor wrong = sensor_at(server.port());
    wrong.temperature_c.address = 2;
    EXPECT_THAT(failure(room_sensor(wrong, clock)), HasSubstr("read register 2"));
}

}  // namespace
}  // namespace etalon
