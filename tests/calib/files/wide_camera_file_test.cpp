// Files of cameras with wide lenses, or with rows and columns that do not meet at right angles:
// ours, and those of the tools that have them.

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(WideCameraFile, CarriesEveryProjection) {
    const TemporaryFolder folder;
    for (const LensProjection& projection : {LensProjection{Projection::equidistant},
                                             {Projection::stereographic},
                                             {Projection::field_of_view, 0.93},
                                             {Projection::unified, 1.83},
                                             {Projection::extended_unified, 1.13, 0.62},
                                             {Projection::double_sphere, -0.21, 0.57},
                                             polynomials()[1],
                                             cahvors()[0],
                                             cahvors()[4],
                                             splines()[0],
                                             splines()[1]}) {
        SCOPED_TRACE(name_of(projection.kind).name);
        CameraModel camera =
            camera_with(640, 480, {211, 209, 319.5, 239.5}, {.k1 = 0.1, .k7 = 0.02});
        camera.projection = projection;
        camera.sensor = Sensor{.pixel_pitch_um = 5};
        write_camera(folder / "wide.yml", camera);
        const CameraModel back = read_any_camera(folder / "wide.yml");
        EXPECT_EQ(back.projection, projection);
        EXPECT_EQ(back.distortion, camera.distortion);
        EXPECT_THAT(text_of_error<ConfigError>([&] { read_camera(folder / "wide.yml"); }),
                    HasSubstr("wide.yml: is of a lens that is"));
    }
}

TEST(WideCameraFile, RefusesWhatAWideLensCannotHave) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& lines) {
        return text_of_error<ConfigError>([&] {
            std::ofstream(folder / "wide.yml")
                << "etalon: camera/1\nimage: {width: 640, height: 480}\n"
                   "intrinsics: {fx: 211, fy: 209, cx: 319.5, cy: 239.5}\n" +
                       lines;
            read_any_camera(folder / "wide.yml");
        });
    };
    EXPECT_THAT(with("projection: unified\n"),
                HasSubstr("wide.yml:4: projection: needs its parameters: {unified: {xi: ...}}"));
    EXPECT_THAT(with("projection: {unified: {alpha: 1}}\n"),
                HasSubstr("projection.unified.xi: missing"));
    EXPECT_THAT(with("projection: {unified: {xi: 1, alpha: 1}}\n"), HasSubstr("unknown key"));
    EXPECT_THAT(with("projection: {double_sphere: {xi: -1, alpha: 0.5}}\n"),
                HasSubstr("wide.yml:4: projection: no double_sphere projection has"));
    EXPECT_THAT(with("projection: polynomial\n"),
                HasSubstr("wide.yml:4: projection: needs its parameters: {polynomial: {...}}"));
    EXPECT_THAT(with("projection: {polynomial: {a2: 1, a3: 0}}\n"),
                HasSubstr("projection.polynomial.a4: missing"));
    EXPECT_THAT(with("projection: {cahvor: {alpha: 2, beta: 0, r0: 0, r1: 0, r2: 0}}\n"),
                HasSubstr("wide.yml:4: projection: the axis of a CAHVOR lens must point forward"));
    EXPECT_THAT(with("projection: {splined_stereographic: {order: 3, columns: 5, rows: 4, "
                     "field_of_view_deg: 100, control_points: [1, 2]}}\n"),
                HasSubstr("wide.yml:4: projection.splined_stereographic.control_points: "));
    EXPECT_THAT(with("projection: {equidistant: {}}\n"), HasSubstr("wide.yml:4: projection"));
    EXPECT_THAT(with("projection: equidistant\ndistortion: {tau_x: 0.1}\n"),
                HasSubstr("wide.yml:5: distortion.tau_x: belongs to a perspective camera"));
    const std::string sensor = "projection: equidistant\nsensor: {pixel_pitch_um: 5}\n";
    EXPECT_THAT(with(sensor + "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650, "
                              "psf: wave}\n"),
                HasSubstr("wide.yml:6: lens.psf: wave belongs to a flat projection"));
    EXPECT_THAT(with("projection: equidistant\nsensor: {pixel_pitch_um: 5, "
                     "illumination: {cos4: true}}\n"),
                HasSubstr("cos4: belongs to a perspective camera"));
}

// Which projections each tool's files hold, and coefficients that they have there.
struct WideCase {
    CalibrationTool tool;
    LensProjection projection;
    Distortion distortion;
};

TEST(WideCameraFile, OfAnotherToolReadsBack) {
    const TemporaryFolder folder;
    using enum Projection;
    const Distortion kb{.k1 = 0.1, .k2 = -0.02, .k3 = 0.003, .k7 = -0.0004};
    const Distortion radtan{.k1 = -0.3, .k2 = 0.1, .p1 = 0.02, .p2 = 0.01};
    const Distortion prism{.k1 = 0.1, .p2 = 0.01, .s3 = 0.002, .k7 = 0.001};
    for (const WideCase& wide : {WideCase{CalibrationTool::opencv, {equidistant}, kb},
                                 {CalibrationTool::opencv, {unified, 1.1}, radtan},
                                 {CalibrationTool::ros, {equidistant}, kb},
                                 {CalibrationTool::kalibr, {equidistant}, kb},
                                 {CalibrationTool::kalibr, {field_of_view, 0.93}, {}},
                                 {CalibrationTool::kalibr, {unified, 0.71}, radtan},
                                 {CalibrationTool::kalibr, {extended_unified, 1.13, 0.62}, {}},
                                 {CalibrationTool::kalibr, {double_sphere, -0.21, 0.57}, {}},
                                 {CalibrationTool::colmap, {equidistant}, kb},
                                 {CalibrationTool::colmap, {equidistant}, prism},
                                 {CalibrationTool::colmap, {field_of_view, 0.93}, {}},
                                 {CalibrationTool::boofcv, {unified, 1.83}, radtan},
                                 {CalibrationTool::boofcv, {equidistant}, kb},
                                 {CalibrationTool::mrcal, {stereographic}, {}},
                                 {CalibrationTool::mrcal, cahvors()[0], {}},
                                 {CalibrationTool::mrcal, cahvors()[4], {}},
                                 {CalibrationTool::mrcal, splines()[0], {}},
                                 {CalibrationTool::mrcal, splines()[1], {}}}) {
        SCOPED_TRACE(std::string(name_of(wide.tool)) + " " + name_of(wide.projection.kind).name);
        CameraModel camera = camera_with(700, 500, {211.5, 207.25, 361.0, 239.0}, wide.distortion);
        camera.projection = wide.projection;
        const auto path = folder / "camera.yml";
        write_foreign_camera(path, wide.tool, camera);
        EXPECT_EQ(tool_of(path), wide.tool);
        const CameraModel back = read_any_camera(path);
        EXPECT_EQ(back.projection, camera.projection);
        EXPECT_EQ(back.distortion, camera.distortion);
        EXPECT_EQ(back.intrinsics.fy, camera.intrinsics.fy);
        EXPECT_NEAR(back.intrinsics.cx, camera.intrinsics.cx, 1e-13);
        EXPECT_THROW(read_camera(path), ConfigError);  // for flat ones only
        camera.distortion.k5 = 0.5;
        EXPECT_THROW(write_foreign_camera(folder / "camera.yml", wide.tool, camera), ConfigError);
        camera.distortion = {};
        camera.projection = {wide.tool == CalibrationTool::mrcal ? double_sphere : stereographic};
        EXPECT_THROW(write_foreign_camera(folder / "camera.yml", wide.tool, camera), ConfigError);
    }
}

TEST(WideCameraFile, OfMrcalIsRefusedByLineAndKey) {
    const TemporaryFolder folder;
    const auto with = [&](const std::string& model, const std::string& numbers) {
        return text_of_error<ConfigError>([&] {
            std::ofstream(folder / "lens.cameramodel")
                << "{\n  'lensmodel': 'LENSMODEL_" + model +
                       "',\n  'intrinsics': [200, 201, 319, 239" + numbers +
                       "],\n  'imagersize': [640, 480] }\n";
            read_any_camera(folder / "lens.cameramodel");
        });
    };
    const std::string splined = "SPLINED_STEREOGRAPHIC_order=3_";
    EXPECT_THAT(with(splined + "Nx=30", ""), HasSubstr("model:2: lensmodel: must say Ny="));
    EXPECT_THAT(with(splined + "Nx=30_Ny=x_fov_x_deg=9", ""), HasSubstr("say a number as Ny="));
    EXPECT_THAT(with(splined + "Nx=4.5_Ny=4_fov_x_deg=9", ""), HasSubstr("1 to 1000, not 4.5"));
    EXPECT_THAT(with(splined + "Nx=4_Ny=4_fov_x_deg=90", ", 1, 2"),
                HasSubstr("model:3: intrinsics: must have 36 numbers, not 6"));
    EXPECT_THAT(with(splined + "Nx=4_Ny=1_fov_x_deg=90", ", 0, 0, 0, 0, 0, 0, 0, 0"),
                HasSubstr("model:2: lensmodel: no splined projection has order 3, 4 x 1"));
    EXPECT_THAT(with("CAHVORE_linearity=0.4", ", 0, 0, 0, 0, 0, 0, 0.01, 0"),
                HasSubstr("model:3: intrinsics: is of a CAHVORE lens whose entrance pupil moves"));
    EXPECT_THAT(with("CAHVOR", ", 0, 0"), HasSubstr("intrinsics: must have 9 numbers, not 6"));
    EXPECT_THAT(with("CAHVOR", ", 0, 0, -2, 0, 0"), HasSubstr("model:3: intrinsics: no CAHVOR"));
}

// A point of the image, less the centre and by the stretch's inverse, is (x, y); its ray is
// (x, y, a0 + a2 r^2 + a3 r^3 + a4 r^4): MATLAB's documentation of fisheyeIntrinsics.
TEST(WideCameraFile, OfMatlabsFisheyeHasItsRays) {
    const TemporaryFolder folder;
    const std::string fisheye =
        "{\"MappingCoefficients\":[347.5,-0.0009,4e-7,-2e-9],\"ImageSize\":[750,1000],"
        "\"DistortionCenter\":[507.25,371.5],\"StretchMatrix\":[[1.01,0.004],[-0.003,1]]}";
    std::ofstream(folder / "fisheye.json") << fisheye;
    const CameraModel camera = read_any_camera(folder / "fisheye.json");
    EXPECT_EQ(camera.width, 1000);
    EXPECT_EQ(camera.height, 750);
    const Projector projector(camera);
    const Eigen::Matrix2d stretch = (Eigen::Matrix2d() << 1.01, 0.004, -0.003, 1.0).finished();
    for (int v = 0; v < 750; v += 50)
        for (int u = 0; u < 1000; u += 50) {
            const Eigen::Vector2d at = stretch.inverse() * (Eigen::Vector2d(u + 1, v + 1) -
                                                            Eigen::Vector2d(507.25, 371.5));
            const double r = at.norm();
            const Eigen::Vector3d ray(
                at.x(), at.y(), 347.5 - 0.0009 * r * r + 4e-7 * r * r * r - 2e-9 * r * r * r * r);
            const auto found = projector.ray({u, v});
            ASSERT_TRUE(found);
            ASSERT_LT(found->cross(ray.normalized()).norm(), 1e-14);
            ASSERT_LT((*projector.project(ray) - Eigen::Vector2d(u, v)).norm(), 1e-10);
        }
    write_foreign_camera(folder / "again.json", CalibrationTool::matlab, camera);
    const CameraModel again = read_any_camera(folder / "again.json");
    EXPECT_LT((*Projector(again).project({1, -2, 0.3}) - *projector.project({1, -2, 0.3})).norm(),
              1e-10);
    std::ofstream(folder / "nested.json") << "{\"Intrinsics\":" + fisheye + ",\"Skew\":0}";
    EXPECT_EQ(read_any_camera(folder / "nested.json").projection, camera.projection);
    std::ofstream(folder / "negative.json")
        << "{\"MappingCoefficients\":[-347.5,0.0009,0,0],\"DistortionCenter\":[507,371]}";
    EXPECT_THAT(text_of_error<ConfigError>(
                    [&] { read_any_camera(folder / "negative.json", cv::Size(1000, 750)); }),
                HasSubstr("negative.json:1: MappingCoefficients: fx and fy must be positive"));
}

// Its image of a ray at the angle t is fx (2 t + 0.2 t^3 + 0.04 t^5) from the centre along x.
TEST(WideCameraFile, OfBoofCvsKannalaBrandtIsItsPolynomial) {
    const TemporaryFolder folder;
    const auto read = [&](const std::string& coefficients) {
        std::ofstream(folder / "kb.yaml")
            << "model: kannala_brandt\npinhole:\n  width: 640\n  height: 480\n  fx: 100.0\n"
               "  fy: 90.0\n  skew: 0.5\n  cx: 320.5\n  cy: 240.5\n" +
                   coefficients;
        return read_any_camera(folder / "kb.yaml");
    };
    const Projector projector(
        read("symmetric: [2.0, 0.2, 0.04]\nradial: [0.0, 0.0]\n"
             "radial_trig: [1.0]\ntangent: []\ntangent_trig: []\n"));
    const double t = 1.7, r = 2.0 * t + 0.2 * std::pow(t, 3) + 0.04 * std::pow(t, 5);
    const auto pixel = projector.project({0.6 * std::sin(t), 0.8 * std::sin(t), std::cos(t)});
    ASSERT_TRUE(pixel);
    EXPECT_NEAR(pixel->x(), 320.0 + 60.0 * r + 0.4 * r, 1e-10);
    EXPECT_NEAR(pixel->y(), 240.0 + 72.0 * r, 1e-10);
    const auto error = [&](const std::string& coefficients) {
        return text_of_error<ConfigError>([&] { read(coefficients); });
    };
    EXPECT_THAT(error("symmetric: [1.0]\ntangent: [0.1]\ntangent_trig: [0.0, 0.2]\n"),
                HasSubstr("kb.yaml:11: tangent: is an asymmetric term"));
    EXPECT_THAT(error("symmetric: [1, 2, 3, 4, 5, 6]\n"), HasSubstr("1 to 5 coefficients, not 6"));
    EXPECT_THAT(error("symmetric: [-1]\n"), HasSubstr("must begin with a positive"));
    EXPECT_THAT(error("symmetric: [1e308]\n"), HasSubstr("kb.yaml:10: symmetric: has a number"));
    EXPECT_THAT(error("symmetric: [1e-3, 1e308]\n"), HasSubstr("too large relative to the first"));
}

CameraModel skewed(Projection kind) {
    CameraModel camera =
        camera_with(700, 500, {611.5, 587.25, 361.0, 239.0, -2.125}, {.k1 = -0.3, .k2 = 0.1});
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
            text_of_error<ConfigError>([&, tool = tool, kind = kind] {
                write_foreign_camera(path, tool, skewed(kind));
            }),
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
