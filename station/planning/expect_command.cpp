// `etalon expect`: the pose errors to be expected of a camera, a marker and a detector.
#include <fmt/format.h>

#include "calib/files/camera_file.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "station/planning/expectation_report.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

struct ExpectArguments {
    std::filesystem::path camera, out;  // out: folder; empty: no report
    std::string marker;
    std::string volume;  // "NEAR:FAR", depths in mm
    double max_tilt_deg = 45.0;
    std::string detector = "auto";
    int poses = 200, frames = 8;
    std::uint64_t seed = 1;
    double background = 1.0, white_level = 0.8;
    bool json = false;
};

// "NEAR:FAR", mm.
SeenVolume parse_volume(const std::string& text, double max_tilt_deg) {
    const std::vector<std::string> parts = split(text, ':');
    const auto near = parts.size() == 2 ? parse_number(parts[0]) : std::nullopt;
    const auto far = parts.size() == 2 ? parse_number(parts[1]) : std::nullopt;
    if (!near || !far || !(*near > 0.0) || *far < *near)
        throw ConfigError({"--volume"}, "must be two depths in mm, NEAR:FAR, not '" + text + "'");
    return {*near, *far, max_tilt_deg * rad_per_deg};
}

ExpectationRequest request_of(const ExpectArguments& arguments) {
    ExpectationRequest request{
        .scene = {read_any_camera(arguments.camera), parse_marker(arguments.marker, "--marker"),
                  arguments.detector, arguments.background, arguments.white_level},
        .volume = parse_volume(arguments.volume, arguments.max_tilt_deg),
        .poses = arguments.poses,
        .frames = arguments.frames,
        .seed = arguments.seed};
    if (request.scene.camera.projection.kind == Projection::telecentric)
        throw ConfigError({"--camera"}, "is telecentric: a distance is not in its images");
    return request;
}

void print_text(const Expectation& expectation) {
    fmt::print(
        "detected at {} of {} poses, in {:.1f} % of frames; other planar solution {:.1f} %\n",
        expectation.detected(), expectation.poses.size(), 100.0 * expectation.detection_rate(),
        100.0 * expectation.flip_rate());
    if (!expectation.no_noise.empty())
        fmt::print("no noise: {}\n", expectation.no_noise);
    if (!expectation.bias_maps)
        throw NumericalError(fmt::format("the marker is detected at {} poses, {} are needed",
                                         expectation.detected(), ExpectationMap::min_poses));
    fmt::print("{:<24}{:<5}{:>8} {:>19} {:>8} {:>8}\n", "", "", "bias", "95 %", "RMS", "noise");
    const auto rows = summary_rows(expectation);
    for (const auto& row : rows)
        fmt::print("{:<24}{:<5}{:>8} {:>19} {:>8} {:>8}\n", row[0], row[1], row[2], row[3], row[4],
                   row[8]);
    fmt::print("largest of the smooth maps (depth, from the principal point, tilt):\n");
    for (const auto& row : rows)
        fmt::print("{:<24}{:<5}{:>8}  at {}\n", row[0], row[1], row[6], row[7]);
}

int run_expect(const ExpectArguments& arguments) {
    const ExpectationRequest request = request_of(arguments);
    StderrProgress progress;
    progress.begin("rendering", request.poses);
    const Expectation expectation = expect_errors(request, [&] { progress.count(); });
    progress.end();
    if (!arguments.out.empty())
        write_expectation(request, expectation, arguments.out);
    if (arguments.json)
        fmt::print("{}", expectation_json(request, expectation));
    else
        print_text(expectation);
    if (!arguments.json)
        print_report(arguments.out);
    return 0;
}

}  // namespace

void declare_expect(Command& program) {
    auto [command, asked] = program.add(
        run_expect, "expect", "map the pose errors to expect of camera and marker",
        "Renders the marker at poses all over the volume that the camera sees, detects\n"
        "it and maps the bias (without noise) and the noise (from the sensor section)\n"
        "over distance, image position and tilt, with bootstrap intervals. The routine\n"
        "test after a calibration; needs neither stage nor photographs. A minute of CPU\n"
        "time for 200 poses. Explained in docs/expectation.md.\n\n"
        "Example:\n"
        "  etalon expect --camera camera.yml --marker apriltag:36h11:5@80mm \\\n"
        "      --volume 330:630 --out expected\n");
    command.required("--camera", asked->camera, "calibration: ours, OpenCV's or ROS'", "FILE");
    command.required("--marker", asked->marker, "as for `etalon render`", "M");
    command.required("--volume", asked->volume, "depths of the marker, mm", "NEAR:FAR");
    command.option("--tilt", asked->max_tilt_deg, "largest tilt, degrees (default 45)", "DEG")
        .in_range(0.0, 80.0);
    command.option("--detector", asked->detector, "default: the marker's own", "NAME");
    command.option("--poses", asked->poses, "default 200", "N").within(20, 100000);
    command.option("--frames", asked->frames, "with noise, per pose (default 8; 0: none)", "N")
        .within(0, 1000);
    command.option("--seed", asked->seed, "of poses, noise and bootstrap (default 1)", "N").whole();
    command
        .option("--background", asked->background,
                "radiance around the marker, whose white\nis 1 (default 1)", "B")
        .in_range(0.0, 1.0);
    command
        .option("--white", asked->white_level,
                "the marker's white in the images, 1 = full\nscale (default 0.8)", "W")
        .in_range(0.01, 1.0);
    command.option("--out", asked->out, "folder for report.html, JSON and CSV", "DIR");
}

}  // namespace etalon
