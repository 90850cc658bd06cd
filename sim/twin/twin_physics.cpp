#include "sim/twin/twin_physics.h"

#include "core/program/errors.h"

namespace etalon {

CameraModel with_errors(const CameraModel& told, const CameraErrors& errors) {
    CameraModel camera = told;
    camera.intrinsics.zoom(1.0 + errors.focal_length_percent / 100.0);
    camera.intrinsics.cx += errors.principal_point_px.x();
    camera.intrinsics.cy += errors.principal_point_px.y();
    camera.distortion.k1 *= 1.0 + errors.k1_percent / 100.0;
    return camera;
}

TwinPhysics::TwinPhysics(const CameraModel& true_camera, TwinScene scene, RenderMethod method,
                         std::uint64_t noise_seed)
    : renderer_(true_camera),
      sensor_(true_camera),
      scene_(std::move(scene)),
      noise_seed_(noise_seed) {
    options_.method = method;
    // Sampled frames: 0.3 gray of independent pixel noise stays far below any sensor's own.
    if (method == RenderMethod::reference)
        options_.tolerance_gray = 0.3;
}

Radiance TwinPhysics::radiance(const Rigid& base_from_carriage) const {
    const Rigid camera_from_marker =
        scene_.camera_from_base * base_from_carriage * scene_.carriage_from_marker;
    const Scene seen{{{scene_.marker, camera_from_marker}}, scene_.background};
    if (auto radiance = attempted([&] { return renderer_.render(seen, options_).radiance; }))
        return *radiance;
    return Radiance(camera().height, camera().width, CV_32FC1, cv::Scalar(scene_.background));
}

CodeImage TwinPhysics::expose(const Radiance& radiance, double exposure,
                              std::uint32_t frame) const {
    return sensor_.expose(radiance * exposure, NoiseKey{noise_seed_, frame});
}

}  // namespace etalon
