// render CAMERA PICTURE: an AprilTag of 80 mm as the camera sees it, its sensor's noise included.
#include <etalon/render.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    if (argc != 3)
        return std::puts("usage: render CAMERA PICTURE"), 3;
    const etalon::CameraModel camera = etalon::read_camera(argv[1]);
    const etalon::Marker tag = etalon::parse_marker("apriltag:36h11:5@80mm", "the tag");

    // Tilted, and 400 mm away: a rotation vector (rad) and a translation (mm).
    const etalon::Vector6d pose{0.3, -0.2, 0.1, 20.0, -10.0, 400.0};
    const etalon::Scene scene{{{tag.grid, etalon::rigid_from_vector(pose)}}};

    const etalon::RenderedImage rendering = etalon::Renderer(camera).render(scene);
    const double exposure = 0.8;  // white at 80 % of full scale
    const etalon::NoiseKey noise{.seed = 7};
    const etalon::SensorModel sensor(camera);
    etalon::write_image(argv[2], sensor.expose(exposure * rendering.radiance, noise));
    std::printf("%s\n", rendering.plan.describe().c_str());
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "render: %s\n", error.what());
    return 3;
}
