// Files of cameras whose rows and columns do not meet at right angles.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "tests/calib/cameras.h"
#include "tests/error_text.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using testing::HasSubstr;

CameraModel skewed(Projection kind) {
    CameraModel camera =
        test::camera_with(700, 500, {611.5, 587.25, 361.0, 239.0, -2.125}, {.k1 = -0.3, .k2 = 0.1});
    camera.projection = {kind, kind == Projection::unified ? 1.25 : 0.0};
    return camera;
}

TEST(SkewedCameraFile, CarriesTheSkew) {
    const TemporaryFolder folder;
    CameraModel camera = skewed(Projection::perspective);
    camera.covariance = {{"fx", "skew"}, Eigen::Vector2d(0.25, 0.01).asDiagonal()};
    write_camera(folder / "camera.yml", camera);
    const CameraModel back = read_camera(folder / "camera.yml");
    EXPECT_EQ(back.intrinsics.skew, -2.125);
    EXPECT_EQ(back.covariance->order, camera.covariance->order);
    camera.intrinsics.skew = 0.0;
    camera.covariance = {};
    write_camera(folder / "camera.yml", camera);
    EXPECT_THAT(read_text(folder / "camera.yml"), Not(HasSubstr("skew")));
}

TEST(SkewedCameraFile, HasNoLens) {
    const TemporaryFolder folder;
    std::ofstream(folder / "camera.yml")
        << "etalon: camera/1\nimage: {width: 640, height: 480}\n"
           "intrinsics: {fx: 611, fy: 609, cx: 319.5, cy: 239.5, skew: 0.7}\n"
           "sensor: {pixel_pitch_um: 5}\n"
           "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650}\n";
    EXPECT_THAT(text_of_error<ConfigError>([&] { read_camera(folder / "camera.yml"); }),
                HasSubstr("camera.yml:5: lens: has no meaning where a skew is above 0.001 fx"));
}

TEST(SkewedCameraFile, OfAToolThatHasASkewReadsBack) {
    const TemporaryFolder folder;
    const auto path = folder / "camera.yml";
    for (const auto& [tool, kind] : {std::pair{CalibrationTool::matlab, Projection::perspective},
                                     {CalibrationTool::boofcv, Projection::perspective},
                                     {CalibrationTool::boofcv, Projection::unified},
                                     {CalibrationTool::opencv, Projection::equidistant},
                                     {CalibrationTool::opencv, Projection::unified}}) {
        SCOPED_TRACE(std::string(name_of(tool)) + " " + name_of(kind).name);
        write_foreign_camera(path, tool, skewed(kind));
        const CameraModel back = read_any_camera(path);
        EXPECT_EQ(back.intrinsics.skew, -2.125);
        EXPECT_EQ(back.intrinsics.fx, 611.5);
        EXPECT_EQ(back.intrinsics.fy, 587.25);
    }
    for (const auto& [tool, kind] : {std::pair{CalibrationTool::opencv, Projection::perspective},
                                     {CalibrationTool::ros, Projection::equidistant},
                                     {CalibrationTool::kalibr, Projection::perspective},
                                     {CalibrationTool::mrcal, Projection::perspective},
                                     {CalibrationTool::colmap, Projection::perspective}}) {
        SCOPED_TRACE(std::string(name_of(tool)) + " " + name_of(kind).name);
        EXPECT_THAT(
            text_of_error<ConfigError>([&] { write_foreign_camera(path, tool, skewed(kind)); }),
            HasSubstr("has no place for skew = -2.125"));
    }
}

TEST(SkewedCameraFile, IsReadFromEveryPlaceOfASkew) {
    const TemporaryFolder folder;
    const auto skew_of = [&](const std::string& text) {
        std::ofstream(folder / "camera") << text;
        return read_any_camera(folder / "camera", cv::Size(640, 480)).intrinsics.skew;
    };
    EXPECT_EQ(skew_of("%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n  rows: 3\n  cols: 3\n"
                      "  dt: d\n  data: [538., 7., 342., 0., 541., 233., 0., 0., 1.]\n"
                      "distortion_coefficients: [0., 0., 0., 0.]\n"),
              7.0);
    const std::string end = ",\"RadialDistortion\":[1,2]}";
    EXPECT_EQ(skew_of("{\"IntrinsicMatrix\":[[715,0,0],[0.5,711,0],[565,355,1]]" + end), 0.5);
    EXPECT_EQ(skew_of("{\"K\":[[715,0.5,565],[0,711,355],[0,0,1]],\"Skew\":0.5" + end), 0.5);
    EXPECT_EQ(skew_of("{\"FocalLength\":[715,711],\"PrincipalPoint\":[565,355],\"Skew\":0.5" + end),
              0.5);
}

}  // namespace
}  // namespace etalon
