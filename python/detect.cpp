// etalon.detect, estimate_pose, PhotometricDetector: where a marker is, from a photograph of it.

#include "compare/make_detector.h"
#include "compare/photo_pose.h"
#include "compare/photometric/photometric_detector.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/interruptible.h"

namespace etalon {
namespace {

// A detector with its marker. Several of Python's threads may have it: they take turns.
class SharedDetector {
public:
    SharedDetector(const Marker& marker, const std::string& name)
        : marker_(marker), detector_(make_detector(name, marker, "detector")) {}

    const std::string& name() const { return detector_->name(); }

    PhotoPose detect(const CodeImage& photo, const Projector* camera) {
        const std::lock_guard turn(mutex_);
        if (camera)
            return find_marker("photo", photo, *detector_, *camera, marker_);
        const Detection seen = detector_->detect(photo);
        return {"photo", seen.reason, seen.corners, {}, seen.shown_as};
    }

private:
    Marker marker_;
    std::mutex mutex_;
    std::unique_ptr<Detector> detector_;
};

PhotoPose detect_with(SharedDetector& detector, const py::array& photo, const Projector* camera) {
    const CodeImage image =
        camera ? photo_of(photo, camera->camera(), "photo") : code_image(photo, "photo");
    return without_gil([&] { return detector.detect(image, camera); });
}

PhotoPose detect(const py::array& photo, const Marker& marker, const Projector* camera,
                 const std::string& detector) {
    SharedDetector one(marker, detector);
    return detect_with(one, photo, camera);
}

py::object corners(const PhotoPose& found) {
    return found.corners ? py::object(array_of(found.corners->pixels)) : py::none();
}

// Indices of the marker's points that were seen.
py::object points(const PhotoPose& found) {
    if (!found.corners)
        return py::none();
    std::vector<std::int64_t> seen(found.corners->points.begin(), found.corners->points.end());
    for (std::size_t i = 0; found.corners->is_whole() && i < found.corners->pixels.size(); ++i)
        seen.push_back(static_cast<std::int64_t>(i));
    return py::array_t<std::int64_t>(static_cast<py::ssize_t>(seen.size()), seen.data());
}

std::optional<PoseEstimate> pose_from(const Projector& camera, const py::object& points_mm,
                                      const py::object& pixels) {
    const auto points = point_list(points_mm, "points_mm");
    const auto seen = pixel_list(pixels, "pixels");
    if (seen.size() != points.size())
        throw ConfigError({"pixels"}, "must be as many as points_mm");
    return without_gil([&] { return estimate_pose(camera, points, seen); });
}

PhotometricPose find(const PhotometricDetector& detector, const py::array& photo,
                     const py::object& start, double start_error_px) {
    const CodeImage image = photo_of(photo, detector.camera()->model(), "photo");
    const Rigid near = rigid_of(start, "start");
    return without_gil([&] { return detector.find(image, near, start_error_px); });
}

void bind_estimate(Module& module) {
    Bound<PoseEstimate>(module, "PoseEstimate",
                        "A pose from corners, with the other planar solution.")
        .get("camera_from_marker", "(4, 4), mm.", as_array(&PoseEstimate::camera_from_marker))
        .get("reprojection_rms_px", "RMS distance of the corners, px.",
             &PoseEstimate::reprojection_rms_px)
        .get("alternative", "(4, 4) of the other planar solution, or None.",
             as_array(&PoseEstimate::alternative))
        .get("alternative_rms_px", "Its RMS, px.", &PoseEstimate::alternative_rms_px)
        .get("covariance_per_px2",
             R"((6, 6): times sigma_px^2 of a corner's coordinate it is the covariance.

Rotation (rad), then translation (mm), left perturbation in the camera frame.)",
             as_array(&PoseEstimate::covariance_per_px2));
}

}  // namespace

void bind_detect(Module& module) {
    bind_estimate(module);
    Bound<PhotoPose>(module, "Detection", "A marker in one photograph, or why it is not there.")
        .get("found", "Whether it has corners.",
             [](const PhotoPose& p) { return p.corners.has_value(); })
        .get("reason", "Why there are no corners or no pose; else empty.", &PhotoPose::failure)
        .get("corners", "(N, 2), px, or None.", &corners)
        .get("points", "(N,): index into Marker.points_mm of each corner, or None.", &points)
        .get("pose", "PoseEstimate, or None: without a camera, or where the corners tell none.",
             &PhotoPose::estimate)
        .get("shown_as",
             "The marker's name where it is drawn otherwise than it was named; else empty.",
             &PhotoPose::shown_as);

    Bound<SharedDetector>(module, "Detector",
                          R"(A detector for one marker, for many photographs.

Threads that share one take turns: one detector per thread is faster.)")
        .init(
            [](const Marker& marker, const std::string& name) {
                return std::make_unique<SharedDetector>(marker, name);
            },
            "marker"_a, "name"_a = "auto",
            R"(name: auto, apriltag, aruco, topotag, chessboard, charuco, aprilgrid, circles, squares, stag.

Raises ConfigError when there is none or it cannot see the marker.)")
        .get("name", "apriltag, ...", &SharedDetector::name)
        .def("detect", &detect_with, "photo"_a, "camera"_a = py::none(), "As etalon.detect().");

    module.def("detect", &detect, "photo"_a, "marker"_a, "camera"_a = py::none(),
               "detector"_a = "auto",
               R"(The marker's corners in a photograph and, with a camera, its pose: a Detection.

photo: (height, width) uint8 or uint16, shared. A marker that is not found is no error: reason says
why. Raises ConfigError for a photograph of another size than the camera's.)");
    module.def(
        "estimate_pose", &pose_from, "camera"_a, "points_mm"_a, "pixels"_a,
        R"(A PoseEstimate from points (N, 3) of the marker's plane, mm, seen at pixels (N, 2).

None where they fix no pose in front of the camera. Raises NumericalError for a telecentric
camera.)");
}

void bind_photometric(Module& module) {
    Bound<PhotometricPose>(module, "PhotometricPose", "A pose from all of a marker's pixels.")
        .get("camera_from_marker", "(4, 4), mm.", as_array(&PhotometricPose::camera_from_marker))
        .get(
            "covariance",
            R"((6, 6): rotation (rad), then translation (mm), left perturbation in the camera frame.

What a wrong calibration or size of the print does is not in it.)",
            as_array(&PhotometricPose::covariance))
        .get("other", "(4, 4) of the other planar solution, or None.",
             [](const PhotometricPose& p) {
                 return array_of(p.other ? std::optional(p.other->camera_from_marker)
                                         : std::nullopt);
             })
        .get("log_likelihood_ratio",
             "Of the better pose to the other one, or None: beyond 20 there is no doubt.",
             [](const PhotometricPose& p) {
                 return p.other ? std::optional(p.other->log_likelihood_ratio) : std::nullopt;
             })
        .get("noise_scale", "Size of the residuals: in units of the camera's noise, or gray.",
             &PhotometricPose::noise_scale)
        .get("reduced_squares", "Mean square of the residuals; 1 for pure noise.",
             &PhotometricPose::reduced_squares)
        .get("pixels", "That were fitted.", &PhotometricPose::pixels)
        .get("converged", "Whether the fit converged.", &PhotometricPose::converged);

    Bound<PhotometricDetector>(module, "PhotometricDetector",
                               R"(Poses from all pixels of a marker or board, from a pose nearby.

Safe from every thread.)")
        .init(
            [](const Projector& camera, const Marker& marker, double background) {
                return without_gil([&] {
                    return PhotometricDetector(camera.camera(), marker, "marker", background);
                });
            },
            "camera"_a, "marker"_a, "background"_a = 1.0,
            R"(background: radiance beside the marker, whose white is 1.

Raises ConfigError, NumericalError.)")
        .def("find", &find, "photo"_a, "start"_a,
             "start_error_px"_a = PhotometricDetector::basin_px,
             R"(The PhotometricPose in a photograph.

photo: (height, width) uint8 or uint16, shared. start: a pose (4, 4) nearby, mm, a detector's or the
stage's; start_error_px: how far its edges may be off. Raises NumericalError where the photograph
does not show the marker there.)");
}

}  // namespace etalon
