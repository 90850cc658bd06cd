#include "station/setup/environment.h"

#include <fmt/format.h>

#include "station/setup/station_file.h"

namespace etalon {
namespace {

SensorRegister read_register(const Value& section, const Range& possible) {
    SensorRegister place;
    place.possible = possible;
    const auto holding = section.find("register");
    if (holding)
        place.space = RegisterSpace::holding_registers;
    const Value address = holding ? *holding : section.at("input_register");
    place.type = read_number_type(section.at("type"));
    place.address = address.integer(0, 65536 - registers_of(place.type));
    if (const auto order = section.find("word_order"))
        place.order = read_word_order(*order);
    if (const auto scale = section.find("scale"))
        place.scale = scale->number(units::one.either_sign());
    if (place.scale == 0.0)
        section.at("scale").fail("must not be 0");
    place.offset = section.number_or_zero("offset", units::one.either_sign());
    return place;
}

// Anything between is as likely (GUM 4.3.7).
ClimateSummary read_given(const Value& value, const Range& possible) {
    const std::vector<double> bounds = value.numbers(2, possible);
    if (bounds[0] > bounds[1])
        value.fail(fmt::format("must be [lowest, highest], not [{}, {}]", bounds[0], bounds[1]));
    return {bounds[0], bounds[1], (bounds[0] + bounds[1]) / 2.0,
            (bounds[1] - bounds[0]) / std::sqrt(12.0)};
}

RoomSensor read_sensor(const Value& section) {
    RoomSensor sensor;
    sensor.link = read_stage_link(section.at("link"));
    sensor.temperature_c = read_register(section.at("temperature"), possible_temperature_c);
    if (const auto place = section.find("humidity"))
        sensor.humidity_percent = read_register(*place, possible_humidity_percent);
    return sensor;
}

std::optional<ClimateSummary> summary_of(const std::vector<double>& readings) {
    if (readings.size() < 2)
        return std::nullopt;
    const auto [lowest, highest] = std::ranges::minmax(readings);
    ClimateSummary summary{lowest, highest};
    summary.readings = static_cast<int>(readings.size());
    for (const double reading : readings)
        summary.mean += reading / summary.readings;
    double squares = 0.0;
    for (const double reading : readings)
        squares += std::pow(reading - summary.mean, 2);
    summary.deviation = std::sqrt(squares / (summary.readings - 1));
    return summary;
}

std::string basis_of(const ClimateSummary& room, const DeclaredTemperature& temperature,
                     const std::string& certificate) {
    return fmt::format("{}, mean {:.2f} C ({:.2f} K from {:.4g} C), s = {:.3f} K; thermometer {}",
                       room.readings > 0 ? fmt::format("{} readings", room.readings)
                                         : std::string("given by hand"),
                       room.mean, room.mean - temperature.reference_c, temperature.reference_c,
                       room.deviation, certificate);
}

// Welch and Satterthwaite: only the deviation of readings has a limited number of them.
double degrees_of_freedom(const ClimateSummary& room, double standard_uncertainty) {
    if (room.readings == 0 || room.deviation == 0.0)
        return std::numeric_limits<double>::infinity();
    return std::pow(standard_uncertainty / room.deviation, 4) * (room.readings - 1);
}

}  // namespace

StationEnvironment read_environment(const Value& section) {
    StationEnvironment environment;
    if (section.find("link")) {
        environment.sensor = read_sensor(section);
        return environment;
    }
    environment.temperature_c = read_given(section.at("temperature_c"), possible_temperature_c);
    if (const auto given = section.find("humidity_percent"))
        environment.humidity_percent = read_given(*given, possible_humidity_percent);
    return environment;
}

std::optional<ClimateSummary> room_temperature(const StationFile& station,
                                               const RunEnvironment& environment) {
    if (!station.environment)
        return std::nullopt;
    std::vector<double> readings;
    for (const ClimateReading& reading : environment.readings)
        readings.push_back(reading.temperature_c);
    return station.environment->sensor ? summary_of(readings) : station.environment->temperature_c;
}

std::optional<ClimateSummary> room_humidity(const StationFile& station,
                                            const RunEnvironment& environment) {
    if (!station.environment)
        return std::nullopt;
    if (const auto& given = station.environment->humidity_percent)
        return *given;
    std::vector<double> readings;
    for (const ClimateReading& reading : environment.readings)
        if (reading.humidity_percent)
            readings.push_back(*reading.humidity_percent);
    return summary_of(readings);
}

std::optional<DeclaredTemperature> temperature_of_run(const StationFile& station,
                                                      const RunEnvironment& environment) {
    const TracedReference* thermometer = reference_named(station.references, "thermometer");
    const auto room = room_temperature(station, environment);
    if (!station.temperature || !room || !environment.lost.empty())
        return station.temperature;
    DeclaredTemperature temperature = *station.temperature;
    temperature.standard_uncertainty_k =
        std::hypot(room->mean - temperature.reference_c, room->deviation,
                   thermometer ? thermometer->standard_uncertainty() : 0.0);
    if (!thermometer &&
        temperature.standard_uncertainty_k <= station.temperature->standard_uncertainty_k)
        return station.temperature;
    temperature.degrees_of_freedom = degrees_of_freedom(*room, temperature.standard_uncertainty_k);
    temperature.basis = basis_of(
        *room, temperature,
        thermometer ? thermometer->certificate : "without a certificate, more than was declared");
    return temperature;
}

}  // namespace etalon
