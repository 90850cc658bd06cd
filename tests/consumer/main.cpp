// Renders a tag with the installed library; exit 0 when the picture has the camera's size and shows
// something.
#include <opencv2/core.hpp>

#include "sim/marker/marker.h"
#include "sim/render/renderer.h"

int main() {
    etalon::CameraModel camera;
    camera.width = 64;
    camera.height = 48;
    camera.intrinsics = {60.0, 60.0, 31.5, 23.5};
    const etalon::Marker marker = etalon::parse_marker("apriltag:36h11:5@50mm", "consumer");
    const etalon::Rigid camera_from_marker{Eigen::Quaterniond::Identity(), {0.0, 0.0, 120.0}};
    const etalon::Radiance image =
        etalon::Renderer(camera).render({{{marker.grid, camera_from_marker}}}).radiance;
    double darkest = 1.0;
    cv::minMaxLoc(image, &darkest);
    return image.cols == 64 && image.rows == 48 && darkest < 0.5 ? 0 : 1;
}
