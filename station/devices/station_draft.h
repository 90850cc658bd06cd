// The files that a new station begins with, as text for people: what is known of its devices is
// filled in, what only its owner knows stands there with a comment that says so.
#pragma once

#include <string>
#include <vector>

namespace etalon {

struct StationTemplate {
    std::string camera = "genicam:127.0.0.1";  // URI
    std::string calibration = "camera.yml";    // as it shall stand in the file
    std::string stage = "127.0.0.1:502";       // HOST:PORT, or a serial line: "/dev/ttyUSB0"
    std::string profile = "generic";           // of the controller
    std::string marker = "apriltag:36h11:5@80mm";
    std::vector<std::string> axes = {"x", "y", "z", "rz"};  // the first is nearest to the base
};

// station.yaml. Throws ConfigError, naming the option, for a stage that is neither, for an axis
// that is none of x, y, z, rx, ry, rz or is doubled, and for text that YAML would take apart.
std::string drafted_station(const StationTemplate& draft);

// limits.yaml: the quantities that every station must judge.
std::string drafted_limits();

}  // namespace etalon
