// calibrate CAMERA TARGET PHOTO...: the camera's intrinsics from photographs of a board, to CAMERA.
#include <etalon/calibrate.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    if (argc < 6)
        return std::puts("usage: calibrate CAMERA TARGET PHOTO PHOTO PHOTO..."), 3;
    const auto target = etalon::parse_calibration_target(argv[2], "TARGET");
    std::vector<etalon::CalibrationView> views;
    cv::Size size;
    for (int i = 3; i < argc; ++i) {
        const etalon::CodeImage photo = etalon::read_image(argv[i]);
        size = photo.pixels.size();
        if (auto view = etalon::observe(target, photo).view)
            views.push_back(std::move(*view));
    }

    const etalon::CameraCalibration result = etalon::calibrate_camera(views, size);
    etalon::write_camera(argv[1], result.camera);
    std::printf("%s model from %zu photos: %.3f px RMS\n", result.model.name.c_str(), views.size(),
                result.rms_px);
    for (const etalon::ParameterDeviation& parameter : result.deviations)
        std::printf("%s +- %.4g\n", parameter.name.c_str(), parameter.formal);
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "calibrate: %s\n", error.what());
    return 3;
}
