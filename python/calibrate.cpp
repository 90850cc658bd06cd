// etalon.observe, calibrate, calibrate_camera: intrinsics from photographs of a board.
#include "calib/intrinsics/calibrate.h"

#include "calib/camera/projector.h"
#include "compare/detect/board/calibration_target.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/interruptible.h"

namespace etalon {
namespace {

ObservedTarget observe_in(const py::array& photo, const Marker& target) {
    const CodeImage image = code_image(photo, "photo");
    return without_gil([&] { return observe(calibration_target(target, "target"), image); });
}

CameraCalibration from_views(const std::vector<CalibrationView>& views,
                             const std::pair<int, int>& image_size,
                             const std::optional<std::string>& model, bool leave_one_out,
                             int resamples, bool fit_board) {
    CalibrationOptions options{model, leave_one_out, resamples, fit_board};
    return interruptible([&](std::stop_token stop) {
        options.stop = std::move(stop);
        return calibrate_camera(views, {image_size.first, image_size.second}, options);
    });
}

// Photographs without the board are left out; `views` of the result counts the others.
CameraCalibration from_photos(const std::vector<py::array>& photos, const Marker& target,
                              const std::optional<std::string>& model, bool leave_one_out,
                              int resamples, bool fit_board) {
    std::vector<CodeImage> images;
    for (const py::array& photo : photos)
        images.push_back(code_image(photo, "photos"));
    for (const CodeImage& image : images)
        if (image.pixels.size() != images.front().pixels.size())
            throw ConfigError({"photos"}, "must all have one size");
    CalibrationOptions options{model, leave_one_out, resamples, fit_board};
    return interruptible([&](std::stop_token stop) {
        options.stop = stop;
        const CalibrationTarget board = calibration_target(target, "target");
        std::vector<CalibrationView> views;
        for (const CodeImage& image : images) {
            throw_if_stopped(stop);
            if (auto view = observe(board, image).view)
                views.push_back(std::move(*view));
        }
        const cv::Size size = images.empty() ? cv::Size() : images.front().pixels.size();
        return calibrate_camera(with_circle_centres(board, views, size, model), size, options);
    });
}

py::dict deviations(const CameraCalibration& result) {
    py::dict all;
    for (const ParameterDeviation& parameter : result.deviations)
        all[parameter.name.c_str()] = parameter.stated;
    return all;
}

py::dict uncertainty(const CameraCalibration& result) {
    std::vector<Eigen::Vector2d> pixels;
    std::vector<double> held, rotated;
    for (const PixelUncertainty& place : result.uncertainty.pixels) {
        pixels.push_back(place.pixel);
        held.push_back(place.held);
        rotated.push_back(place.rotated);
    }
    return py::dict("pixels"_a = array_of(pixels), "held_px"_a = array_of(held),
                    "rotated_px"_a = array_of(rotated));
}

CalibrationView view_of(const py::object& points_mm, const py::object& pixels) {
    CalibrationView view{point_list(points_mm, "points_mm"), pixel_list(pixels, "pixels")};
    if (view.pixels.size() != view.points_mm.size())
        throw ConfigError({"pixels"}, "must be as many as points_mm");
    return view;
}

py::array_t<bool> left_out(const CalibratedView& view) {
    py::array_t<bool> flags(static_cast<py::ssize_t>(view.left_out.size()));
    std::copy(view.left_out.begin(), view.left_out.end(), flags.mutable_data());
    return flags;
}

void bind_views(Module& module) {
    Bound<CalibrationView>(module, "CalibrationView",
                           "Points of a planar target and where one photograph shows them.")
        .init(&view_of, "points_mm"_a, "pixels"_a,
              R"(points_mm: (N, 3) in the target's frame and plane z = 0, mm. pixels: (N, 2).)")
        .get("points_mm", "(N, 3), mm.", as_array(&CalibrationView::points_mm))
        .get("pixels", "(N, 2), px.", as_array(&CalibrationView::pixels))
        .get("ids", "Index of each point on the target; empty: 0, 1, ...", &CalibrationView::ids);

    Bound<ObservedTarget>(module, "ObservedTarget", "What a photograph shows of a board.")
        .get("view", "CalibrationView, or None.", &ObservedTarget::view)
        .get("reason", "Why there is no view; else empty.",
             [](const ObservedTarget& seen) {
                 return seen.view || !seen.reason.empty() ? seen.reason : "the board is not found";
             })
        .get("shown_as",
             "The board's name where it is drawn otherwise than it was named; else empty.",
             &ObservedTarget::shown_as);

    Bound<CalibratedView>(module, "CalibratedView", "A view in a calibration.")
        .get("camera_from_target", "(4, 4), mm, or None of a view that no pose explains.",
             as_array(&CalibratedView::camera_from_target))
        .get("residuals_px", "(N, 2): photograph minus model.",
             as_array(&CalibratedView::residuals_px))
        .get("left_out", "(N,) bool: points that did not fit.", &left_out)
        .get("used", "Whether the view was used.", &CalibratedView::used)
        .get("rms_px", "Over its points that were used.", &CalibratedView::rms_px);
}

}  // namespace

void bind_calibrate(Module& module) {
    bind_views(module);
    Bound<CameraCalibration>(module, "CameraCalibration",
                             "A camera's intrinsics, and what they are worth.")
        .get("camera", "Camera, with the stated covariance.",
             [](const CameraCalibration& result) { return Projector(result.camera); })
        .get("model", "pinhole, radial, standard, ...",
             [](const CameraCalibration& result) { return result.model.name; })
        .get("parameters", "Names of the free parameters, in the covariance's order.",
             [](const CameraCalibration& result) { return result.model.parameters; })
        .get("rms_px", "Over all points that were used.", &CameraCalibration::rms_px)
        .get("leave_one_out_rms_px", "Of views that were not calibrated from, or None.",
             &CameraCalibration::leave_one_out_rms_px)
        .get("overfits", "Whether a simpler model predicts better.", &CameraCalibration::overfits)
        .get("covariance", "(P, P), in the order of parameters.",
             [](const CameraCalibration& result) { return array_of(result.covariances.stated); })
        .get("deviations", "Standard deviation of each parameter, by its name.", &deviations)
        .get("uncertainty", R"(Of the projection: pixels (M, 2), held_px (M,), rotated_px (M,).

One standard deviation, px, with the camera held and after the best rotation.)",
             &uncertainty)
        .get("views", "CalibratedViews, in the order given.", &CameraCalibration::views);

    module.def("observe", &observe_in, "photo"_a, "target"_a,
               R"(A board's points in a photograph: an ObservedTarget.

photo: (height, width) uint8 or uint16, shared. target: a Marker that is a board. Raises ConfigError
for a target with too few points.)");
    const auto model = "model"_a = py::none();
    const auto leave_one_out = "leave_one_out"_a = true;
    const auto resamples = "resamples"_a = bootstrap_resamples;
    const auto fit_board = "fit_board"_a = false;
    module.def("calibrate", &from_photos, "photos"_a, "target"_a, py::kw_only(), model,
               leave_one_out, resamples, fit_board,
               R"(Intrinsics from photographs of a board: a CameraCalibration.

photos: three or more of (height, width) uint8 or uint16, of one size, shared; those that do not
show the board are left out. model: None takes the one that they support. resamples: of the bootstrap, 0
leaves it out. fit_board: the board's shape, too. Raises ConfigError, and NumericalError for
photographs that do not determine the camera.)");
    module.def("calibrate_camera", &from_views, "views"_a, "image_size"_a, py::kw_only(), model,
               leave_one_out, resamples, fit_board,
               R"(The same from CalibrationViews of observe(), or of your own points.

image_size: (width, height), px.)");
}

}  // namespace etalon
