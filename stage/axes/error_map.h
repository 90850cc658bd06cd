// What an interferometer said about one axis: its deviation (ISO 230-2: actual minus indicated
// position) as a table over the travel, interpolated linearly. So is the standard uncertainty:
// right for fully correlated errors of neighbouring points, safe otherwise. Pure, no device.
#pragma once

#include "core/config/strict_reader.h"

namespace etalon {

struct ErrorMapPoint {
    double position = 0.0;     // as the axis reads, mm or rad
    double error = 0.0;        // actual minus read, mm or rad
    double uncertainty = 0.0;  // standard, of the error, >= 0, mm or rad
};

class ErrorMap {
public:
    // At least two points, positions rising, else ConfigError at `place`.
    ErrorMap(std::vector<ErrorMapPoint> points, const SourcePlace& place);

    const std::vector<ErrorMapPoint>& points() const { return points_; }

    // Nothing outside the table. But an axis at rest at its end reads a little more or less: up to
    // 1/1000 of the table's length beyond the end, the end's value counts.
    std::optional<ErrorMapPoint> at(double position) const;

private:
    std::vector<ErrorMapPoint> points_;
};

// Reads [[position, error, standard uncertainty], ...] or {file: map.csv}, a file with the header
// `position_mm,error_um,uncertainty_um` (rotary: position_deg,error_deg,uncertainty_deg) beside the
// YAML file. Positions in mm, errors in um; of a rotary axis both in degrees. Throws ConfigError.
ErrorMap read_error_map(const Value& value, bool rotary);

}  // namespace etalon
