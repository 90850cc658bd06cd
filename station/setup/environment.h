// `environment` in station.yaml: temperature and humidity of the air at marker and stage during a
// run, given by hand or read from a Modbus sensor with every pose. Keys: docs/certificate.md; what
// it makes of the uncertainty: docs/metrology.md, Temperature.
#pragma once

#include "stage/link/register_numbers.h"
#include "stage/link/stage_link.h"

namespace etalon {

struct StationFile;
struct DeclaredTemperature;

// Anything else from a sensor is a fault.
inline constexpr Range possible_temperature_c{-40.0, 85.0, false, "degrees C"};
inline constexpr Range possible_humidity_percent{0.0, 100.0, false, "%"};

// Where a sensor keeps a quantity: scale * number + offset.
struct SensorRegister {
    RegisterSpace space = RegisterSpace::input_registers;
    int address = 0;
    NumberType type = NumberType::int16;
    WordOrder order = WordOrder::high_first;
    double scale = 1.0, offset = 0.0;
    Range possible;
};

struct RoomSensor {
    StageLink link;
    SensorRegister temperature_c;
    std::optional<SensorRegister> humidity_percent;
};

// Of readings, or of what was given: then the middle, and the deviation of a uniform distribution.
struct ClimateSummary {
    double lowest = 0.0, highest = 0.0, mean = 0.0, deviation = 0.0;
    int readings = 0;  // 0: given by hand
};

struct StationEnvironment {
    std::optional<RoomSensor> sensor;  // otherwise given by hand:
    ClimateSummary temperature_c;
    std::optional<ClimateSummary> humidity_percent;
};

struct ClimateReading {
    double t_s = 0.0;  // on the run's time
    double temperature_c = 0.0;
    std::optional<double> humidity_percent;
};

// What a run knows of its room.
struct RunEnvironment {
    std::vector<ClimateReading> readings;
    std::string lost;  // why the sensor was given up, as of when it last was; empty: it never was
};

// Throws ConfigError with file, line and key.
StationEnvironment read_environment(const Value& section);

// Nothing without a section, or before the second reading.
std::optional<ClimateSummary> room_temperature(const StationFile& station,
                                               const RunEnvironment& environment);
std::optional<ClimateSummary> room_humidity(const StationFile& station,
                                            const RunEnvironment& environment);

// How far the temperature may have been from the one at which marker and stage have their declared
// sizes: of what the station's thermometer measured where it has one that is traced and was never
// lost, otherwise as declared.
//
//     u^2 = (mean - reference)^2 + s^2 + u_thermometer^2
//
// One without a certificate (u_thermometer = 0) only counts where u is more than was declared.
// The deviation from the reference temperature is not corrected for and counts in full; s is that
// of single readings, since each pose has its own temperature.
std::optional<DeclaredTemperature> temperature_of_run(const StationFile& station,
                                                      const RunEnvironment& environment);

}  // namespace etalon
