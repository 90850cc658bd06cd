// `etalon register`, `etalon expect` and `etalon study` on the command line.
#include <CLI/CLI.hpp>

#include "station/shell/command_line.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

void add_register_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<RegisterArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_register, "register",
        "find a stage before the camera, a marker on the stage",
        "Estimates X = camera_from_base and Y = carriage_from_marker from photographs\n"
        "at known positions of the stage, corrected for the detector's bias. Names the\n"
        "directions that no motion of the stage can tell (they are held nearest to the\n"
        "station's nominal mounting) and those that the poses hardly tell. Poses that\n"
        "move less than the stage can are refused, by name. No verdict, no device.\n\n"
        "The CSV has a column `photo` (seen from its folder) and one for each axis:\n"
        "x_mm, y_mm, rz_deg ...\n\n"
        "Of a qualification's record all poses count, training and hold-out, with what\n"
        "the axes read.\n\n"
        "Examples:\n"
        "  etalon register --station station.yaml --positions positions.csv\n"
        "  etalon register run-7\n");
    sub->add_option("RECORD", arguments->record, "folder of a qualification")->type_name("");
    sub->add_option("--station", arguments->station,
                    "calibration, axes, marker, mounting\n(default: that of the record)")
        ->type_name("FILE");
    sub->add_option("--positions", arguments->positions, "CSV of photographs and positions")
        ->type_name("CSV");
    sub->add_option("--detector", arguments->detector,
                    "the station's own (default), a detector's name,\n"
                    "or photometric: poses from all pixels, each\nweighted by its covariance")
        ->type_name("NAME");
}

void add_expect_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<ExpectArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_expect, "expect",
        "map the pose errors to expect of camera and marker",
        "Renders the marker at poses all over the volume that the camera sees, detects\n"
        "it and maps the bias (without noise) and the noise (from the sensor section)\n"
        "over distance, image position and tilt, with bootstrap intervals. The routine\n"
        "test after a calibration; needs neither stage nor photographs. A minute of CPU\n"
        "time for 200 poses. Explained in docs/expectation.md.\n\n"
        "Example:\n"
        "  etalon expect --camera camera.yml --marker apriltag:36h11:5@80mm \\\n"
        "      --volume 330:630 --out expected\n");
    sub->add_option("--camera", arguments->camera, "calibration: ours, OpenCV's or ROS'")
        ->required()
        ->type_name("FILE");
    sub->add_option("--marker", arguments->marker, "as for `etalon render`")
        ->required()
        ->type_name("M");
    sub->add_option("--volume", arguments->volume, "depths of the marker, mm")
        ->required()
        ->type_name("NEAR:FAR");
    sub->add_option("--tilt", arguments->max_tilt_deg, "largest tilt, degrees (default 45)")
        ->check(CLI::Range(0.0, 80.0))
        ->type_name("DEG");
    sub->add_option("--detector", arguments->detector, "default: the marker's own")
        ->type_name("NAME");
    sub->add_option("--poses", arguments->poses, "default 200")
        ->check(within(20, 100000))
        ->type_name("N");
    sub->add_option("--frames", arguments->frames, "with noise, per pose (default 8; 0: none)")
        ->check(within(0, 1000))
        ->type_name("N");
    sub->add_option("--seed", arguments->seed, "of poses, noise and bootstrap (default 1)")
        ->check(whole_number())
        ->type_name("N");
    sub->add_option("--background", arguments->background,
                    "radiance around the marker, whose white\nis 1 (default 1)")
        ->check(CLI::Range(0.0, 1.0))
        ->type_name("B");
    sub->add_option("--white", arguments->white_level,
                    "the marker's white in the images, 1 = full\nscale (default 0.8)")
        ->check(CLI::Range(0.01, 1.0))
        ->type_name("W");
    sub->add_option("--out", arguments->out, "folder for report.html, JSON and CSV")
        ->type_name("DIR");
}

void add_study_merge(CLI::App& study, Run& run) {
    auto arguments = std::make_shared<StudyMergeArguments>();
    CLI::App* sub = add_command(
        study, run, arguments, run_study_merge, "merge", "put the shards of a study together",
        "All shards, in any order. The result is that of the study in one piece, byte\n"
        "for byte.\n\n"
        "Example:\n  etalon study merge part-1 part-2 part-3 --out compared\n");
    sub->add_option("SHARDS", arguments->shards, "folders of `etalon study --shard`")
        ->required()
        ->type_name("");
    sub->add_option("--out", arguments->out, "folder of the whole study")
        ->required()
        ->type_name("DIR");
}

void add_study_command(CLI::App& app, Run& run) {
    auto arguments = std::make_shared<StudyArguments>();
    CLI::App* sub = add_command(
        app, run, arguments, run_study_command, "study", "compare detectors on rendered poses",
        "Renders markers at poses all over a volume as a camera would see them, lets\n"
        "detectors find them, and compares their poses with the truth: detection rate,\n"
        "bias, scatter, flips, each error against each degree of freedom. Stopped or\n"
        "killed, the same command goes on. Explained in docs/study.md.\n\n"
        "Detectors: aruco, apriltag, charuco, chessboard, stag, topotag, photometric,\n"
        "external\n"
        "Ablations: tone, half-pixel, noise, blur, undistortion\n\n"
        "Examples:\n"
        "  etalon study examples/study/published.yaml --out compared\n"
        "  etalon study study.yaml --ablate tone,half-pixel --out explained\n"
        "  etalon study study.yaml --shard 2/5 --out part-2\n");
    sub->add_option("STUDY", arguments->study, "study.yaml: camera, poses, detectors")
        ->type_name("");
    sub->add_option("--out", arguments->out, "folder for results and report")->type_name("DIR");
    sub->add_option("--ablate", arguments->ablate, "also with each of these switched")
        ->type_name("NAME,...");
    sub->add_option("--shard", arguments->shard, "only part I of N: every N-th pose")
        ->type_name("I/N");
    add_study_merge(*sub, run);
    // What a study needs `merge` does not, so CLI11 cannot require it.
    sub->callback([sub, arguments, &run] {
        if (!sub->get_subcommands().empty())
            return;
        if (arguments->study.empty())
            throw CLI::RequiredError("STUDY");
        if (arguments->out.empty())
            throw CLI::RequiredError("--out");
        run = [arguments] { return run_study_command(*arguments); };
    });
}

}  // namespace

void add_metrology_commands(CLI::App& app, Run& run) {
    add_register_command(app, run);
    add_expect_command(app, run);
    add_study_command(app, run);
}

}  // namespace etalon
