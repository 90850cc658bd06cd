// detect CAMERA MARKER PHOTO: the marker's corners, and its pose from them.
#include <etalon/detect.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    if (argc != 4)
        return std::puts("usage: detect CAMERA MARKER PHOTO"), 3;
    const etalon::CameraModel camera = etalon::read_camera(argv[1]);
    const etalon::Marker marker = etalon::parse_marker(argv[2], "MARKER");
    const auto detector = etalon::make_detector("auto", marker, "MARKER");

    const etalon::PhotoPose found =
        etalon::find_marker(argv[3], etalon::read_photo(argv[3], camera, argv[1]), *detector,
                            etalon::Projector(camera), marker);
    if (!found.estimate)
        return std::printf("%s\n", found.failure.c_str()), 1;

    for (const Eigen::Vector2d& pixel : found.corners->pixels)
        std::printf("corner %.3f %.3f px\n", pixel.x(), pixel.y());
    const Eigen::Vector3d position = found.estimate->camera_from_marker.translation;
    std::printf("marker at %.2f %.2f %.2f mm\n", position.x(), position.y(), position.z());
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "detect: %s\n", error.what());
    return 3;
}
