#include "station/devices/station_draft.h"

#include <fmt/format.h>

#include <algorithm>

#include "compare/qualification/judged_quantities.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// In double quotes as YAML reads them; other characters need no escape there.
std::string quoted(const std::string& text, const char* option) {
    if (text.empty() || text.find_first_of("\"\\\n\r\t") != std::string::npos)
        throw ConfigError({option}, fmt::format("cannot stand in a file: '{}'", text));
    return '"' + text + '"';
}

std::string link_text(const std::string& stage) {
    if (stage.starts_with("/"))
        return fmt::format("{{device: {}}}", quoted(stage, "--stage"));
    const auto colon = stage.rfind(':');
    const auto port =
        colon == std::string::npos ? std::optional(502LL) : parse_integer(stage.substr(colon + 1));
    if (!port || *port < 1 || *port > 65535)
        throw ConfigError({"--stage"}, "must be HOST, HOST:PORT or a serial line, not " + stage);
    return fmt::format("{{host: {}, port: {}}}", quoted(stage.substr(0, colon), "--stage"), *port);
}

bool is_rotary(const std::string& axis) {
    return axis.starts_with("r");
}

std::string axis_text(const std::string& name) {
    const char direction = name.back();
    const std::string along = direction == 'x'   ? "[1, 0, 0]"
                              : direction == 'y' ? "[0, 1, 0]"
                                                 : "[0, 0, 1]";
    if (is_rotary(name))
        return fmt::format(R"(    - name: {}
      kind: rotary
      direction: {}
      point_mm: [0, 0, 0]           # yours: a point on the axis
      travel_deg: [-5, 5]           # yours: soft limits
      speed_deg: 5                  # deg/s
)",
                           name, along);
    return fmt::format(R"(    - name: {}
      kind: linear
      direction: {}
      travel: [-5, 5]               # yours: soft limits, mm
      speed: 5                      # mm/s
)",
                       name, along);
}

void require_axes(const std::vector<std::string>& axes) {
    constexpr std::array known = {"x", "y", "z", "rx", "ry", "rz"};
    for (const std::string& axis : axes)
        if (std::ranges::count(known, axis) == 0 || std::ranges::count(axes, axis) != 1)
            throw ConfigError({"--axes"}, fmt::format("must be some of {}, each once; not '{}'",
                                                      fmt::join(known, ", "), axis));
}

// Every axis over nine tenths of its soft limits.
std::string volume_text(const std::vector<std::string>& axes) {
    std::string text;
    for (const std::string& axis : axes)
        text += fmt::format("    {}: [-4.5, 4.5]\n", axis);
    return text;
}

}  // namespace

std::string drafted_station(const StationTemplate& draft) {
    require_axes(draft.axes);
    std::string axes;
    for (const std::string& axis : draft.axes)
        axes += axis_text(axis);
    return fmt::format(
        R"(# A station: the devices, the marker, where it goes, and what the camera is judged by. What only
# you know is marked "yours". Every key is checked; docs/files.md explains them, and those that are
# left out here. `etalon stage plan` and `etalon plan` say what this file means before anything moves.
etalon: station/1
id: station-1                       # yours: names the station in records

camera:
  uri: {}
  calibration: {}                   # of this camera, at this focus

stage:
  link: {}
  profile: {}                       # of the controller
  axes:                             # the first is nearest to the base
{}
marker: {}
marker_size_uncertainty_ppm: 100    # yours: standard uncertainty of its size

plan:
  volume:                           # mm, and degrees for rotary axes
{}  poses: 100
  hold_out: 0.6                     # share of the poses that only judge
  repeats: 8                        # of them are visited again at the end
  frames: 5                         # per pose
  seed: 1
  settle_ms: 50                     # after the stage says that it arrived

detector: auto                      # the marker's own
limits: limits.yaml
)",
        quoted(draft.camera, "--camera"), quoted(draft.calibration, "--calibration"),
        link_text(draft.stage), quoted(draft.profile, "--profile"), axes,
        quoted(draft.marker, "--marker"), volume_text(draft.axes));
}

std::string drafted_limits() {
    std::string text =
        "# What the camera is judged by: the limits are yours. `etalon plan station.yaml` says "
        "how\n"
        "# small a bias this station can see.\n"
        "etalon: limits/1\n"
        "id: limits-1\n";
    for (const QuantityKind& kind : quantity_kinds())
        if (kind.is_required)
            text += fmt::format("{}: {{limit: 0.5, unit: {}}}\n", kind.name, kind.unit);
    return text;
}

}  // namespace etalon
