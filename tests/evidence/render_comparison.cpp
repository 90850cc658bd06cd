#include "tests/evidence/render_comparison.h"

#include "calib/projector.h"

namespace etalon {

double RenderComparison::corrected_rms_gray() const {
    return std::sqrt(std::max(0.0, rms_gray * rms_gray - reference_rms_gray * reference_rms_gray));
}

std::vector<cv::Rect> comparison_windows(const BenchmarkScene& scene, int side) {
    // In cells of the tag: the black square's corner and edge, cells inside, its other corner, the
    // background beside it and far away.
    const Eigen::Vector2d places[] = {{1.0, 1.0}, {6.2, 1.0},  {4.0, 5.0},
                                      {9.0, 9.0}, {5.0, 10.6}, {-6.0, 3.0}};
    const cv::Rect image(0, 0, scene.camera.width - side, scene.camera.height - side);
    const Projector projector(scene.camera);
    const Eigen::Vector3d centre = scene.scene.markers[0].camera_from_marker.translation;
    std::vector<cv::Rect> windows;
    for (const Eigen::Vector2d& place : places) {
        Eigen::Vector3d p = scene.scene.markers[0].camera_from_marker *
                            scene.scene.markers[0].grid.point_mm(place.x(), place.y());
        auto pixel = projector.project(p);
        const auto inside = [&] {
            return pixel && image.contains(cv::Point(static_cast<int>(pixel->x()) - side / 2,
                                                     static_cast<int>(pixel->y()) - side / 2));
        };
        while (!inside()) {  // towards the tag's centre, which is in the image
            p = centre + 0.9 * (p - centre);
            pixel = projector.project(p);
        }
        windows.emplace_back(static_cast<int>(pixel->x()) - side / 2,
                             static_cast<int>(pixel->y()) - side / 2, side, side);
    }
    return windows;
}

RenderComparison compare_with_reference(const BenchmarkScene& scene, int side,
                                        const ReferenceOptions& reference,
                                        const RenderOptions& options) {
    const RenderedImage image = Renderer(scene.camera).render(scene.scene, options);
    std::vector<cv::Point> pixels;
    for (const cv::Rect& window : comparison_windows(scene, side))
        for (int i = 0; i < window.area(); ++i)
            pixels.emplace_back(window.x + i % side, window.y + i / side);
    const auto truth = integrate_reference(scene.camera, scene.scene, pixels, reference);

    RenderComparison result;
    result.plan = image.plan;
    result.pixels = static_cast<int>(pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i) {
        const double error = 255.0 * (image.radiance.at<float>(pixels[i]) - truth[i].mean);
        const double sigma = 255.0 * truth[i].standard_error;
        result.rms_gray += error * error;
        result.reference_rms_gray += sigma * sigma;
        result.reference_fourth += sigma * sigma * sigma * sigma / result.pixels;
        result.max_gray = std::max(result.max_gray, std::abs(error));
        if (std::abs(error) > 0.1)
            result.max_sigmas = std::max(result.max_sigmas, (std::abs(error) - 0.1) / sigma);
    }
    result.rms_gray = std::sqrt(result.rms_gray / result.pixels);
    result.reference_rms_gray = std::sqrt(result.reference_rms_gray / result.pixels);
    return result;
}

}  // namespace etalon
