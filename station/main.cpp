// The command line of `etalon`: options in, one function of station/shell/commands.h called, its
// exit code out. Nothing else happens here.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>

#include "capture/frame/camera.h"
#include "core/errors.h"
#include "core/exit_codes.h"
#include "core/text.h"
#include "core/version.h"
#include "station/record/qualify_result.h"
#include "station/shell/command_line.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

constexpr const char* marker_names =
    "Markers:\n"
    "  apriltag:36h11:5@50mm   family, id, side of the black square\n"
    "  aruco:4X4_50:7@50mm     OpenCV's predefined dictionary, id, side\n"
    "  stag:HD21:3@50mm        STag: family or table file, id, side\n"
    "  topotag:4x4:123@50mm    vertices, id, side of the white square; 4x4-circle\n"
    "  chessboard:9x6@25mm     inner corners, side of a square\n"
    "  charuco:4X4_50:9x6@30mm/22mm   squares, side of a square and of a marker\n"
    "  aprilgrid:36h11:6x5@40mm/12mm  Kalibr's grid: tags, side of a tag, gap\n"
    "  circles:7x6@20mm/12mm   circles: spacing, diameter\n"
    "  acircles:4x11@20mm/12mm  OpenCV's asymmetric circles\n"
    "  bitmap:FILE@50x50mm     each pixel a cell, 0..255 = radiance 0..1 (linear)\n";

constexpr const char* pose_words =
    "A pose is camera_from_marker: the rotation vector (axis times angle) in rad,\n"
    "then the translation in mm. Camera: x right, y down, z forward. Marker: origin\n"
    "at its centre (a chessboard's: its first inner corner), x right, y down, z into\n"
    "the marker: 0,0,0,0,0,300 is a marker seen squarely from 300 mm.\n";

void add_marker_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<MarkerArguments>();
    CLI::App* sub = add_command(app, run, arguments, run_marker, "marker",
                                "draw a marker at its true size, ready to print", marker_names);
    sub->add_option("MARKER", arguments->marker, "what to draw, see below")
        ->required()
        ->type_name("");
    sub->add_option("--out", arguments->out, "file to write: .svg, .pdf or .png")
        ->required()
        ->type_name("FILE");
    sub->add_option("--dots-per-mm", arguments->dots_per_mm, "resolution of a PNG (default 40)")
        ->check(positive_number())
        ->type_name("N");
}

constexpr const char* render_details =
    "\nSeveral markers: repeat --marker and --pose; one must not hide another.\n\n"
    "With --poses the scene is rendered from every pose of a file (CSV with the\n"
    "header rx,ry,rz,tx,ty,tz, or JSON) into the folder --out, in parallel. A row is\n"
    "the scene's pose; --pose then says where a marker is in the scene and may be\n"
    "left out for one marker. The same command again renders only what is missing;\n"
    "poses that cannot be rendered are listed in images.jsonl and counted.\n\n"
    "Examples:\n"
    "  etalon render --camera camera.yml --marker apriltag:36h11:5@50mm \\\n"
    "      --pose 0.2,-0.1,0,5,7,300 --out render.png\n"
    "  etalon render --camera camera.yml --marker apriltag:36h11:5@50mm \\\n"
    "      --poses poses.csv --out images\n";

void add_render_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<RenderArguments>();
    CLI::App* sub = add_command(app, run, arguments, run_render, "render",
                                "render markers as a calibrated camera would see them",
                                std::string(pose_words) + "\n" + marker_names + render_details);
    sub->add_option("--camera", arguments->camera, "calibration: ours, OpenCV's or ROS'")
        ->required()
        ->type_name("FILE");
    sub->add_option("--marker", arguments->markers, "what to render, see below")
        ->required()
        ->allow_extra_args(false)
        ->type_name("M");
    sub->add_option("--pose", arguments->poses, "rx,ry,rz,tx,ty,tz: where it is, see below")
        ->allow_extra_args(false)
        ->type_name("P");
    sub->add_option("--poses", arguments->pose_file, "render a set: an image for every pose")
        ->type_name("FILE");
    sub->add_option("--out", arguments->out, ".png or .tiff; of a set: the folder")
        ->required()
        ->type_name("FILE");
    sub->add_option("--background", arguments->background,
                    "radiance around the markers, 0 to 1 (default 1),\n"
                    "or an image of the camera without them")
        ->type_name("B");
    sub->add_option("--method", arguments->method,
                    "auto (default), E (exact lens), C (exact area)\n"
                    "or reference (brute force, slow)")
        ->check(CLI::IsMember({"auto", "E", "C", "reference"}))
        ->type_name("NAME");
    sub->add_option("--tolerance", arguments->tolerance_gray,
                    "largest error, in 1/255 of full scale (default 0.1)")
        ->check(positive_number())
        ->type_name("GRAY");
    sub->add_option("--exposure", arguments->exposure,
                    "factor on the radiance, background included\n(default 1)")
        ->check(positive_number())
        ->type_name("X");
    sub->add_option("--velocity", arguments->velocity,
                    "motion blur: rad/s and mm/s of the markers\n"
                    "in the camera's frame; with --shutter")
        ->type_name("WX,WY,WZ,VX,VY,VZ");
    sub->add_option("--shutter", arguments->shutter_ms, "how long the shutter is open")
        ->check(positive_number())
        ->type_name("MS");
    sub->add_flag("--linear", arguments->linear, "write radiance as 32-bit float TIFF");
    sub->add_option("--noise-seed", arguments->noise_seed,
                    "add the sensor's shot and read noise, from this seed")
        ->check(whole_number())
        ->type_name("N");
    sub->add_flag("--explain", arguments->explain, "print what was left out, and by which bound");
}

void add_bench_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<BenchArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_bench, "bench", "measure the renderer: error against run time",
        "Every method and setting on eight scenes and a cloud of poses against the\n"
        "reference integrator, and frames per second beside the published method.\n"
        "About six minutes on two cores. Explained in docs/performance.md.\n\n"
        "Example:\n  etalon bench --scene webcam-500 --poses 0 --out bench\n");
    sub->add_option("--scene", arguments->scenes, "a scene; may be repeated (default: all)")
        ->type_name("NAME");
    sub->add_option("--out", arguments->out, "folder for bench.csv, table.md, bench.svg")
        ->type_name("DIR");
    sub->add_option("--poses", arguments->poses, "poses of the cloud (default 200; 0: none)")
        ->check(whole_number())
        ->type_name("N");
    sub->add_option("--throughput", arguments->throughput,
                    "frames to render in memory (default 10000; 0: none)")
        ->check(whole_number())
        ->type_name("N");
    sub->add_option("--reference-samples", arguments->reference_samples,
                    "in each of 16 scrambles (default 16384)")
        ->check(whole_number())
        ->type_name("N");
    sub->add_flag("--quick", arguments->quick, "few settings and samples, to try the command");
    sub->add_flag("--check", arguments->check, "exit code 1 when a promised figure is missed");
}

void add_stability_command(CLI::App& app, Run& run) {
    add_command(app, run, std::make_shared<StabilityArguments>(), run_stability, "stability",
                "run every stiff and extreme rendering case",
                "Nearly edge-on markers, focus, folds, NaN, 100 megapixels ...: each must be\n"
                "right against the reference integrator, or refused. Prints a table and\n"
                "`N cases, M failed`; exit code 1 when one failed. About a minute and a half on\n"
                "two cores. Explained in docs/stability.md.\n");
}

constexpr const char* calibrate_details =
    "Prints `RMS x px`, `leave-one-out x px over n photos` and `model NAME`; tables\n"
    "and what speaks against the calibration go to stderr. With --report DIR gets\n"
    "report.html, calibration.json and corners.csv. Explained in docs/calibration.md.\n\n"
    "Targets (`etalon marker` prints them):\n"
    "  chessboard:9x6@25mm                  inner corners, side of a square\n"
    "  charuco:4X4_50:9x6@30mm/22mm         squares, their side, side of a marker\n"
    "  aprilgrid:36h11:6x5@40mm/12mm        tags, their side, gap between them\n"
    "  circles:7x6@20mm/12mm                circles, spacing, diameter\n"
    "  acircles:4x11@20mm/12mm              OpenCV's asymmetric grid\n\n"
    "Models, each with the parameters of those before it:\n"
    "  pinhole   fx fy cx cy          rational  k4 k5 k6\n"
    "  radial    k1 k2                prism     s1 s2 s3 s4\n"
    "  standard  p1 p2 k3             tilted    tau_x tau_y\n"
    "`auto` takes the simplest one that predicts photos it has not seen as well as\n"
    "the best, within a standard error.\n\n"
    "Examples:\n"
    "  etalon calibrate --board 9x6 --square-mm 25 left*.jpg --out camera.yml\n"
    "  etalon calibrate --target chessboard:9x6@25mm left*.jpg --out camera.yml \\\n"
    "      --report calibration\n";

void add_calibrate_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<CalibrateArguments>();
    CLI::App* sub =
        add_command(app, run, arguments, run_calibrate, "calibrate",
                    "estimate intrinsics from photographs of a target", calibrate_details);
    sub->add_option("PHOTOS", arguments->photos, "three or more photographs of the target")
        ->required()
        ->type_name("");
    auto* target =
        sub->add_option("--target", arguments->target, "what was photographed, see below")
            ->type_name("T");
    auto* board = sub->add_option("--board", arguments->board,
                                  "short for a chessboard: inner corners,\ncolumns x rows: 9x6")
                      ->excludes(target)
                      ->type_name("CxR");
    auto* square = sub->add_option("--square-mm", arguments->square_mm, "side of its squares")
                       ->check(positive_number())
                       ->needs(board)
                       ->type_name("MM");
    board->needs(square);
    sub->add_option("--model", arguments->model, "auto (default) or a name, see below")
        ->type_name("NAME");
    sub->add_option("--refine", arguments->refine,
                    "photometric: fit all pixels, if held-out\nphotos show a gain")
        ->check(CLI::IsMember({"photometric"}))
        ->type_name("HOW");
    sub->add_option("--out", arguments->out, "camera.yml to write")->required()->type_name("FILE");
    sub->add_option("--opencv-out", arguments->opencv_out, "the same as OpenCV YAML")
        ->type_name("FILE");
    sub->add_option("--report", arguments->report, "folder for report, JSON and corners")
        ->type_name("DIR");
}

void add_characterise_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<CharacteriseArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_characterise, "characterise",
        "measure blur, noise, tone and illumination of a camera",
        "Writes the camera file with the measured values and their uncertainties, and\n"
        "prints a line `QUANTITY VALUE +- U` each (k = 2). What is not given is not\n"
        "measured. Exit code 2 when photographs were given that cannot be used.\n"
        "How to take them: docs/characterising.md.\n\n"
        "Example:\n"
        "  etalon characterise --camera camera.yml --target chessboard:9x6@25mm board*.png \\\n"
        "      --repeats still*.png --flat flat*.png --dark dark*.png \\\n"
        "      --exposures series.csv --out characterised.yml --report characterised\n");
    sub->add_option("PHOTOS", arguments->photos, "the target in several places and tilts")
        ->type_name("");
    sub->add_option("--camera", arguments->camera, "calibration: ours or another tool's")
        ->required()
        ->type_name("FILE");
    sub->add_option("--target", arguments->target, "the target, as for calibrating")
        ->required()
        ->type_name("M");
    const auto add_photos = [sub](const char* name, std::vector<std::filesystem::path>& target,
                                  const char* summary) {
        sub->add_option(name, target, summary)->type_name("PHOTOS");
    };
    add_photos("--repeats", arguments->repeats, "one still view, two or more times");
    add_photos("--flat", arguments->flats, "a uniform field");
    add_photos("--dark", arguments->darks, "lens covered");
    sub->add_option("--exposures", arguments->exposures,
                    "CSV file,exposure_us: one still scene at\nseveral exposure times")
        ->type_name("FILE");
    sub->add_option("--out", arguments->out, "camera.yml to write")->required()->type_name("FILE");
    sub->add_option("--report", arguments->report, "folder for report.html")->type_name("DIR");
}

void add_detect_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<DetectArguments>();
    CLI::App* sub = add_command(app, run, arguments, run_detect, "detect",
                                "find a marker in photographs, and its pose",
                                std::string(pose_words) + "\n" + marker_names);
    sub->add_option("PHOTOS", arguments->photos, "photographs to look at")
        ->required()
        ->type_name("");
    sub->add_option("--marker", arguments->marker, "what to look for, see below")
        ->required()
        ->type_name("M");
    sub->add_option("--camera", arguments->camera, "calibration, for the pose")->type_name("FILE");
    sub->add_option(
           "--detector", arguments->detector,
           "apriltag, aruco, topotag, chessboard, charuco, stag,\nauto: the marker's own; or "
           "photometric: the pose\nfrom all pixels, for any marker or board")
        ->type_name("NAME");
    sub->add_option("--poses", arguments->poses,
                    "where the marker is about (photometric only):\na pose for each photo, the "
                    "image right to 5 px")
        ->type_name("FILE");
}

void add_compare_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<CompareArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_compare, "compare",
        "compare photographs with renders from a calibration",
        "Renders every photograph at its pose and reports how they differ: prints\n"
        "`mean residual x gray over n photos`; the report, tables, overlays and plots\n"
        "go to DIR. Each photograph is compared at its pose and at the pose refined on\n"
        "its pixels.\n"
        "Poses are estimated from the photographs unless --poses gives them.\n\n"
        "Example:\n"
        "  etalon compare --camera camera.yml --board 9x6 --square-mm 25 \\\n"
        "      left*.jpg --out differences\n\n" +
            std::string(marker_names));
    sub->add_option("PHOTOS", arguments->photos, "photographs to compare")
        ->required()
        ->type_name("");
    sub->add_option("--camera", arguments->camera, "calibration: ours, OpenCV's or ROS'")
        ->required()
        ->type_name("FILE");
    auto* board = sub->add_option("--board", arguments->board, "inner corners of a chessboard: 9x6")
                      ->type_name("CxR");
    auto* square = sub->add_option("--square-mm", arguments->square_mm, "side of its squares")
                       ->check(positive_number())
                       ->type_name("MM");
    auto* marker = sub->add_option("--marker", arguments->marker, "a marker in place of a board")
                       ->type_name("M");
    board->needs(square)->excludes(marker);
    square->needs(board);
    sub->add_option("--out", arguments->out, "folder to write to")->required()->type_name("DIR");
    sub->add_option("--poses", arguments->poses,
                    "CSV with the header rx,ry,rz,tx,ty,tz, one row\nper photograph, or JSON")
        ->type_name("FILE");
    sub->add_option(
           "--detector", arguments->detector,
           "apriltag, aruco, topotag, chessboard, charuco, stag,\nor auto: the marker's own")
        ->type_name("NAME");
    sub->add_option("--score-margin", arguments->score_margin,
                    "how far around a board's inner corners residuals\n"
                    "count, in squares (default 0.3,0.65)")
        ->type_name("X,Y");
    sub->add_option("--baseline", arguments->baseline,
                    "folder of an earlier comparison of this camera:\nwhat changed since")
        ->type_name("DIR");
}

void add_devices_command(CLI::App& app, Run& run) {
    add_command(app, run, std::make_shared<DevicesArguments>(), run_devices, "devices",
                "list cameras, and the backends that are built in",
                "Each camera is opened for a moment to ask for its pixel formats and controls. A\n"
                "backend whose SDK was missing when this program was built is named as left out,\n"
                "with the reason.\n");
}

void add_drift_options(CLI::App& capture, CaptureArguments& arguments) {
    auto* drift = capture.add_flag("--drift", arguments.drift,
                                   "warm-up check: watch a target until it is still");
    auto* marker = capture
                       .add_option("--marker", arguments.marker,
                                   "the target: any marker or board that a\ndetector sees")
                       ->needs(drift)
                       ->type_name("M");
    capture.add_option("--minutes", arguments.minutes, "at most (default 60, or as --frames says)")
        ->check(positive_number())
        ->needs(drift)
        ->excludes("--frames")
        ->type_name("M");
    capture
        .add_option("--interval-s", arguments.interval_s,
                    "between frames (default 1); of files: how far\napart they were taken")
        ->check(positive_number())
        ->needs(drift)
        ->type_name("S");
    drift->needs(marker)->needs("--out")->excludes("--live");
}

void add_capture_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<CaptureArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_capture, "capture", "take frames with a camera",
        "Prints `captured N frames`, `noise X DN` (of a still scene) and `record FILE`.\n"
        "DIR gets capture.json, events.jsonl, frames/ and mean.tiff, and can be replayed\n"
        "as files:DIR. Settings are read back; what the camera does not do is an error.\n"
        "Cameras, formats and controls: `etalon devices`.\n\n"
        "With --drift it watches a target that stands still until its image moves by less\n"
        "than 0.02 px per minute, anywhere in the image and with its uncertainty: prints\n"
        "`drift X px/min stable after T min` and `report FILE`. Exit code 2 if that does\n"
        "not happen in the time. DIR gets drift.csv, drift.json and report.html.\n\n"
        "Examples:\n"
        "  etalon capture --camera v4l2:/dev/video0 --format Y16 --exposure-us 5000 \\\n"
        "      --frames 100 --out still\n"
        "  etalon capture --camera v4l2:/dev/video0 --drift --minutes 90 \\\n"
        "      --marker chessboard:9x6@25mm --out warm-up\n");
    sub->add_option("--camera", arguments->camera,
                    "v4l2:/dev/video0, genicam:ID-OR-IP,\nlibcamera:ID or files:DIR")
        ->required()
        ->type_name("URI");
    sub->add_option("--frames", arguments->frames, "how many")
        ->check(within(1, 1000000))
        ->type_name("N");
    sub->add_option("--out", arguments->out, "folder of the record")->type_name("DIR");
    sub->add_flag("--live", arguments->live,
                  "show fps, mean, noise, saturation, sharpness;\nwithout --frames until Ctrl-C");
    sub->add_option("--format", arguments->format, "pixel format, by the device's name")
        ->type_name("NAME");
    sub->add_option("--bits", arguments->bits, "per pixel (default 8, or the format's)")
        ->check(within(1, 16))
        ->type_name("N");
    sub->add_option("--width", arguments->width, "of the image (default: the device's)")
        ->check(within(1, 65536))
        ->type_name("PX");
    sub->add_option("--height", arguments->height)->check(within(1, 65536))->type_name("PX");
    sub->add_option("--exposure-us", arguments->exposure_us, "(default: the device's)")
        ->check(positive_number())
        ->type_name("US");
    sub->add_option("--gain-db", arguments->gain_db, "(default 0)")->type_name("DB");
    sub->add_option("--black-level", arguments->black_level, "in the device's unit")
        ->type_name("X");
    sub->add_option("--trigger", arguments->trigger, "the device's name of a source, or none")
        ->type_name("NAME");
    sub->add_option("--set", arguments->controls, "a control by its name; may be repeated")
        ->allow_extra_args(false)
        ->type_name("NAME=X");
    sub->add_option("--retries", arguments->retries, "of a bad frame (default 5)")
        ->check(within(0, 1000))
        ->type_name("N");
    sub->add_option("--frame-timeout-ms", arguments->frame_timeout_ms, "(default 1000)")
        ->check(within(1, 600000))
        ->type_name("MS");
    sub->add_option("--packet-size", arguments->packet_size, "GigE Vision (default 1400)")
        ->check(within(576, 16384))
        ->type_name("BYTES");
    sub->add_option("--interface", arguments->interface, "GigE Vision: IP of the network card")
        ->type_name("IP");
    add_drift_options(*sub, *arguments);
}

std::shared_ptr<CameraFileArguments> add_camera_command(CLI::App& camera, Run& run,
                                                        int (*command)(const CameraFileArguments&),
                                                        const char* name, const char* summary,
                                                        const char* details) {
    auto arguments = std::make_shared<CameraFileArguments>();
    CLI::App* sub = add_command(camera, run, arguments, command, name, summary, details);
    sub->add_option("CAMERA", arguments->file, "calibration: ours or another tool's")
        ->required()
        ->type_name("");
    sub->add_option("--select", arguments->select,
                    "which camera of a file with several:\ncam1 (Kalibr), 3 (COLMAP)")
        ->type_name("NAME");
    return arguments;
}

void add_camera_commands(CLI::App& app, Run& run) {
    CLI::App* camera = app.add_subcommand("camera", "show, convert and check a calibration");
    camera->set_help_flag("-h,--help", "show this help");
    camera->require_subcommand(1);
    add_camera_command(*camera, run, run_camera_show, "show", "print what the file says", "");
    const auto convert = add_camera_command(
        *camera, run, run_camera_convert, "convert", "write it as another tool's file",
        "Pixel origins are converted. A coefficient that the tool does not have is an\n"
        "error; what else it has no place for is named on stderr. Prints `camera FILE`.\n");
    CLI::App* sub = camera->get_subcommand("convert");
    sub->add_option("--to", convert->to,
                    "etalon, opencv, ros, kalibr, mrcal, matlab, boofcv\nor colmap")
        ->required()
        ->type_name("TOOL");
    sub->add_option("--out", convert->out, "file to write")->required()->type_name("FILE");
    add_camera_command(*camera, run, run_camera_check, "check",
                       "check that the whole image can be used",
                       "Field of view, where the distortion model ends, what is unusual, and what\n"
                       "the renderer will miss. Exit code 1 when part of the image has no ray.\n");
}

std::string version_text() {
    std::string text = fmt::format("etalon {}\n", version);
    text += "libraries:\n";
    for (const SoftwareVersion& software : software_versions())
        if (software.name != "etalon")
            text += fmt::format("  {:<14}{}\n", software.name, software.version);
    text += "camera backends:\n";
    for (const CameraBackend& backend : list_cameras())
        text += fmt::format("  {:<14}{}\n", backend.name, backend.detail);
    text += "stage backends:\n  modbus-tcp    built in";
    return text;
}

void add_commands(CLI::App& app, Run& run) {
    app.set_help_flag("-h,--help", "show this help");
    app.set_version_flag("--version", version_text, "show versions and backends");
    app.get_formatter()->column_width(26);
    app.get_formatter()->label("SUBCOMMAND", "COMMAND");
    app.get_formatter()->label("Subcommands", "Commands");
    app.footer(
        "Exit codes: 0 PASS or done, 1 FAIL, 2 INCONCLUSIVE, 3 usage or input error,\n"
        "4 device or run error, 130 interrupted.\n\n"
        "`etalon COMMAND --help` explains a command.\n");
    add_qualify_commands(app, run);
    add_compare_command(app, run);
    add_calibrate_command(app, run);
    add_characterise_command(app, run);
    add_render_command(app, run);
    add_detect_command(app, run);
    add_marker_command(app, run);
    add_devices_command(app, run);
    add_capture_command(app, run);
    add_stage_commands(app, run);
    add_metrology_commands(app, run);
    add_camera_commands(app, run);
    add_bench_command(app, run);
    add_stability_command(app, run);
}

// Errors are one line, whatever the message that was thrown.
int fail(int exit_code, const std::string& message) {
    std::string line = message;
    std::replace(line.begin(), line.end(), '\n', ' ');
    std::fprintf(stderr, "etalon: %s\n", std::string(trimmed(line)).c_str());
    return exit_code;
}

int parse_and_run(int argc, char** argv) {
    CLI::App app("etalon: qualifies calibrated cameras on a motorised stage", "etalon");
    Run run;
    add_commands(app, run);
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& request) {  // --help, --version
        return app.exit(request);
    } catch (const CLI::ParseError& error) {
        return fail(ExitCode::usage_error, error.what());
    }
    if (!run)
        return fail(ExitCode::usage_error, "no command given; see `etalon --help`");
    return run();
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    using namespace etalon;
    // A reader that goes away (`etalon qualify ... | head`) must not end a run with moving axes.
    std::signal(SIGPIPE, SIG_IGN);
    try {
        return parse_and_run(argc, argv);
    } catch (const ConfigError& error) {
        return fail(ExitCode::usage_error, error.what());
    } catch (const Interrupted& error) {
        return fail(ExitCode::interrupted, error.what());
    } catch (const std::exception& error) {  // ours, OpenCV's and the standard library's
        return fail(ExitCode::run_error, error.what());
    }
}
