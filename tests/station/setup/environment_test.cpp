#include "station/setup/environment.h"

#include <gmock/gmock.h>

#include <cmath>

#include "compare/qualification/qualification.h"
#include "station/setup/station_file.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

using testing::HasSubstr;

const std::string by_hand =
    "environment: {temperature_c: [19.9, 20.5], humidity_percent: [40, 52]}";
const std::string by_sensor =
    "environment: {link: {host: 127.0.0.1, port: 1503, unit: 7},\n"
    "  temperature: {input_register: 5, type: int16, scale: 0.01, offset: -2},\n"
    "  humidity: {register: 8, type: float32, word_order: low_first}}";

StationFile station_in(const std::string& environment) {
    const TemporaryFolder folder;
    return read_station(
        write_station(folder, station_text + replaced(traced_text, by_hand, environment)));
}

std::string refusal(const std::string& environment) {
    try {
        station_in(environment);
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "";
}

TEST(Environment, KnowsWhereItsSensorKeepsWhat) {
    const StationEnvironment environment = *station_in(by_sensor).environment;
    ASSERT_TRUE(environment.sensor);
    EXPECT_EQ(environment.sensor->link.unit, 7);
    const SensorRegister& temperature = environment.sensor->temperature_c;
    EXPECT_EQ(temperature.space, RegisterSpace::input_registers);
    EXPECT_EQ(temperature.address, 5);
    EXPECT_EQ(temperature.type, NumberType::int16);
    EXPECT_EQ(temperature.scale, 0.01);
    EXPECT_EQ(temperature.offset, -2.0);
    const SensorRegister& humidity = environment.sensor->humidity_percent.value();
    EXPECT_EQ(humidity.space, RegisterSpace::holding_registers);
    EXPECT_EQ(humidity.order, WordOrder::low_first);
    EXPECT_EQ(humidity.scale, 1.0);
}

TEST(Environment, RefusesWhatNoRoomAndNoSensorHas) {
    EXPECT_THAT(refusal("environment: {temperature_c: [20.5, 19.9]}"),
                HasSubstr("[lowest, highest]"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19.9, 290]}"), HasSubstr("temperature_c"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19, 20], humidity_percent: [40, 101]}"),
                HasSubstr("humidity_percent"));
    EXPECT_THAT(refusal("environment: {humidity_percent: [40, 50]}"), HasSubstr("temperature_c"));
    EXPECT_THAT(refusal(replaced(by_sensor, "scale: 0.01", "scale: 0")), HasSubstr("scale"));
    EXPECT_THAT(refusal(replaced(by_sensor, "int16", "int8")), HasSubstr("type"));
    EXPECT_THAT(refusal(replaced(by_sensor, "register: 8", "register: 65535")), HasSubstr("65534"));
    EXPECT_THAT(refusal(replaced(by_sensor, "  humidity:", "  moisture:")), HasSubstr("moisture"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19, 20], link: {host: a, port: 1}}"),
                HasSubstr("temperature"));
}

// By hand: the middle of 19.9 and 20.5 is 0.2 K from 20 C; 0.6 / sqrt(12); hypot(0.03, 0.04).
TEST(Environment, ByHandReplacesTheDeclaredTemperature) {
    const StationFile station = station_in(by_hand);
    const DeclaredTemperature temperature = temperature_of_run(station, {}).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::sqrt(0.04 + 0.36 / 12.0 + 0.0009 + 0.0016),
                1e-12);
    EXPECT_TRUE(std::isinf(temperature.degrees_of_freedom));
    EXPECT_EQ(temperature.marker_expansion_per_k, 9e-6);
    EXPECT_THAT(temperature.basis, HasSubstr("T-1"));
    EXPECT_NEAR(room_humidity(station, {})->mean, 46.0, 1e-12);
}

RunEnvironment readings(std::initializer_list<double> temperatures) {
    RunEnvironment environment;
    for (const double temperature : temperatures)
        environment.readings.push_back({7.0, temperature, 45.0});
    return environment;
}

// By hand: mean 20.5, s = 0.2; u^2 = 0.25 + 0.04 + 0.0025, nu = (u/s)^4 * 2.
TEST(Environment, ReadingsReplaceTheDeclaredTemperature) {
    const StationFile station = station_in(by_sensor);
    const RunEnvironment environment = readings({20.3, 20.7, 20.5});
    const DeclaredTemperature temperature = temperature_of_run(station, environment).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::sqrt(0.2925), 1e-12);
    EXPECT_NEAR(temperature.degrees_of_freedom, 2.0 * std::pow(0.2925 / 0.04, 2), 1e-6);
    EXPECT_EQ(room_temperature(station, environment)->lowest, 20.3);
    EXPECT_EQ(room_temperature(station, environment)->highest, 20.7);
}

TEST(Environment, LeavesTheDeclaredTemperatureWhereItIsNotMeasured) {
    const double declared = 0.3;
    const auto of = [](const StationFile& station, const RunEnvironment& environment) {
        return temperature_of_run(station, environment)->standard_uncertainty_k;
    };
    const StationFile station = station_in(by_sensor);
    EXPECT_EQ(of(station, readings({20.5})), declared);  // one reading has no spread
    RunEnvironment lost = readings({20.3, 20.7, 20.5});
    lost.lost = "no answer";
    EXPECT_EQ(of(station, lost), declared);
    StationFile untraced = station;
    untraced.references.clear();
    EXPECT_EQ(of(untraced, readings({20.1, 20.3, 20.2})), declared);
    StationFile without = station;
    without.environment.reset();
    EXPECT_EQ(of(without, {}), declared);
}

// It may be wrong itself, but what it says cannot be left out. By hand: mean 64.1, s = 0.3.
TEST(Environment, ReadingsWithoutACertificateOnlyWidenTheDeclaredTemperature) {
    StationFile station = station_in(by_sensor);
    station.references.clear();
    const DeclaredTemperature temperature =
        temperature_of_run(station, readings({64.1, 63.8, 64.4})).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::hypot(44.1, 0.3), 1e-9);
    EXPECT_THAT(temperature.basis, HasSubstr("without a certificate"));
}

}  // namespace
}  // namespace etalon
