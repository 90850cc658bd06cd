#include "calib/files/camera_file.h"

#include "calib/files/foreign_camera.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::filesystem::path temporary(const std::string& name) {
    static const TemporaryFolder folder;
    return folder / name;
}

std::filesystem::path written(const std::string& name, const std::string& text) {
    const auto path = temporary(name);
    std::ofstream(path, std::ios::binary) << text;
    return path;
}

CameraModel read(const std::string& text, std::optional<cv::Size> size = std::nullopt) {
    return read_camera(written("case.yml", text), size);
}

// The message without the folder, or "no error".
std::string error_of(const std::string& text, std::optional<cv::Size> size = std::nullopt) {
    const std::string what = text_of_error<ConfigError>([&] { read(text, size); });
    return what.substr(what.find("case.yml") == std::string::npos ? 0 : what.find("case.yml"));
}

const std::string head =
    "etalon: camera/1\n"
    "image: {width: 640, height: 480}\n"
    "intrinsics: {fx: 538.6, fy: 541.2, cx: 319.5, cy: 239.25}\n";
const std::string lens_and_sensor =
    "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650}\n"
    "sensor: {pixel_pitch_um: 8.3}\n";

TEST(CameraFile, ReadsEveryKey) {
    written("table.csv", "radiance,code\n0,7\n0.5,100\n1,250\n");
    const CameraModel camera = read(
        "etalon: camera/1\nserial: \"U3V-1234\"\nimage: {width: 640, height: 480}\n"
        "intrinsics: {fx: 538.6, fy: 541.2, cx: 319.5, cy: 239.25}\n"
        "distortion: {k1: -0.286, k2: 0.057, p1: 0.01, p2: -0.02, k3: 0.112, k4: 4, k5: 5, k6: 6,"
        " s1: 0.1, s2: 0.2, s3: 0.3, s4: 0.4, tau_x: 0.05, tau_y: -0.07}\n"
        "covariance: {order: [fx, k1], lower: [4, 0.5, 0.25]}\n"
        "lens: {f_number: 2.8, focus_distance_mm: infinity, wavelength_nm: 650,"
        " psf: {gaussian: {sigma_px: 0.7}}}\n"
        "sensor: {pixel_pitch_um: 8.3, bits: 8, transfer: {table: {file:"
        " table.csv}}, black: 3, gain_e_per_dn: 2.5, read_noise_e: 7,"
        " illumination: {cos4: true}}\n");
    EXPECT_EQ(camera.serial, "U3V-1234");
    EXPECT_EQ(camera.width, 640);
    EXPECT_EQ(camera.height, 480);
    EXPECT_EQ(camera.intrinsics.fy, 541.2);
    EXPECT_EQ(camera.intrinsics.cy, 239.25);
    EXPECT_EQ(camera.distortion.in_opencv_order(),
              (std::array<double, 14>{-0.286, 0.057, 0.01, -0.02, 0.112, 4, 5, 6, 0.1, 0.2, 0.3,
                                      0.4, 0.05, -0.07}));
    EXPECT_EQ(camera.covariance->matrix(0, 1), 0.5);
    EXPECT_EQ(camera.covariance->matrix(1, 0), 0.5);
    EXPECT_EQ(camera.covariance->matrix(1, 1), 0.25);
    EXPECT_TRUE(std::isinf(camera.lens->focus_distance_mm));
    EXPECT_EQ(camera.lens->psf.kind, PointSpread::Kind::gaussian);
    EXPECT_EQ(camera.lens->psf.sigma_px, 0.7);
    EXPECT_EQ(camera.sensor->transfer.table[1], (std::pair<double, double>(0.5, 100.0 / 255)));
    EXPECT_EQ(camera.sensor->black_dn, 3);
    EXPECT_EQ(camera.sensor->gain_e_per_dn, 2.5);
    EXPECT_EQ(camera.sensor->read_noise_e, 7);
    EXPECT_EQ(camera.sensor->illumination.kind, Illumination::Kind::cos4);
}

TEST(CameraFile, LeavesOutWhatTheFileLeavesOut) {
    const CameraModel camera = read(head);
    EXPECT_TRUE(camera.serial.empty());
    EXPECT_TRUE(camera.distortion.is_zero());
    EXPECT_FALSE(camera.covariance);
    EXPECT_FALSE(camera.lens);
    EXPECT_FALSE(camera.sensor);
    const CameraModel with_lens = read(head + lens_and_sensor);
    EXPECT_EQ(with_lens.lens->psf.kind, PointSpread::Kind::ideal);
    EXPECT_EQ(with_lens.sensor->bits, 8);
    EXPECT_EQ(with_lens.sensor->transfer.kind, Transfer::Kind::linear);
    EXPECT_EQ(with_lens.sensor->illumination.kind, Illumination::Kind::uniform);
}

TEST(CameraFile, WorkingFNumberBecomesTheEngravedOne) {
    const double v = 538.6 * 0.0083;
    const double f = 1 / (1 / v + 1 / 150.0);
    const std::string sensor = "sensor: {pixel_pitch_um: 8.3}\n";
    const CameraModel camera =
        read(head + "lens: {working_f_number: 2.9, focus_distance_mm: 150, wavelength_nm: 650}\n" +
             sensor);
    EXPECT_NEAR(camera.lens->f_number, 2.9 * f / v, 1e-14);
    EXPECT_NEAR(thin_lens(camera).working_f_number, 2.9, 1e-14);
    const std::string both =
        "lens: {f_number: " + exact(2.9 * f / v) +
        ", working_f_number: 2.9, focus_distance_mm: 150, wavelength_nm: 650}\n";
    EXPECT_NO_THROW(read(head + both + sensor));
    EXPECT_THAT(error_of(head +
                         "lens: {f_number: 2.9, working_f_number: 2.9, focus_distance_mm: 150,"
                         " wavelength_nm: 650}\n" +
                         sensor),
                HasSubstr("case.yml:4: lens.working_f_number: contradicts f_number 2.9"));
}

TEST(CameraFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto lens = [](const std::string& keys) {
        return error_of(head + "lens: {" + keys +
                        ", wavelength_nm: 650}\nsensor: {pixel_pitch_um: 8.3}\n");
    };
    EXPECT_THAT(lens("f_number: 2.8, focus_distance_mm: 150, psf: {gaussian: {sigma_px: 0}}"),
                HasSubstr("case.yml:4: lens.psf.gaussian.sigma_px: must be between 1e-06 and"));
    EXPECT_THAT(lens("f_number: 2.8, focus_distance_mm: 150, psf: round"),
                HasSubstr("case.yml:4: lens.psf: must be one of ideal"));
    EXPECT_THAT(
        error_of(head + "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650}\n"),
        HasSubstr("sensor: missing"));
    EXPECT_THAT(lens("f_number: 0, focus_distance_mm: 150"),
                HasSubstr("case.yml:4: lens.f_number: must be between 0.1 and"));
    EXPECT_THAT(lens("f_number: 2, focus_distance_mm: .inf"),
                HasSubstr("case.yml:4: lens.focus_distance_mm: must be a finite number"));
    EXPECT_THAT(lens("focus_distance_mm: 9"), HasSubstr("case.yml:4: lens.f_number: missing"));
    EXPECT_THAT(error_of(head + "distortion: {k8: 1}\n"),
                HasSubstr("case.yml:4: distortion.k8: unknown"));
    EXPECT_THAT(error_of(head + "distortion: {tau_x: 2}\n"),
                HasSubstr("case.yml:4: distortion.tau_x"));
    EXPECT_THAT(error_of(head + "sensor: {read_noise_e: 3}\n"),
                HasSubstr("case.yml:4: sensor.read_noise_e: needs gain_e_per_dn"));
    EXPECT_THAT(error_of(head + "sensor: {black: 256}\n"), HasSubstr("case.yml:4: sensor.black"));
    EXPECT_THAT(error_of(head + "sensor: {bits: 17}\n"), HasSubstr("case.yml:4: sensor.bits"));
    EXPECT_THAT(error_of("etalon: camera/1\nimage: {width: 0, height: 480}\n"),
                HasSubstr("case.yml:2: image.width"));
}

TEST(CameraFile, RefusesWhatIsNoCovariance) {
    const auto covariance = [](const std::string& text) {
        return error_of(head + "covariance: " + text + "\n");
    };
    EXPECT_THAT(covariance("{order: [fx, k1], lower: [4, 0.5]}"),
                HasSubstr("case.yml:4: covariance.lower: must have 3 numbers, not 2"));
    EXPECT_THAT(covariance("{order: [fx, k1], lower: [4, 0.5, 0.5, 0.25]}"),
                HasSubstr("must have 3 numbers, not 4"));
    EXPECT_THAT(covariance("{order: [fx, k1], lower: [4, 1.1, 0.25]}"),
                HasSubstr("not positive semi-definite"));
    EXPECT_THAT(covariance("{order: [fx, k1], lower: [-4, 0, 0.25]}"),
                HasSubstr("not positive semi-definite"));
    EXPECT_THAT(covariance("{order: [fx, fx], lower: [4, 0, 0.25]}"), HasSubstr("listed twice"));
    EXPECT_THAT(covariance("{order: [focal], lower: [4]}"), HasSubstr("no camera parameter"));
    EXPECT_THAT(covariance("{order: [], lower: []}"), HasSubstr("at least one"));
}

TEST(CameraFile, RefusesBrokenTransferTablesWithTheirOwnLine) {
    const auto table = [](const std::string& text) {
        written("broken.csv", text);
        return error_of(head + "sensor: {transfer: {table: {file: broken.csv}}}\n");
    };
    EXPECT_THAT(table("0,0\n1,255\n"), HasSubstr("broken.csv:1: the first line must be"));
    EXPECT_THAT(table("radiance,code\n0,0\n0.5,nan\n"), HasSubstr("broken.csv:3: 'nan' is"));
    EXPECT_THAT(table("radiance,code\n0,0\n0.5\n"), HasSubstr("broken.csv:3: has 1 cells"));
    EXPECT_THAT(table("radiance,code\n0,9\n0.5,9\n"), HasSubstr("broken.csv:3: must be greater"));
    EXPECT_THAT(table("radiance,code\n0,9\n0.5,256\n"), HasSubstr("broken.csv:3: radiance"));
    EXPECT_THAT(table("radiance,code\n0,9\n"), HasSubstr("at least two"));
    EXPECT_THAT(table(""), HasSubstr("broken.csv:1"));
}

CameraModel written_and_read(const CameraModel& camera) {
    write_camera(temporary("written.yml"), camera);
    return read_camera(temporary("written.yml"));
}

TEST(CameraFile, WritesWhatReadsBackToTheLastBit) {
    CameraModel camera = all_fourteen();
    camera.intrinsics.fx = 2000.0 / 3;
    camera.serial = "a \"b\" \\ c #: d";
    camera.covariance = ParameterCovariance{{"fx", "cy", "tau_x"}, Eigen::MatrixXd(3, 3)};
    camera.covariance->matrix << 4, 0.1, 1.0 / 3, 0.1, 9, 1e-17, 1.0 / 3, 1e-17, 0.7;
    camera.lens = Lens{2.8, 1000.0 / 7, 650, {PointSpread::Kind::gaussian, 0.7}};
    camera.sensor = Sensor{.pixel_pitch_um = 8.3, .bits = 12};
    camera.sensor->transfer = {Transfer::Kind::table,
                               {{0, 5 / 4095.0}, {0.1, 1203 / 4095.0}, {1, 1}}};
    camera.sensor->black_dn = 5;
    camera.sensor->gain_e_per_dn = 0.3;
    camera.sensor->read_noise_e = 1.7;
    camera.sensor->illumination.kind = Illumination::Kind::cos4;
    EXPECT_EQ(written_and_read(camera), camera);
}

const std::string telecentric_head =
    "etalon: camera/1\nimage: {width: 640, height: 480}\nprojection: telecentric\n"
    "intrinsics: {fx: 8.2, fy: 7.9, cx: 319.5, cy: 239.5}\n";

TEST(CameraFile, ReadsATelecentricCamera) {
    const CameraModel camera =
        read(telecentric_head +
             "lens: {object_na: 0.03, focus_distance_mm: 150, wavelength_nm: 650, psf: wave}\n"
             "sensor: {pixel_pitch_um: 5, illumination: {polynomial: [-0.2, 0.1, -0.05]},"
             " mosaic: GRBG, channel_response: [0.6, 1, 0.45]}\n");
    EXPECT_EQ(camera.projection.kind, Projection::telecentric);
    EXPECT_EQ(camera.lens->object_na, 0.03);
    EXPECT_EQ(camera.lens->psf.kind, PointSpread::Kind::wave);
    EXPECT_EQ(camera.sensor->illumination.kind, Illumination::Kind::polynomial);
    EXPECT_EQ(camera.sensor->illumination.polynomial, (std::array{-0.2, 0.1, -0.05}));
    EXPECT_EQ(camera.sensor->mosaic, Mosaic::grbg);
    EXPECT_EQ(camera.sensor->channel_response, (std::array{0.6, 1.0, 0.45}));
    EXPECT_EQ(written_and_read(camera), camera);
    EXPECT_THROW(write_foreign_camera(temporary("opencv.yml"), CalibrationTool::opencv, camera),
                 ConfigError);
}

TEST(CameraFile, RefusesWhatATelecentricCameraCannotHave) {
    const std::string sensor = "sensor: {pixel_pitch_um: 5}\n";
    const auto lens = [&](const std::string& keys) {
        return telecentric_head + "lens: {" + keys + ", wavelength_nm: 650}\n" + sensor;
    };
    EXPECT_THAT(error_of(lens("f_number: 2.8, focus_distance_mm: 150")),
                HasSubstr("case.yml:5: lens.object_na: missing"));
    EXPECT_THAT(error_of(lens("object_na: 0.03, focus_distance_mm: 150, f_number: 2.8")),
                HasSubstr("lens.f_number: unknown key"));
    EXPECT_THAT(error_of(lens("object_na: 1, focus_distance_mm: 150")),
                HasSubstr("case.yml:5: lens.object_na: must be less than 1"));
    EXPECT_THAT(error_of(lens("object_na: 0.03, focus_distance_mm: infinity")),
                HasSubstr("case.yml:5: lens.focus_distance_mm: "));
    EXPECT_THAT(error_of(telecentric_head + "distortion: {k1: 1e-4, tau_y: 0.1}\n"),
                HasSubstr("case.yml:5: distortion.tau_y: belongs to a perspective camera"));
    EXPECT_THAT(error_of(telecentric_head + "sensor: {illumination: {cos4: true}}\n"),
                HasSubstr("case.yml:5: sensor.illumination.cos4: belongs to a perspective camera"));
    EXPECT_THAT(error_of(head + "projection: fisheye\n"),
                HasSubstr("case.yml:4: projection: must be perspective, telecentric, equidistant"));
}

TEST(CameraFile, ReadsAMeasuredPointSpreadAndWritesItBack) {
    written("psf.yml", "etalon: psf/1\nradius_px: [0, 0.5, 1.25, 3]\ndensity: [4, 3, 0.7, 0]\n");
    const CameraModel camera =
        read(head +
             "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650,"
             " psf: {measured: {file: psf.yml}}}\nsensor: {pixel_pitch_um: 8.3}\n");
    const std::vector<std::pair<double, double>> profile{{0, 4}, {0.5, 3}, {1.25, 0.7}, {3, 0}};
    EXPECT_EQ(camera.lens->psf.kind, PointSpread::Kind::measured);
    EXPECT_EQ(camera.lens->psf.profile, profile);
    EXPECT_EQ(written_and_read(camera), camera);
}

TEST(CameraFile, CarriesStandardUncertainties) {
    CameraModel camera = all_fourteen();
    camera.lens = Lens{2.8, 1000.0 / 7, 650, {PointSpread::Kind::gaussian, 0.7}};
    camera.sensor = Sensor{.pixel_pitch_um = 8.3, .bits = 12, .black_dn = 5, .gain_e_per_dn = 3};
    camera.sensor->transfer = {Transfer::Kind::table, {{0, 0}, {0.1, 1203 / 4095.0}, {1, 1}}};
    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.2, 0.1, -0.05}};
    CameraUncertainty u;
    u.f_number = 0.1 / 3;
    u.focus_distance_mm = 1.2 / 7;
    u.psf_sigma_px = 0.01;
    u.black_dn = 0.05;
    u.gain_e_per_dn = 0.02;
    u.read_noise_e = 0.0;
    u.illumination = {0.01, 1.0 / 30, 0.015};
    u.transfer_code = {0, 1.0 / 3 / 4095, 0.25 / 4095};
    camera.standard_uncertainty = u;
    EXPECT_EQ(written_and_read(camera), camera);
}

TEST(CameraFile, CarriesUncertaintiesOfAMeasuredPointSpread) {
    CameraModel camera = all_fourteen();
    camera.lens = Lens{2.8, 150, 650, {PointSpread::Kind::measured, 0.0}};
    camera.lens->psf.profile = {{0, 4}, {0.5, 3}, {1.25, 0.7}, {3, 0}};
    camera.sensor = Sensor{.pixel_pitch_um = 8.3};
    camera.standard_uncertainty.emplace().psf_density = {0.1, 0.2, 1.0 / 3, 0};
    EXPECT_EQ(written_and_read(camera), camera);
    camera.standard_uncertainty->psf_density.pop_back();
    EXPECT_THROW(write_camera(temporary("uncertain.yml"), camera), ConfigError);
}

TEST(CameraFile, RefusesUncertaintiesOfWhatItDoesNotHave) {
    const auto error = [](const std::string& entry, const std::string& rest = lens_and_sensor) {
        return error_of(head + rest + "standard_uncertainty: {" + entry + "}\n");
    };
    EXPECT_EQ(error("f_number: 0.03"), "no error");
    EXPECT_THAT(error("f_number: -0.03"), HasSubstr("case.yml:6: standard_uncertainty.f_number"));
    EXPECT_THAT(error("f_number: .inf"), HasSubstr("case.yml:6: standard_uncertainty.f_number"));
    EXPECT_THAT(error("aperture: 0.03"),
                HasSubstr("case.yml:6: standard_uncertainty.aperture: unknown key"));
    EXPECT_THAT(error("black: 0.1"), HasSubstr("case.yml:6: standard_uncertainty.black: is of "
                                               "sensor.black, which this file does not have"));
    EXPECT_THAT(error("f_number: 0.03", ""), HasSubstr("is of lens.f_number, which this file"));
    EXPECT_THAT(error("psf_sigma_px: 0.03"), HasSubstr("is of lens.psf.gaussian"));
    EXPECT_THAT(error("illumination: [0.1, 0.1, 0.1]"),
                HasSubstr("is of sensor.illumination.polynomial"));
    written("broken.csv", "radiance,code,u_code\n0,0,0.1\n1,255,-1\n");
    EXPECT_THAT(error_of(head + "sensor: {transfer: {table: {file: broken.csv}}}\n"),
                HasSubstr("broken.csv:3: a standard uncertainty must be at least 0"));
}

TEST(CameraFile, RefusesAMeasuredPointSpreadByLineAndKey) {
    const auto error = [](const std::string& radii, const std::string& densities) {
        written("psf.yml", "etalon: psf/1\nradius_px: " + radii + "\ndensity: " + densities + "\n");
        return error_of(head +
                        "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650,"
                        " psf: {measured: {file: psf.yml}}}\nsensor: {pixel_pitch_um: 8.3}\n");
    };
    EXPECT_THAT(error("[0, 1, 2]", "[3, 2, 1]"), HasSubstr("psf.yml:2: radius_px: needs at least"));
    EXPECT_THAT(error("[0.1, 1, 2, 3]", "[3, 2, 1, 0]"),
                HasSubstr("psf.yml:2: radius_px: must begin with 0"));
    EXPECT_THAT(error("[0, 1, 1, 3]", "[3, 2, 1, 0]"),
                HasSubstr("psf.yml:2: radius_px: must ascend: 1 after 1"));
    EXPECT_THAT(error("[0, 1, 2, 3]", "[3, 2, 1]"), HasSubstr("psf.yml:3: density: "));
    EXPECT_THAT(error("[0, 1, 2, 3]", "[3, 2, -1, 0]"), HasSubstr("psf.yml:3: density"));
    EXPECT_THAT(error("[0, 1, 2, 3]", "[3, .nan, 1, 0]"), HasSubstr("psf.yml:3: density"));
    EXPECT_THAT(error("[0, 1, 2, 3]", "[0, 0, 0, 0]"),
                HasSubstr("psf.yml:3: density: holds no energy"));
}

TEST(CameraFile, RefusesIlluminationAndMosaicByLineAndKey) {
    const auto error = [](const std::string& keys) {
        return error_of(head + "sensor: {" + keys + "}\n");
    };
    EXPECT_THAT(error("illumination: {cos4: true, polynomial: [0, 0, 0]}"),
                HasSubstr("case.yml:4: sensor.illumination.polynomial: excludes cos4"));
    EXPECT_THAT(error("illumination: {polynomial: [-0.2, 0.1]}"),
                HasSubstr("case.yml:4: sensor.illumination.polynomial"));
    // 1 - 3 s + 2.1 s^2 is 1 at 0 and 0.1 at 1, but negative between: -0.0714 at s = 0.714.
    EXPECT_THAT(error("illumination: {polynomial: [-3, 2.1, 0]}"),
                HasSubstr("case.yml:4: sensor.illumination.polynomial: falls to -0.0714"));
    EXPECT_THAT(error("mosaic: RGBG"), HasSubstr("case.yml:4: sensor.mosaic: must be one of RGGB"));
    EXPECT_THAT(error("channel_response: [1, 1, 1]"),
                HasSubstr("case.yml:4: sensor.channel_response: needs a mosaic"));
    EXPECT_THAT(error("mosaic: RGGB, channel_response: [1, 0, 1]"),
                HasSubstr("case.yml:4: sensor.channel_response[1]: must be between 1e-12"));
}

std::string opencv_yaml(const std::string& matrix, const std::string& distortion) {
    return "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: " + matrix +
           "\ndistortion_coefficients: " + distortion + "\n";
}
std::string matrix(int rows, int cols, const std::string& data) {
    return fmt::format("!!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]", rows,
                       cols, data);
}
const std::string good_matrix = matrix(3, 3, "538., 0., 342.5, 0., 541., 233.5, 0., 0., 1.");
const std::string good_distortion = matrix(5, 1, "-0.25, 0.125, 0.5, -0.0625, 7.");
const CameraModel good_camera =
    camera_with(640, 480, {538, 541, 342.5, 233.5},
                {.k1 = -0.25, .k2 = 0.125, .p1 = 0.5, .p2 = -0.0625, .k3 = 7});

TEST(OpenCvFile, ReadsYamlXmlAndJsonUnderAllUsualNames) {
    const std::string xml =
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_Width>640</image_Width>\n"
        "<image_Height>480</image_Height>\n"
        "<Camera_Matrix type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt>\n"
        "<data>538. 0. 342.5 0. 541. 233.5 0. 0. 1.</data></Camera_Matrix>\n"
        "<Distortion_Coefficients "
        "type_id=\"opencv-matrix\"><rows>1</rows><cols>5</cols><dt>d</dt>\n"
        "<data>-0.25 0.125 0.5 -0.0625 7.</data></Distortion_Coefficients>\n</opencv_storage>\n";
    const std::string json =
        "{\"image_width\": 640, \"image_height\": 480,\n"
        "\"cameraMatrix\": [[538.0, 0, 342.5], [0, 541.0, 233.5], [0, 0, 1]],\n"
        "\"dist_coeffs\": [-0.25, 0.125, 0.5, -0.0625, 7.0]}\n";
    for (const std::string& text : {opencv_yaml(good_matrix, good_distortion), xml, json})
        EXPECT_EQ(read(text), good_camera) << text;
}

TEST(OpenCvFile, TakesTheImageSizeFromTheCallerWhereItHasNone) {
    const std::string text =
        "%YAML:1.0\n---\ncameraMatrix: " + good_matrix + "\ndistCoeffs: " + good_distortion + "\n";
    EXPECT_EQ(read(text, cv::Size(700, 500)).height, 500);
    EXPECT_THAT(error_of(text), HasSubstr("image_width: missing"));
    EXPECT_THAT(error_of(opencv_yaml(good_matrix, good_distortion), cv::Size(700, 500)),
                HasSubstr("is for images of 640x480, not 700x500"));
}

TEST(OpenCvFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with_matrix = [](const std::string& m) {
        return error_of(opencv_yaml(m, good_distortion));
    };
    const auto with_distortion = [](const std::string& d) {
        return error_of(opencv_yaml(good_matrix, d));
    };
    EXPECT_THAT(with_matrix(matrix(3, 4, "538.,0.,342.,0.,0.,541.,233.,0.,0.,0.,1.,0.")),
                HasSubstr("case.yml:5: camera_matrix: must be a 3x3 matrix, not 3x4"));
    EXPECT_THAT(with_matrix(matrix(3, 3, "538.,0.,342.,0.,541.,233.,0.,0.")),
                HasSubstr("case.yml:5: camera_matrix: says 3x3 but has 8 numbers"));
    EXPECT_THAT(with_matrix(matrix(2000000000, 2000000000, "1.")),
                HasSubstr("case.yml:5: camera_matrix: says"));
    EXPECT_THAT(with_matrix(matrix(3, 3, ".Nan,0.,342.,0.,541.,233.,0.,0.,1.")),
                HasSubstr("case.yml:5: camera_matrix: has a number that is not finite"));
    EXPECT_THAT(with_matrix(matrix(3, 3, "538.,0.,342.,0.,-541.,233.,0.,0.,1.")),
                HasSubstr("fx and fy must be positive"));
    EXPECT_THAT(with_matrix(matrix(3, 3, "538.,0.,0.,0.,541.,0.,342.,233.,1.")),
                HasSubstr("must be [fx skew cx; 0 fy cy; 0 0 1]"));
    EXPECT_THAT(with_matrix("word"), HasSubstr("case.yml:5: camera_matrix: must be a matrix"));
    EXPECT_THAT(with_distortion(matrix(6, 1, "1.,2.,3.,4.,5.,6.")),
                HasSubstr("case.yml:10: distortion_coefficients: must be a row or column"));
    EXPECT_THAT(with_distortion(matrix(2, 2, "1.,2.,3.,4.")), HasSubstr("must be a row or column"));
    EXPECT_THAT(with_distortion(matrix(4, 1, "1.,2.,.Inf,4.")), HasSubstr("not finite"));
    EXPECT_THAT(error_of("%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"),
                HasSubstr("camera_matrix: missing"));
    EXPECT_THAT(error_of("%YAML:1.0\n---\nimage_width: 640.5\nimage_height: 480\ncamera_matrix: " +
                         good_matrix + "\ndist_coeffs: " + good_distortion + "\n"),
                HasSubstr("case.yml:3: image_width: must be a whole number"));
    EXPECT_THAT(error_of(opencv_yaml(good_matrix, good_distortion) + "dist_coeffs: 5\n"),
                HasSubstr("is given as"));
    EXPECT_THAT(error_of(opencv_yaml(good_matrix, good_distortion) + "distortion_model: fisheye\n"),
                HasSubstr("not 'fisheye'"));
}

TEST(OpenCvFile, SurvivesGarbageAndDeepNesting) {
    std::string tags, indents;
    for (int i = 0; i < 990; ++i)
        tags += "<a>";
    for (int i = 0; i < 1300; ++i)
        indents += std::string(i, ' ') + "a:\n";
    for (const std::string& text :
         {std::string("%YAML:1.0\n---\ncamera_matrix: [1, 2"), std::string("%YAML:1.0\n\x01\x02"),
          std::string("%YAML"), std::string("{"), std::string("{\"a\": }"),
          std::string("<?xml versMoion="), std::string("<?xml version=\"1.0\"?>"),
          std::string("<?xml version=\"1.0\"?>\n<a><b></a>"),
          "<?xml version=\"1.0\"?>\n<opencv_storage>" + tags,
          "<?xml version=\"1.0\"?>\n<opencv_storage>" + std::string(300'000, '<'),
          "{\"a\": " + std::string(998, '['), "{\"a\": " + std::string(300'000, '['),
          "%YAML:1.0\n---\na: " + std::string(999, '['), "%YAML:1.0\n---\n" + indents,
          std::string("%YAML:1.0\n---\n\0\0\0", 18), std::string(5000, '{'), std::string(),
          std::string("%YAML:1.0\n---\ncamera_matrix: !!binary |\n  QUJD\n")})
        EXPECT_NE(error_of(text), "no error") << text.substr(0, 60);
}

TEST(OpenCvFile, SaysWhereXmlDoesNotEnd) {
    const std::string begin = "<?xml version=\"1.0\"?>\n<opencv_storage>\n";
    for (const char* rest :
         {"<a b", "<a b=\"</opencv_storage>", "<!-- </opencv_storage>", "<a <b>"})
        EXPECT_THAT(error_of(begin + rest), HasSubstr("case.yml:3: a tag or comment")) << rest;
    EXPECT_THAT(error_of(begin + "<a>1</a>\n"), HasSubstr("does not end with </opencv_storage>"));
    EXPECT_THAT(error_of(begin + "<!-- > \" --><a>1</a></opencv_storage>\n"),
                HasSubstr("camera_matrix: missing"));
}

const std::string ros =
    "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [538, 0, 342.5, 0, 541, 233.5, 0, 0, 1]\ndistortion_model: plumb_bob\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.25, 0.125, 0.5, -0.0625, 7]\n"
    "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n";

TEST(RosFile, ReadsPlumbBobAndRational) {
    EXPECT_EQ(read(ros), good_camera);
    std::string rational = replaced(ros, "plumb_bob", "rational_polynomial");
    rational = replaced(rational, "cols: 5", "cols: 8");
    rational = replaced(rational, "-0.0625, 7]", "-0.0625, 7, 0.1, 0.2, 0.3]");
    EXPECT_EQ(read(rational).distortion.k6, 0.3);
}

TEST(RosFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with = [](auto from, auto to) { return error_of(replaced(ros, from, to)); };
    EXPECT_THAT(with("plumb_bob", "fisheye"),
                HasSubstr("case.yml:8: distortion_model: must be plumb_bob, rational_polynomial or "
                          "equidistant, not 'fisheye'"));
    EXPECT_THAT(with("plumb_bob", "equidistant"),
                HasSubstr("case.yml:10: distortion_coefficients: equidistant has 4"));
    EXPECT_THAT(with("plumb_bob", "rational_polynomial"),
                HasSubstr("case.yml:10: distortion_coefficients: rational_polynomial has 8"));
    EXPECT_THAT(with("538, 0, 342.5", "538, 7, 342.5"),
                HasSubstr("case.yml:5: camera_matrix: has a skew of 7"));
    EXPECT_THAT(with("538, 0, 342.5", "538, 0, .nan"),
                HasSubstr("case.yml:7: camera_matrix.data[2]: must be a finite number"));
    EXPECT_THAT(with("cols: 3\n", "cols: 4\n"), HasSubstr("case.yml:5: camera_matrix: says 3x4"));
    EXPECT_THAT(with("image_width: 640\n", ""), HasSubstr("case.yml:1: image_width: missing"));
    EXPECT_THAT(with("camera_name: head", "image_width: 7"),
                HasSubstr("case.yml:3: image_width: doubled"));
    EXPECT_THAT(error_of("just words\n"), HasSubstr("case.yml:1: is no camera calibration"));
    EXPECT_THAT(error_of("a: [1, 2\n"), HasSubstr("case.yml:"));
    EXPECT_NE(error_of(std::string(100'000, '[')), "no error");
}

}  // namespace
}  // namespace etalon
