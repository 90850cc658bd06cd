// `etalon calibrate`: intrinsics from photographs of a chessboard, with what the calibration can
// and cannot predict.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "calib/calibrate.h"
#include "calib/camera_file.h"
#include "calib/opencv_file.h"
#include "compare/chessboard_corners.h"
#include "core/errors.h"
#include "core/text.h"
#include "sim/marker.h"
#include "station/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

struct Observations {
    cv::Size image_size;
    std::vector<std::string> photos;  // one per view
    std::vector<CalibrationView> views;
    std::vector<std::string> without_board;
};

CodeImage read_photo_of_size(const std::filesystem::path& photo, const std::string& first,
                             cv::Size& size) {
    CodeImage image = read_image(photo);
    if (size.empty())
        size = image.pixels.size();
    if (image.pixels.size() != size)
        throw ConfigError(
            {photo.string()},
            fmt::format("has {}x{} pixels, but {} has {}x{}: one camera's photos have "
                        "one size",
                        image.pixels.cols, image.pixels.rows, first, size.width, size.height));
    return image;
}

Observations observe(const Marker& board, const std::vector<std::filesystem::path>& photos) {
    Observations observations;
    std::set<std::filesystem::path> seen;
    for (const auto& photo : photos) {
        if (!seen.insert(photo.lexically_normal()).second)
            throw ConfigError({photo.string()}, "is given twice");
        const CodeImage image =
            read_photo_of_size(photo, photos.front().string(), observations.image_size);
        const auto corners = find_chessboard_corners(image, board.columns, board.rows);
        if (!corners) {
            observations.without_board.push_back(photo.string());
            fmt::print(stderr, "{}: no board of {}x{} inner corners found: not used\n",
                       photo.string(), board.columns, board.rows);
            continue;
        }
        observations.photos.push_back(photo.string());
        observations.views.push_back({board.points_mm, corners->pixels});
    }
    if (observations.views.size() < 3)
        throw ConfigError({"PHOTOS"},
                          fmt::format("the board was found in {} of {} photos; three are "
                                      "needed",
                                      observations.views.size(), photos.size()));
    return observations;
}

ordered_json parameters_json(const CameraCalibration& calibration) {
    const Intrinsics& i = calibration.camera.intrinsics;
    const Distortion& d = calibration.camera.distortion;
    const std::map<std::string, double> values{{"fx", i.fx}, {"fy", i.fy}, {"cx", i.cx},
                                               {"cy", i.cy}, {"k1", d.k1}, {"k2", d.k2},
                                               {"p1", d.p1}, {"p2", d.p2}, {"k3", d.k3}};
    ordered_json json;
    for (const ParameterDeviation& deviation : calibration.deviations) {
        ordered_json& entry = json[deviation.name];
        entry["value"] = values.at(deviation.name);
        entry["standard_deviation"] = {{"formal", deviation.formal},
                                       {"cluster_robust", deviation.cluster_robust}};
        if (deviation.jackknife)
            entry["standard_deviation"]["jackknife"] = *deviation.jackknife;
    }
    return json;
}

ordered_json photos_json(const Observations& observations, const CameraCalibration& calibration) {
    ordered_json json = ordered_json::array();
    for (std::size_t i = 0; i < calibration.views.size(); ++i) {
        const CalibratedView& view = calibration.views[i];
        const Vector6d pose = vector_from_rigid(view.camera_from_target);
        ordered_json entry = {{"photo", observations.photos[i]},
                              {"rms_px", view.rms_px},
                              {"camera_from_board", std::vector<double>(pose.begin(), pose.end())}};
        if (view.left_out_rms_px)
            entry["left_out_rms_px"] = *view.left_out_rms_px;
        json.push_back(entry);
    }
    return json;
}

void print_json(const CalibrateArguments& arguments, const Observations& observations,
                const CameraCalibration& calibration) {
    ordered_json json = {
        {"etalon", "calibration/1"},
        {"board", arguments.board},
        {"square_mm", arguments.square_mm},
        {"image",
         {{"width", observations.image_size.width}, {"height", observations.image_size.height}}},
        {"rms_px", calibration.rms_px}};
    if (calibration.leave_one_out_rms_px)
        json["leave_one_out_rms_px"] = *calibration.leave_one_out_rms_px;
    json["parameters"] = parameters_json(calibration);
    json["photos"] = photos_json(observations, calibration);
    json["photos_without_board"] = observations.without_board;
    std::puts(json.dump(2).c_str());
}

void print_words(const CameraCalibration& calibration) {
    fmt::print("RMS {:.3f} px\n", calibration.rms_px);
    if (calibration.leave_one_out_rms_px)
        fmt::print("leave-one-out {:.3f} px over {} photos\n", *calibration.leave_one_out_rms_px,
                   calibration.views.size());
}

// What a reader should know before trusting the result.
void print_remarks(const Observations& observations, const CameraCalibration& calibration) {
    for (std::size_t i = 0; i < calibration.views.size(); ++i) {
        const CalibratedView& view = calibration.views[i];
        const std::string left_out =
            view.left_out_rms_px ? fmt::format(", left out {:.3f} px", *view.left_out_rms_px) : "";
        fmt::print(stderr, "{}: {:.3f} px{}\n", observations.photos[i], view.rms_px, left_out);
    }
    for (const ParameterDeviation& deviation : calibration.deviations)
        fmt::print(stderr, "standard deviation of {}: {:.3g} (formal {:.3g})\n", deviation.name,
                   deviation.largest(), deviation.formal);
    if (!calibration.leave_one_out_rms_px)
        fmt::print(stderr, "no leave-one-out error: it needs four photos with the board\n");
    else if (*calibration.leave_one_out_rms_px > 1.5 * calibration.rms_px)
        fmt::print(stderr,
                   "the model follows these photos rather than the lens (leave-one-out error far "
                   "above the fit): take more photos, tilted and up to the image's corners\n");
}

}  // namespace

int run_calibrate(const CalibrateArguments& arguments) {
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    const Marker board = parse_marker(
        fmt::format("chessboard:{}@{}mm", arguments.board, exact(arguments.square_mm)), "--board");
    const Observations observations = observe(board, arguments.photos);
    const CameraCalibration calibration =
        calibrate_camera(observations.views, observations.image_size);
    print_remarks(observations, calibration);
    if (!arguments.out.empty())
        write_camera(arguments.out, calibration.camera);
    if (!arguments.opencv_out.empty())
        write_opencv_camera(arguments.opencv_out, calibration.camera);
    if (arguments.json)
        print_json(arguments, observations, calibration);
    else
        print_words(calibration);
    return 0;
}

}  // namespace etalon
