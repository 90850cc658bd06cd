// `etalon calibrate`: intrinsics from photographs of a target, and what they can predict.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "calib/intrinsics/calibration_outliers.h"
#include "calib/intrinsics/camera_consistency.h"
#include "core/file/file_writing.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "station/calibrate/calibrate_help.txt.h"
#include "station/calibrate/calibration_report.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"
#include "station/shell/photo_files.h"

namespace etalon {
namespace {

// The short form of a chessboard, or any target.
std::string target_spec(const CalibrateArguments& arguments) {
    if (!arguments.target.empty())
        return arguments.target;
    if (arguments.board.empty())
        throw ConfigError({"--target", 0, ""}, "or --board with --square-mm is required");
    return fmt::format("chessboard:{}@{}mm", arguments.board, exact(arguments.square_mm));
}

// Photographs of one size, and what is seen of the target in them.
struct Observations {
    cv::Size image_size;
    CalibrationRun run;  // without the calibration; the target where the photos show another layout
};

// One camera's photos are those that most of a set are.
constexpr double least_share_of_one_camera = 0.6;

void add_photo(const CalibrationTarget& target, const std::string& spec, const std::string& photo,
               const CodeImage& image, CalibrationRun& run) {
    ObservedTarget seen = observe(target, image);
    if (!seen.view) {
        run.without_target.push_back(photo);
        print_stderr("{}: no {} found: not used{}{}\n", photo, spec,
                     seen.reason.empty() ? "" : "; ", seen.reason);
        return;
    }
    run.photos.push_back(photo);
    run.views.push_back(std::move(*seen.view));
    if (!seen.shown_as.empty())
        run.target = seen.shown_as;
}

// One camera's photos have one size: those that most of them have. The others are named.
Observations of_one_size(std::vector<Observations> groups) {
    const auto count = [](const Observations& group) {
        return group.run.photos.size() + group.run.without_target.size();
    };
    const auto pixels_of = [](const Observations& group) {
        return fmt::format("{}x{} px", group.image_size.width, group.image_size.height);
    };
    const auto largest = std::ranges::max_element(groups, {}, count);
    std::size_t all = 0;
    std::vector<std::string> others;
    for (const Observations& group : groups) {
        all += count(group);
        if (&group == &*largest)
            continue;
        std::vector<std::string> names = group.run.photos;
        names.insert(names.end(), group.run.without_target.begin(), group.run.without_target.end());
        others.push_back(fmt::format("{}: {}", pixels_of(group), fmt::join(names, ", ")));
    }
    if (!others.empty() &&
        static_cast<double>(count(*largest)) < least_share_of_one_camera * double(all))
        throw ConfigError(
            {"PHOTOS"}, fmt::format("are of several sizes, so of several cameras or resolutions: "
                                    "{} photos of {}; {}",
                                    count(*largest), pixels_of(*largest), fmt::join(others, "; ")));
    for (const std::string& other : others)
        print_stderr("not used, as most photos have {}; {}\n", pixels_of(*largest), other);
    return std::move(*largest);
}

Observations observe_all(const CalibrationTarget& target, const std::string& spec,
                         const std::vector<std::filesystem::path>& photos) {
    std::vector<Observations> groups;
    std::map<std::string, std::string> by_content;
    for (const auto& photo : photos) {
        const auto [first, is_new] = by_content.emplace(sha256_of_file(photo), photo.string());
        if (!is_new) {  // of a camera that was frozen: it would count as one more view
            print_stderr("not used: {} is the same picture as {}\n", photo.string(), first->second);
            continue;
        }
        const CodeImage image = read_image(photo);
        auto group = std::ranges::find(groups, image.pixels.size(), &Observations::image_size);
        if (group == groups.end())
            group = groups.insert(group, Observations{.image_size = image.pixels.size()});
        add_photo(target, spec, photo.string(), image, group->run);
    }
    Observations observations = of_one_size(std::move(groups));
    if (observations.run.views.size() < 3)
        throw ConfigError(
            {"PHOTOS"}, fmt::format("the target {} was found in {} of {} photos; three are needed",
                                    spec, observations.run.views.size(), photos.size()));
    return observations;
}

std::string in_words(const CameraGroup& group, const CameraGroup& most,
                     const std::vector<std::string>& photos, bool is_telecentric) {
    constexpr double deviations = 3.0;
    std::vector<std::string> names;
    for (const std::size_t view : group.views)
        names.push_back(short_name(photos[view]));
    const auto focal = [&](const CameraGroup& of) {
        return fmt::format("{} +- {} px{}", with_uncertainty(of.focal_px, of.deviation_px),
                           with_uncertainty(of.deviation_px, of.deviation_px),
                           is_telecentric ? "/mm" : "");
    };
    const std::string size = is_telecentric ? "magnification" : "focal length";
    const bool zoomed = std::abs(group.focal_px - most.focal_px) >
                        deviations * std::hypot(group.deviation_px, most.deviation_px);
    const bool one = names.size() == 1;
    return fmt::format(
        "photo{} {} {} not share the others' {}: {} against {}; another zoom, focus or camera, "
        "calibrate {} apart",
        one ? "" : "s", fmt::join(names, ", "), one ? "does" : "do",
        zoomed ? size : "image centre or distortion, though about their " + size, focal(group),
        focal(most), one ? "it" : "them");
}

// Takes out photos of another zoom, focus or camera; throws where the camera's are not clear.
void keep_one_camera(CalibrationRun& run, const cv::Size& image_size, bool is_telecentric) {
    const auto groups = camera_groups(run.views, image_size, is_telecentric);
    if (groups.size() == 1)
        return;
    for (auto group = groups.begin() + 1; group != groups.end(); ++group) {
        run.others.in_words += run.others.in_words.empty() ? "" : "; ";
        run.others.in_words += in_words(*group, groups.front(), run.photos, is_telecentric);
        for (const std::size_t view : group->views)
            run.others.photos.push_back(run.photos[view]);
    }
    const auto& kept = groups.front().views;
    if (double(kept.size()) < least_share_of_one_camera * double(run.views.size()))
        throw NumericalError("these photos are of several cameras: " + run.others.in_words);
    std::vector<std::string> photos;
    std::vector<CalibrationView> views;
    for (const std::size_t view : kept) {
        photos.push_back(run.photos[view]);
        views.push_back(std::move(run.views[view]));
    }
    run.photos = std::move(photos);
    run.views = std::move(views);
}

// Says which photo a view was: errors of the calibration count views from 0.
CameraCalibration calibrate_photos(const CalibrationRun& run, const cv::Size& image_size,
                                   const std::optional<std::string>& model, bool fit_board) {
    try {
        return calibrate_camera(run.views, image_size, {.model = model, .fit_board = fit_board});
    } catch (const NumericalError& error) {
        const std::string what = error.what();
        if (what.find("view ") == std::string::npos)
            throw;
        std::string views;
        for (std::size_t i = 0; i < run.photos.size(); ++i)
            views += fmt::format("{}{} {}", i > 0 ? ", " : "", i, short_name(run.photos[i]));
        throw NumericalError(what + "; the views are " + views);
    }
}

bool names_telecentric_model(const CalibrateArguments& arguments) {
    return arguments.model != "auto" &&
           calibration_model(arguments.model).projection == Projection::telecentric;
}

// Before a photo is read.
void refuse_what_does_not_go_together(const CalibrateArguments& arguments) {
    if (!names_telecentric_model(arguments))
        return;
    if (arguments.fit_board)
        throw ConfigError({"--fit-board"},
                          "does not go with a telecentric model: such a camera does not tell a "
                          "height, or a tilt, from its opposite");
    if (!arguments.refine.empty())
        throw ConfigError({"--refine"},
                          "does not go with a telecentric model: it needs rays from one point");
}

CalibrationRun calibrated(const CalibrateArguments& arguments) {
    const std::string spec = target_spec(arguments);
    const CalibrationTarget target =
        parse_calibration_target(spec, arguments.target.empty() ? "--board" : "--target");
    std::optional<std::string> model;
    if (arguments.model != "auto")
        model = calibration_model(arguments.model).name;
    auto [image_size, run] = observe_all(target, spec, arguments.photos);
    keep_one_camera(run, image_size, names_telecentric_model(arguments));
    run.views = with_circle_centres(target, run.views, image_size, model);
    run.calibration = calibrate_photos(run, image_size, model, arguments.fit_board);
    if (run.target.empty())
        run.target = spec;
    else
        print_stderr("the board that is seen is {}: taken as that\n", run.target);
    run.camera_file = arguments.out;
    return std::move(run);
}

// The views and corners that were used, with the photographs they are from.
PhotometricRefinement photometric_refinement(const CalibrationRun& run) {
    const CameraCalibration& calibration = run.calibration;
    std::vector<CodeImage> photos;
    std::vector<CalibrationView> views;
    CameraStart start{calibration.camera, {}};
    for (std::size_t i = 0; i < run.views.size(); ++i) {
        if (!calibration.views[i].used())
            continue;
        photos.push_back(read_image(run.photos[i]));
        views.push_back(without_points(run.views[i], calibration.views[i].left_out));
        start.camera_from_target.push_back(*calibration.views[i].camera_from_target);
    }
    const CalibrationTarget target = parse_calibration_target(run.target, "--target");
    const CameraFit corners =
        fit_camera(views, {calibration.camera.width, calibration.camera.height}, calibration.model,
                   {.start = start});
    return refine_photometrically(photos, views, target.board.grid,
                                  compared_area(target.board, {}, "--target"), corners,
                                  calibration.model);
}

void write_report(const CalibrationRun& run, const std::filesystem::path& folder) {
    ReportFolder report(folder, "calibrate");
    write_text(report / "calibration.json", calibration_json(run) + "\n");
    write_corners_csv(report / "corners.csv", run);
    if (run.calibration.board)
        write_board_csv(report / "board.csv", *run.calibration.board);
    write_text(report / "report.html", calibration_html(run));
    report.finish();
}

void print_words(const CalibrationRun& run, const std::filesystem::path& report) {
    const CameraCalibration& calibration = run.calibration;
    fmt::print("RMS {:.3f} px\n", calibration.rms_px);
    if (calibration.leave_one_out_rms_px)
        fmt::print("leave-one-out {:.3f} px over {} photos\n", *calibration.leave_one_out_rms_px,
                   photos_used(calibration));
    fmt::print("model {}\n", calibration.model.name);
    if (calibration.board)
        fmt::print("board {}\n", board_in_words(*calibration.board));
    if (run.refinement)
        fmt::print("photometric refinement {}\n", run.refinement->in_words());
    print_report(report);
}

}  // namespace

// Nothing is written when the photos hold no calibration.
int run_calibrate(const CalibrateArguments& given) {
    refuse_what_does_not_go_together(given);
    const PhotoFiles files(given.photos);
    CalibrateArguments arguments = given;
    arguments.photos = files.paths();
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    auto attempt = attempted([&] { return calibrated(arguments); });
    if (!attempt) {
        print_stderr("etalon: {}\n", attempt.cause);
        return ExitCode::inconclusive;
    }
    CalibrationRun& run = *attempt;
    if (arguments.refine == "photometric")
        run.refinement = photometric_refinement(run);
    print_stderr("{}", calibration_tables(run));
    for (const std::string& remark : calibration_remarks(run))
        print_stderr("\n{}", wrapped_text("", remark, 80));
    write_camera(arguments.out, run.camera());
    if (!arguments.report.empty())
        write_report(run, arguments.report);
    if (!arguments.opencv_out.empty())  // last: not every wide lens has a place there
        write_foreign_camera(arguments.opencv_out, CalibrationTool::opencv, run.camera());
    if (arguments.json)
        std::puts(calibration_json(run).c_str());
    else
        print_words(run, arguments.report);
    return 0;
}

void declare_calibrate(Command& program) {
    auto [command, asked] =
        program.add(run_calibrate, "calibrate", "estimate intrinsics from photographs of a target",
                    calibrate_help_txt);
    command.required("PHOTOS", asked->photos, "three or more photographs of the target");
    const Option target =
        command.option("--target", asked->target, "what was photographed, see below", "T");
    const Option board =
        command
            .option("--board", asked->board,
                    "short for a chessboard: inner corners,\ncolumns x rows: 9x6", "CxR")
            .excludes(target);
    const Option square =
        command.option("--square-mm", asked->square_mm, "side of its squares", "MM")
            .positive()
            .needs(board);
    board.needs(square);
    command.option("--model", asked->model, "auto (default) or a name, see below", "NAME");
    const Option refine =
        command
            .option("--refine", asked->refine,
                    "photometric: fit all pixels, if held-out\nphotos show a gain", "HOW")
            .one_of({"photometric"});
    command.flag("--fit-board", asked->fit_board, "the board's shape, too: bow, twist, points")
        .excludes(refine);
    command.required("--out", asked->out, "camera.yml to write", "FILE");
    command.option("--opencv-out", asked->opencv_out, "the same as OpenCV YAML", "FILE");
    command.option("--report", asked->report, "folder for report, JSON and corners", "DIR");
}

}  // namespace etalon
