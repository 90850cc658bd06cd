// `references` in station.yaml: the certificates of what a station measures with. A run can be
// certified only when each of them is there and was in force on its day (docs/certificate.md).
//
//     references:
//       stage_scale:                       # of every axis, about its zero
//         x: {value_ppm: 3, U_ppm: 20, certificate: "4711 2026-01", laboratory: "A, Braunschweig",
//             date: "2026-01-12", due: "2027-01-12"}
//       marker_size: {value_ppm: 12, U_ppm: 60, ...}      # relative, of the printed marker
//       marker_flatness: {value_um: 2, U_um: 6, ...}      # of its edge out of its plane
//       thermometer: {value_k: 0.02, U_k: 0.1, ...}
//
// The value is the deviation that the certificate found, which nothing corrects for; U is its
// expanded uncertainty at k = 2. A certificate that leaves more than the station declares,
// sqrt(value^2 + (U/2)^2), is refused: the budget would claim too little.
#pragma once

#include <string>
#include <vector>

#include "core/config/strict_reader.h"

namespace etalon {

struct StationFile;

struct TracedReference {
    std::string name;  // "stage scale x", "marker print size", "marker flatness", "thermometer"
    double value = 0.0, expanded_uncertainty = 0.0;  // in `unit`
    std::string unit;                                // "ppm", "um", "K"
    std::string certificate, laboratory;             // its number, and who issued it
    std::string date, due;                           // "2026-01-12"; in force on both

    double standard_uncertainty() const;  // with the deviation that is not corrected for
    bool in_force_on(const std::string& day) const { return date <= day && day <= due; }
};

// Of a station whose axes, marker and temperature have been read. Throws ConfigError with file,
// line and key.
std::vector<TracedReference> read_references(const Value& section, const StationFile& station);

// Of this name; null where there is none.
const TracedReference* reference_named(const std::vector<TracedReference>& references,
                                       const std::string& name);

}  // namespace etalon
