#include "sim/render/scene_render.h"

#include <fmt/format.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

void check_background(const Radiance& background, const cv::Size& size) {
    if (background.type() != CV_32FC1 || background.size() != size)
        throw NumericalError(fmt::format("a background of {} x {} px for an image of {} x {} px",
                                         background.cols, background.rows, size.width,
                                         size.height));
    if (!cv::checkRange(background))
        throw NumericalError("the background's radiance is not finite everywhere");
}

// An error of C counts with the background's radiance.
RenderOptions with_shared_tolerance(RenderOptions options, const Radiance& background) {
    options.tolerance_gray /= 1.0 + cv::norm(background, cv::NORM_INF);
    return options;
}

}  // namespace

Radiance placed_over(const Radiance& markers, const Radiance& coverage,
                     const Radiance& background) {
    check_background(background, markers.size());
    check_background(coverage, markers.size());
    return markers + (background - background.mul(coverage));
}

Scene on_black(const Scene& scene) {
    return {scene.markers, 0.0};
}

Scene white_on_black(const Scene& scene) {
    Scene white = on_black(scene);
    for (auto& [grid, pose] : white.markers) {
        const Eigen::Vector2d cells(grid.columns(), grid.rows());
        grid = {cv::Mat(1, 1, CV_32FC1, cv::Scalar(1.0)), grid.corner_mm,
                grid.cell_mm.cwiseProduct(cells)};
    }
    return white;
}

RenderedImage render_over(const Renderer& renderer, const Scene& scene, const Radiance& background,
                          const RenderOptions& options) {
    const CameraModel& camera = renderer.camera();
    check_background(background, {camera.width, camera.height});
    const RenderOptions shared = with_shared_tolerance(options, background);
    RenderedImage image = renderer.render(on_black(scene), shared);
    const RenderedImage coverage = renderer.render(white_on_black(scene), shared);
    image.radiance = placed_over(image.radiance, coverage.radiance, background);
    return image;
}

Radiance background_from(const CodeImage& image, const SensorModel& sensor) {
    Radiance radiance = sensor.linear_radiance(image);
    const cv::Mat& response = sensor.relative_response();
    if (response.empty())
        return radiance;
    if (response.size() != radiance.size())
        throw NumericalError(fmt::format("an image of {} x {} px is not the camera's",
                                         radiance.cols, radiance.rows));
    cv::divide(radiance, response, radiance);
    return radiance;
}

}  // namespace etalon
