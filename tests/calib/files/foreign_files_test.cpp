// Files of other tools, laid out as their documentation says (docs/files.md names it), with numbers
// of which no two are alike.
#include <opencv2/core.hpp>
#include <sstream>

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "tests/calib/cameras.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::filesystem::path written(const std::string& text) {
    static const TemporaryFolder folder;
    const auto path = folder / "case";
    std::ofstream(path, std::ios::binary) << text;
    return path;
}

CameraModel read_foreign(const std::string& text, const std::string& select = "") {
    return read_foreign_camera(written(text), select);
}

// The message from the file's name on, or "no error".
std::string foreign_error(const std::string& text, const std::string& select = "") {
    const std::string what = text_of_error<ConfigError>([&] { read_foreign(text, select); });
    return what.substr(what.find("case:") == std::string::npos ? 0 : what.find("case:"));
}

const std::string kalibr =
    "cam0:\n"
    "  cam_overlaps: []\n"
    "  camera_model: pinhole\n"
    "  distortion_coeffs: [-0.27, 0.067, 0.00087, 0.00011]\n"
    "  distortion_model: radtan\n"
    "  intrinsics: [461.5, 460.25, 362.75, 246.125]\n"
    "  resolution: [752, 480]\n"
    "  rostopic: /cam0/image_raw\n";
const std::string second_kalibr = replaced(replaced(kalibr, "cam0:", "cam1:"), "461.5", "463.5");

const std::string mrcal =
    "# generated on 2024-01-02 with   mrcal-calibrate-cameras --lensmodel ...\n"
    "{\n"
    "    'lensmodel':  'LENSMODEL_OPENCV8',\n"
    "\n"
    "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
    "    'intrinsics': [ 1766.5, 1765.25, 1944.75, 1064.125, 2.16, -1.18, -9.3e-05, 0.00077, "
    "-0.23, 2.44, -0.66, -0.62,],\n"
    "\n"
    "    # extrinsics are rt_fromref\n"
    "    'extrinsics': [ 0.1, -0.2, 0.3, 4, -5, 6,],\n"
    "\n"
    "    'imagersize': [ 3840, 2160,],\n"
    "\n"
    "    # it's data that isn't for people\n"
    "    'optimization_inputs': b'P)h>@6aWAK2mk;8Apkaw#]{}[:, *&!%0000000000',\n"
    "\n"
    "}\n";

const std::string matlab =
    "{\"RadialDistortion\":[-0.33,0.092,0.011],\"TangentialDistortion\":[0.0012,-0.0034],"
    "\"ImageSize\":[712,1072],\"WorldPoints\":[[0,0],[0,29]],\"WorldUnits\":\"millimeters\","
    "\"EstimateSkew\":false,\"NumRadialDistortionCoefficients\":3,"
    "\"EstimateTangentialDistortion\":true,\"RotationVectors\":[],\"ReprojectionErrors\":null,"
    "\"IntrinsicMatrix\":[[715.25,0,0],[0,711.5,0],[565.75,355.375,1]]}";

const std::string boofcv =
    "# Pinhole camera model with radial and tangential distortion\n"
    "# (fx,fy) = focal length, (cx,cy) = principle point, (width,height) = image shape\n"
    "# radial = radial distortion, (t1,t2) = tangential distortion\n"
    "\n"
    "pinhole:\n"
    "  skew: 0.0\n"
    "  fx: 530.75\n"
    "  width: 640\n"
    "  fy: 529.5\n"
    "  cx: 323.25\n"
    "  cy: 234.625\n"
    "  height: 480\n"
    "model: pinhole_radial_tangential\n"
    "version: 0\n"
    "radial_tangential:\n"
    "  t1: 0.0013\n"
    "  radial:\n"
    "  - -0.24\n"
    "  - 0.125\n"
    "  t2: -0.0021\n";

const std::string colmap_text =
    "# Camera list with one line of data per camera:\n"
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    "# Number of cameras: 1\n"
    "3 FULL_OPENCV 3072 2304 2559.75 2558.5 1536.25 1152.75 -0.2 0.1 0.001 -0.002 0.03 0.4 -0.05 "
    "0.06\n";

TEST(KalibrFile, ReadsRadtanAndNone) {
    EXPECT_EQ(read_foreign(kalibr),
              camera_with(752, 480, {461.5, 460.25, 362.75, 246.125},
                          {.k1 = -0.27, .k2 = 0.067, .p1 = 0.00087, .p2 = 0.00011}));
    const std::string none = replaced(kalibr, "distortion_model: radtan", "distortion_model: none");
    EXPECT_TRUE(read_foreign(replaced(none, "[-0.27, 0.067, 0.00087, 0.00011]", "[]"))
                    .distortion.is_zero());
}

TEST(KalibrFile, OneOfSeveralCamerasMustBeNamed) {
    EXPECT_THAT(foreign_error(kalibr + second_kalibr), HasSubstr("has 2 cameras (cam0, cam1)"));
    EXPECT_EQ(read_foreign(kalibr + second_kalibr, "cam1").intrinsics.fx, 463.5);
    EXPECT_THAT(foreign_error(kalibr, "cam7"), HasSubstr("cam7: missing"));
}

TEST(KalibrFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with = [](auto from, auto to) { return foreign_error(replaced(kalibr, from, to)); };
    EXPECT_THAT(with("radtan", "rational"),
                HasSubstr("case:5: cam0.distortion_model: of pinhole must be radtan, equidistant, "
                          "fov or none, not 'rational'"));
    EXPECT_THAT(with("pinhole", "cata"),
                HasSubstr("case:3: cam0.camera_model: must be pinhole, omni, eucm or ds, not "));
    EXPECT_THAT(with("pinhole", "omni"), HasSubstr("cam0.intrinsics: must have 5 numbers"));
    EXPECT_THAT(with("radtan", "fov"), HasSubstr("cam0.distortion_coeffs: must have 1"));
    EXPECT_THAT(with("461.5", "-461.5"), HasSubstr("case:6: cam0.intrinsics: fx and fy must be"));
    EXPECT_THAT(with("461.5", ".nan"), HasSubstr("case:6: cam0.intrinsics[0]: must be a finite"));
    EXPECT_THAT(with("461.5", "1e-300"), HasSubstr("case:6: cam0.intrinsics: 1e-300 must be"));
    EXPECT_THAT(with("362.75", "1e300"), HasSubstr("case:6: cam0.intrinsics: 1e+300 must be"));
    EXPECT_THAT(with("461.5, ", "&a [*a], "), HasSubstr("case:6: an alias of the value"));
    EXPECT_THAT(with("radtan", "\xc3("), HasSubstr("case:5: is not UTF-8: a byte 0xc3"));
    EXPECT_THAT(with("461.5, ", ""), HasSubstr("cam0.intrinsics: must have 4 numbers, not 3"));
    EXPECT_THAT(with("0.067, ", ""), HasSubstr("case:4: cam0.distortion_coeffs: must have 4"));
    EXPECT_THAT(with("752", "752.5"), HasSubstr("case:7: cam0.resolution: must be a whole"));
    EXPECT_THAT(with("rostopic", "resolution"), HasSubstr("case:8: cam0.resolution: doubled"));
}

std::string kalibr_of(const std::string& model, const std::string& intrinsics,
                      const std::string& distortion, const std::string& coefficients) {
    return "cam0:\n  cam_overlaps: []\n  camera_model: " + model +
           "\n  distortion_coeffs: " + coefficients + "\n  distortion_model: " + distortion +
           "\n  intrinsics: " + intrinsics +
           "\n  resolution: [512, 512]\n  rostopic: /cam0/image_raw\n";
}

// Intrinsics and coefficients in the order that Kalibr gives them (its wiki, "supported models").
TEST(KalibrFile, ReadsEveryModelOfKalibr) {
    const CameraModel omni = read_foreign(kalibr_of("omni", "[0.8, 833.0, 830.3, 373.8, 253.7]",
                                                    "radtan", "[-0.3, 0.1, 0.02, 0.01]"));
    EXPECT_EQ(omni.projection, (LensProjection{Projection::unified, 0.8}));
    EXPECT_EQ(omni.intrinsics.fy, 830.3);
    EXPECT_EQ(omni.distortion, (Distortion{.k1 = -0.3, .k2 = 0.1, .p1 = 0.02, .p2 = 0.01}));
    const CameraModel ds =
        read_foreign(kalibr_of("ds", "[-0.2, 0.6, 190.0, 190.1, 254.9, 256.8]", "none", "[]"));
    EXPECT_EQ(ds.projection, (LensProjection{Projection::double_sphere, -0.2, 0.6}));
    EXPECT_EQ(ds.intrinsics.fx, 190.0);
    const CameraModel eucm =
        read_foreign(kalibr_of("eucm", "[0.6, 1.1, 190.0, 190.1, 254.9, 256.8]", "none", "[]"));
    EXPECT_EQ(eucm.projection, (LensProjection{Projection::extended_unified, 1.1, 0.6}));
    const CameraModel equi =
        read_foreign(kalibr_of("pinhole", "[190.9, 190.8, 254.9, 256.8]", "equidistant",
                               "[0.003, 0.0007, -0.002, 0.0002]"));
    EXPECT_EQ(equi.projection, LensProjection{Projection::equidistant});
    EXPECT_EQ(equi.distortion, (Distortion{.k1 = 0.003, .k2 = 0.0007, .k3 = -0.002, .k7 = 0.0002}));
    const CameraModel fov =
        read_foreign(kalibr_of("pinhole", "[190.9, 190.8, 254.9, 256.8]", "fov", "[0.92]"));
    EXPECT_EQ(fov.projection, (LensProjection{Projection::field_of_view, 0.92}));
    EXPECT_TRUE(fov.distortion.is_zero());
}

TEST(KalibrFile, RefusesParametersThatNoLensHas) {
    EXPECT_THAT(foreign_error(kalibr_of("ds", "[-0.2, 1.6, 190, 190, 255, 257]", "none", "[]")),
                HasSubstr("case:6: cam0.intrinsics: no double_sphere projection has the parameters "
                          "-0.2 and 1.6"));
    EXPECT_THAT(foreign_error(kalibr_of("pinhole", "[190, 190, 255, 257]", "fov", "[3.3]")),
                HasSubstr("cam0.distortion_coeffs: no field_of_view projection"));
    EXPECT_THAT(foreign_error(kalibr_of("omni", "[0.8, 190, 190, 255, 257]", "equidistant", "[0]")),
                HasSubstr("of omni must be radtan or none, not 'equidistant'"));
    EXPECT_THAT(foreign_error(kalibr_of("ds", "[-0.2, 0.6, 190, 190, 255, 257]", "radtan", "[0]")),
                HasSubstr("of ds must be none, not 'radtan'"));
}

TEST(MrcalFile, ReadsTheOpenCvModels) {
    EXPECT_EQ(read_foreign(mrcal),
              camera_with(3840, 2160, {1766.5, 1765.25, 1944.75, 1064.125},
                          {2.16, -1.18, -9.3e-05, 0.00077, -0.23, 2.44, -0.66, -0.62}));
    const std::string old = replaced(mrcal, "'lensmodel'", "'lens_model'");
    EXPECT_EQ(read_foreign(old).distortion.k6, -0.62);
}

TEST(MrcalFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with = [](auto from, auto to) { return foreign_error(replaced(mrcal, from, to)); };
    EXPECT_THAT(with("LENSMODEL_OPENCV8", "LENSMODEL_LATLON"),
                HasSubstr("case:3: lensmodel: must be LENSMODEL_PINHOLE, _STEREOGRAPHIC, _OPENCV4, "
                          "_OPENCV5, _OPENCV8, _OPENCV12, _CAHVOR, _CAHVORE or "
                          "_SPLINED_STEREOGRAPHIC, not 'LENSMODEL_LATLON'"));
    EXPECT_THAT(with("OPENCV8", "OPENCV5"), HasSubstr("intrinsics: must have 9 numbers, not 12"));
    EXPECT_THAT(with("1766.5", "None"),
                HasSubstr("case:6: intrinsics[0]: must be a finite number"));
    EXPECT_THAT(with("3840", "0"), HasSubstr("case:11: imagersize: must be a whole number"));
}

TEST(MatlabFile, ReadsEveryWayToSayTheMatrix) {
    const auto with_matrix = [](const std::string& text) {
        return replaced(matlab, "\"IntrinsicMatrix\":[[715.25,0,0],[0,711.5,0],[565.75,355.375,1]]",
                        text);
    };
    for (const std::string& text :
         {matlab, with_matrix("\"K\":[[715.25,0,565.75],[0,711.5,355.375],[0,0,1]]"),
          with_matrix("\"FocalLength\":[715.25,711.5],\"PrincipalPoint\":[565.75,355.375],"
                      "\"Skew\":0")}) {
        EXPECT_EQ(read_foreign(text), camera_with(1072, 712, {715.25, 711.5, 564.75, 354.375},
                                                  {-0.33, 0.092, 0.0012, -0.0034, 0.011}));
    }
    EXPECT_EQ(read_foreign(replaced(matlab, "[712,1072]", "[]")).width, 0);
}

TEST(MatlabFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with = [](auto from, auto to) { return foreign_error(replaced(matlab, from, to)); };
    EXPECT_THAT(with("[715.25,0,0]", "[715.25,0.5,0]"),
                HasSubstr("case:1: IntrinsicMatrix: must be [fx skew cx; 0 fy cy; 0 0 1]"));
    EXPECT_THAT(with("\"WorldPoints\"", "\"Skew\":0.25,\"WorldPoints\""),
                HasSubstr("case:1: Skew: contradicts IntrinsicMatrix"));
    EXPECT_THAT(with("\"WorldPoints\"", "\"MappingCoefficients\":[1,2,3,4],\"WorldPoints\""),
                HasSubstr("case:1: DistortionCenter: missing"));
    EXPECT_THAT(with("-0.33,0.092,0.011", "-0.33"),
                HasSubstr("RadialDistortion: must have 2 or 3 coefficients, not 1"));
    EXPECT_THAT(with("715.25", "null"), HasSubstr("IntrinsicMatrix[0][0]: must be a number"));
    EXPECT_THAT(with("\"WorldPoints\"",
                     "\"K\":[[715.25,0,565.75],[0,711.5,355.5],[0,0,1]],\"WorldPoints\""),
                HasSubstr("IntrinsicMatrix: contradicts K"));
    EXPECT_THAT(foreign_error("{\"RadialDistortion\":[1,2]}"), HasSubstr("has none of K"));
}

TEST(BoofCvFile, ReadsBrown) {
    EXPECT_EQ(read_foreign(boofcv), camera_with(640, 480, {530.75, 529.5, 322.75, 234.125},
                                                {-0.24, 0.125, 0.0013, -0.0021}));
    const std::string without = boofcv.substr(0, boofcv.find("radial_tangential:\n"));
    EXPECT_TRUE(
        read_foreign(replaced(without, "model: pinhole_radial_tangential", "model: pinhole"))
            .distortion.is_zero());
}

TEST(BoofCvFile, NamesFileLineAndKeyOfWhatItRefuses) {
    const auto with = [](auto from, auto to) { return foreign_error(replaced(boofcv, from, to)); };
    EXPECT_THAT(with("model: pinhole_radial_tangential", "model: stereo_camera"),
                HasSubstr("case:13: model: must be pinhole, pinhole_radial_tangential, "
                          "omnidirectional_universal or kannala_brandt, not 'stereo"));
    EXPECT_THAT(with("skew: 0.0", "skew: much"), HasSubstr("case:6: pinhole.skew: must be a"));
    EXPECT_THAT(with("fx: 530.75", "fx: wide"), HasSubstr("case:7: pinhole.fx: must be a finite"));
    EXPECT_THAT(with("  - 0.125\n", "  - 0.125\n  - 1\n  - 2\n"),
                HasSubstr("radial_tangential.radial: must have at most 3 coefficients, not 4"));
    EXPECT_THAT(with("  height: 480\n", ""), HasSubstr("pinhole.height: missing"));
}

TEST(ColmapFile, ReadsEveryModelThatWeHave) {
    EXPECT_EQ(read_foreign(colmap_text),
              camera_with(3072, 2304, {2559.75, 2558.5, 1535.75, 1152.25},
                          {-0.2, 0.1, 0.001, -0.002, 0.03, 0.4, -0.05, 0.06}));
    EXPECT_EQ(read_foreign("# list\n1 RADIAL 640 480 500.5 320.5 241.5 0.25 -0.125\n"),
              camera_with(640, 480, {500.5, 500.5, 320.0, 241.0}, {0.25, -0.125}));
    EXPECT_EQ(read_foreign("1 PINHOLE 640 480 500.5 502 320.5 241.5\n").intrinsics.fy, 502);
    EXPECT_EQ(read_foreign("1 SIMPLE_RADIAL 640 480 500.5 320.5 241.5 0.25\n").distortion.k1, 0.25);
}

TEST(ColmapFile, ReadsTheWideModels) {
    const CameraModel fisheye =
        read_foreign("1 OPENCV_FISHEYE 640 480 200.5 202 320.5 241.5 0.1 -0.02 0.003 -0.0004\n");
    EXPECT_EQ(fisheye.projection, LensProjection{Projection::equidistant});
    EXPECT_EQ(fisheye.distortion, (Distortion{.k1 = 0.1, .k2 = -0.02, .k3 = 0.003, .k7 = -0.0004}));
    EXPECT_EQ(read_foreign("1 SIMPLE_RADIAL_FISHEYE 640 480 200.5 320.5 241.5 0.1\n").distortion,
              Distortion{.k1 = 0.1});
    EXPECT_EQ(read_foreign("1 RADIAL_FISHEYE 640 480 200.5 320.5 241.5 0.1 0.2\n").distortion,
              (Distortion{.k1 = 0.1, .k2 = 0.2}));
    EXPECT_EQ(read_foreign("1 THIN_PRISM_FISHEYE 640 480 200.5 202 320.5 241.5 1 2 3 4 5 6 7 8\n")
                  .distortion,
              (Distortion{.k1 = 1, .k2 = 2, .p1 = 3, .p2 = 4, .k3 = 5, .s1 = 7, .s3 = 8, .k7 = 6}));
    const CameraModel fov = read_foreign("1 FOV 640 480 200.5 202 320.5 241.5 0.9\n");
    EXPECT_EQ(fov.projection, (LensProjection{Projection::field_of_view, 0.9}));
    EXPECT_THAT(foreign_error("1 FOV 640 480 200.5 202 320.5 241.5 4\n"),
                HasSubstr("case:1: no field_of_view projection"));
}

// As OpenCV's samples camera_calibration and omni_calibration write them.
TEST(OpenCvFile, ReadsFisheyeAndOmnidir) {
    const std::string text =
        "{\"camera_matrix\": [[538.0, 0, 342.5], [0, 541.0, 233.5], [0, 0, 1]],\n"
        "\"image_width\": 640, \"image_height\": 480,\n"
        "\"distortion_coefficients\": [-0.25, 0.125, 0.5, -0.0625], EXTRA}\n";
    const CameraModel fisheye = read_foreign(replaced(text, "EXTRA", "\"fisheye_model\": 1"));
    EXPECT_EQ(fisheye.projection, LensProjection{Projection::equidistant});
    EXPECT_EQ(fisheye.distortion, (Distortion{.k1 = -0.25, .k2 = 0.125, .k3 = 0.5, .k7 = -0.0625}));
    const CameraModel omnidir = read_foreign(replaced(text, "EXTRA", "\"xi\": 1.25"));
    EXPECT_EQ(omnidir.projection, (LensProjection{Projection::unified, 1.25}));
    EXPECT_EQ(omnidir.distortion.p2, -0.0625);
    EXPECT_TRUE(read_foreign(replaced(text, "EXTRA", "\"fisheye_model\": 0")).projection.is_flat());
    EXPECT_THAT(foreign_error(replaced(text, "EXTRA", "\"xi\": -1")), HasSubstr("xi: no unified"));
    EXPECT_THAT(foreign_error(replaced(text, "EXTRA", "\"xi\": 1, \"fisheye_model\": 1")),
                HasSubstr("of one of the two"));
}

// BoofCV's own example of a Ricoh Theta camera, shortened.
TEST(BoofCvFile, ReadsTheUniversalOmnidirectionalModel) {
    const CameraModel camera =
        read_foreign(replaced(boofcv, "model: pinhole_radial_tangential",
                              "model: omnidirectional_universal\nmirror_offset: 2.945"));
    EXPECT_EQ(camera.projection, (LensProjection{Projection::unified, 2.945}));
    EXPECT_EQ(camera.distortion.k2, 0.125);
    EXPECT_THAT(foreign_error(replaced(boofcv, "model: pinhole_radial_tangential",
                                       "model: omnidirectional_universal\nmirror_offset: -1")),
                HasSubstr("mirror_offset: no unified projection"));
}

TEST(ColmapFile, OneOfSeveralCamerasMustBeNamed) {
    const std::string two = colmap_text + "7 SIMPLE_PINHOLE 640 480 500 320 240\n";
    EXPECT_THAT(foreign_error(two), HasSubstr("has 2 cameras"));
    EXPECT_EQ(read_foreign(two, "7").intrinsics.fx, 500);
    EXPECT_THAT(foreign_error(two, "8"), HasSubstr("has no camera 8"));
    EXPECT_THAT(foreign_error(two + "7 PINHOLE 640 480 1 2 3 4\n", "7"),
                HasSubstr("case:6: camera 7"));
}

TEST(ColmapFile, NamesFileLineAndFieldOfWhatItRefuses) {
    EXPECT_THAT(foreign_error(replaced(colmap_text, "FULL_OPENCV", "DIVISION")),
                HasSubstr("case:4: MODEL: must be SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, "
                          "OPENCV, FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, "
                          "OPENCV_FISHEYE or THIN_PRISM_FISHEYE, not 'DIVISION'"));
    EXPECT_THAT(foreign_error(replaced(colmap_text, " 0.06", "")),
                HasSubstr("case:4: PARAMS: FULL_OPENCV has 12 parameters, not 11"));
    EXPECT_THAT(foreign_error(replaced(colmap_text, "2559.75", "nan")),
                HasSubstr("case:4: PARAMS: must be a finite number, not 'nan'"));
    EXPECT_THAT(foreign_error(replaced(colmap_text, "3072", "-5")),
                HasSubstr("case:4: must be a whole"));
    EXPECT_THAT(foreign_error("1 PINHOLE\n"), HasSubstr("PARAMS: PINHOLE has 4 parameters, not 0"));
    EXPECT_EQ(read_foreign(colmap_text + "\v\n \f#\n", "3").width, 3072);
}

// A camera of which every tool's model holds all coefficients up to the given one.
CameraModel camera_with_coefficients(std::size_t count) {
    CameraModel camera = all_fourteen();
    auto all = camera.distortion.coefficients();
    std::fill(all.begin() + static_cast<std::ptrdiff_t>(count), all.end(), 0.0);
    camera.distortion = Distortion::of(all);
    camera.intrinsics = {2000.0 / 3, 1999.0 / 3, 255.0 + 1.0 / 3, 700.0 / 3};
    return camera;
}

struct Held {
    CalibrationTool tool;
    std::size_t coefficients;
};
constexpr std::array held{Held{CalibrationTool::opencv, 14}, Held{CalibrationTool::ros, 8},
                          Held{CalibrationTool::kalibr, 4},  Held{CalibrationTool::mrcal, 12},
                          Held{CalibrationTool::matlab, 5},  Held{CalibrationTool::boofcv, 5},
                          Held{CalibrationTool::colmap, 8}};

TEST(ForeignFiles, RefuseCoefficientsThatOurOwnFileRefuses) {
    for (const char* huge : {"1e20", "-1e300"})
        EXPECT_THAT(foreign_error(fmt::format(
                        "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n"
                        "  distortion_coeffs: [0.1, {}, 0, 0]\n  resolution: [640, 480]\n"
                        "  intrinsics: [500, 501, 320, 240]\n  rostopic: /c\n",
                        huge)),
                    HasSubstr("case: k2: must be between -1000000000000 and 1000000000000, not"));
}

TEST(ForeignFiles, WriteWhatReadsBack) {
    for (const auto& [tool, most] : held)
        for (const std::size_t count : {0u, 4u, 5u, 8u, 12u, 14u}) {
            if (count > most)
                continue;
            const CameraModel camera = camera_with_coefficients(count);
            const auto path = written("");
            write_foreign_camera(path, tool, camera);
            EXPECT_EQ(tool_of(path), tool) << name_of(tool);
            CameraModel back = read_camera(path);
            const double rounding = first_pixel_centre(tool) == 0.0 ? 0.0 : 1e-13;
            EXPECT_NEAR(back.intrinsics.cx, camera.intrinsics.cx, rounding) << name_of(tool);
            EXPECT_NEAR(back.intrinsics.cy, camera.intrinsics.cy, rounding) << name_of(tool);
            back.intrinsics.cx = camera.intrinsics.cx;
            back.intrinsics.cy = camera.intrinsics.cy;
            EXPECT_EQ(back, camera) << name_of(tool) << " " << count;
        }
}

TEST(OpenCvFile, WritesXmlAndJsonByTheEnding) {
    const CameraModel camera = all_fourteen();
    for (const auto& [name, beginning] :
         {std::pair{"c.xml", "<?xml"}, std::pair{"c.json", "{"}, std::pair{"c.yml", "%YAML"}}) {
        const auto path = written("").replace_filename(name);
        write_foreign_camera(path, CalibrationTool::opencv, camera);
        std::ifstream file(path);
        std::string first;
        file >> first;
        EXPECT_THAT(first, StartsWith(beginning));
        EXPECT_EQ(tool_of(path), CalibrationTool::opencv);
        EXPECT_EQ(read_camera(path), camera) << name;
    }
}

TEST(OpenCvFile, ReadsStandardDeviations) {
    const std::string text =
        "{\"cameraMatrix\": [[538.0, 0, 342.5], [0, 541.0, 233.5], [0, 0, 1]],\n"
        "\"cameraMatrix_std_dev\": [0.5, 0.25, 1.5, 0],\n"
        "\"image_width\": 640, \"image_height\": 480,\n"
        "\"dist_coeffs\": [-0.25, 0.125, 0.5, -0.0625, 7.0],\n"
        "\"dist_coeffs_std_dev\": [0.125, 3, 0, 0, 0.75]}\n";
    const CameraModel camera = read_foreign(text);
    ASSERT_TRUE(camera.covariance);
    EXPECT_THAT(camera.covariance->order, ElementsAre("fx", "fy", "cx", "k1", "k2", "k3"));
    EXPECT_EQ(camera.covariance->matrix(2, 2), 2.25);
    EXPECT_EQ(camera.covariance->matrix(5, 5), 0.5625);
    EXPECT_EQ(camera.covariance->matrix(0, 1), 0.0);
    EXPECT_THAT(foreign_error(replaced(text, "1.5, 0]", "-1.5, 0]")),
                HasSubstr("case:2: cameraMatrix_std_dev: has a standard deviation"));
    for (const char* extreme : {"1e200, 0]", "1e-200, 0]"})
        EXPECT_THAT(foreign_error(replaced(text, "1.5, 0]", extreme)),
                    HasSubstr("cameraMatrix_std_dev: has a standard deviation"));
    EXPECT_THAT(foreign_error(replaced(text, "1.5, 0]", "1.5, 0, 9]")), HasSubstr("at most 4"));
}

// Laid out as the example in OpenCV's tutorial on the interactive calibration.
TEST(OpenCvFile, ReadsWhatTheInteractiveCalibrationWrites) {
    const std::string text =
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n"
        "<calibrationDate>\"Sat 07 Mar 2026 02:05:09 PM UTC\"</calibrationDate>\n"
        "<framesCount>21</framesCount>\n"
        "<cameraResolution>\n  1280 720</cameraResolution>\n"
        "<cameraMatrix type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n"
        "  <dt>d</dt>\n  <data>\n    1252.5 0. 666.75 0. 1251.25 363.5 0. 0. 1.</data>"
        "</cameraMatrix>\n"
        "<cameraMatrix_std_dev type_id=\"opencv-matrix\">\n  <rows>4</rows>\n  <cols>1</cols>\n"
        "  <dt>d</dt>\n  <data>\n    0. 12.5 2.75 2.5</data></cameraMatrix_std_dev>\n"
        "<dist_coeffs type_id=\"opencv-matrix\">\n  <rows>1</rows>\n  <cols>5</cols>\n"
        "  <dt>d</dt>\n  <data>\n    0.125 -0.75 0. 0. 1.5</data></dist_coeffs>\n"
        "<dist_coeffs_std_dev type_id=\"opencv-matrix\">\n  <rows>5</rows>\n  <cols>1</cols>\n"
        "  <dt>d</dt>\n  <data>\n    0.015625 0.09375 0. 0. 0.1875</data></dist_coeffs_std_dev>\n"
        "<avg_reprojection_error>0.42</avg_reprojection_error>\n</opencv_storage>\n";
    const CameraModel camera = read_foreign(text);
    EXPECT_EQ(camera.width, 1280);
    EXPECT_EQ(camera.height, 720);
    EXPECT_EQ(camera.intrinsics.fy, 1251.25);
    EXPECT_EQ(camera.distortion.k3, 1.5);
    ASSERT_TRUE(camera.covariance);
    EXPECT_THAT(camera.covariance->order, ElementsAre("fy", "cx", "cy", "k1", "k2", "k3"));
    EXPECT_EQ(camera.covariance->matrix(5, 5), 0.1875 * 0.1875);
    EXPECT_THAT(foreign_error(replaced(text, "1280 720", "1280")), HasSubstr("cameraResolution"));
    EXPECT_THAT(foreign_error(replaced(text, "1280 720", "1280 -720")),
                HasSubstr("cameraResolution"));
    EXPECT_THAT(
        foreign_error(replaced(text, "<framesCount>21</framesCount>",
                               "<image_width>1280</image_width><image_height>720</image_height>")),
        HasSubstr("is given as 'image_width' too"));
}

TEST(OpenCvFile, WritesStandardDeviationsThatReadBack) {
    CameraModel camera = camera_with_coefficients(5);
    // Of k6 too, which is 0: the list of coefficients must reach so far.
    camera.covariance = ParameterCovariance{{"cy", "fx", "k6", "p1"}, Eigen::MatrixXd::Zero(4, 4)};
    camera.covariance->matrix.diagonal() << 0.25, 9.0, 0.0625, 7.0;
    camera.covariance->matrix(0, 1) = camera.covariance->matrix(1, 0) = 0.5;
    for (const char* name : {"c.xml", "c.json", "c.yml"}) {
        const auto path = written("").replace_filename(name);
        write_foreign_camera(path, CalibrationTool::opencv, camera);
        const CameraModel back = read_camera(path);
        EXPECT_EQ(back.distortion.in_opencv_order(), camera.distortion.in_opencv_order());
        ASSERT_TRUE(back.covariance) << name;
        EXPECT_THAT(back.covariance->order, ElementsAre("fx", "cy", "p1", "k6"));
        EXPECT_EQ(back.covariance->matrix(0, 0), 9.0);
        EXPECT_EQ(back.covariance->matrix(1, 1), 0.25);
        EXPECT_NEAR(back.covariance->matrix(2, 2), 7.0, 1e-14);  // sqrt(7) squared
        EXPECT_EQ(back.covariance->matrix(3, 3), 0.0625);
        EXPECT_EQ(back.covariance->matrix(0, 1), 0.0);  // what the file has no place for
    }
}

TEST(ForeignFiles, RefuseACoefficientThatTheyCannotHold) {
    for (const auto& [tool, most] : held) {
        if (most == 14)
            continue;
        CameraModel camera = camera_with_coefficients(most);
        camera.distortion.tau_y = 0.125;
        EXPECT_THAT(
            text_of_error<ConfigError>(
                [&, tool = tool] { write_foreign_camera(written(""), tool, camera); }),
            HasSubstr("has no place for tau_y = 0.125"))
            << name_of(tool);
    }
}

// The tool's own pixels, by its documentation: OpenCV's call the centre of the first pixel 0,
// COLMAP's (and BoofCV's) 0.5, MATLAB's 1. A point is projected by hand in the tool's pixels, then
// by us in ours; the difference must be exactly where that tool sees our pixel (0, 0).
TEST(ForeignFiles, PointsProjectOntoTheSamePixelOfTheSensor) {
    struct Case {
        const std::string& text;
        double fx, fy, cx, cy;  // as the file says
        double first_pixel;
    };
    const std::string plain_mrcal =
        "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [500.5, 502.25, 320.5, 241.75],\n"
        "'extrinsics': [0,0,0,0,0,0], 'imagersize': [640, 480]}\n";
    const std::string plain_kalibr =
        replaced(kalibr, "[-0.27, 0.067, 0.00087, 0.00011]", "[0, 0, 0, 0]");
    const std::string plain_matlab =
        replaced(replaced(matlab, "-0.33,0.092,0.011", "0,0"), "0.0012,-0.0034", "0,0");
    const std::string plain_boofcv = replaced(boofcv.substr(0, boofcv.find("radial_tangential:\n")),
                                              "model: pinhole_radial_tangential", "model: pinhole");
    const std::string plain_colmap = "1 PINHOLE 640 480 500.5 502.25 320.5 241.75\n";
    const Eigen::Vector3d point(0.21, -0.13, 1.4);
    for (const Case& c : {Case{plain_mrcal, 500.5, 502.25, 320.5, 241.75, 0.0},
                          Case{plain_kalibr, 461.5, 460.25, 362.75, 246.125, 0.0},
                          Case{plain_matlab, 715.25, 711.5, 565.75, 355.375, 1.0},
                          Case{plain_boofcv, 530.75, 529.5, 323.25, 234.625, 0.5},
                          Case{plain_colmap, 500.5, 502.25, 320.5, 241.75, 0.5}}) {
        const auto ours = Projector(read_foreign(c.text)).project(point);
        ASSERT_TRUE(ours);
        EXPECT_NEAR(c.fx * 0.15 + c.cx - (*ours)(0), c.first_pixel, 1e-12) << c.text;
        EXPECT_NEAR(c.fy * -0.13 / 1.4 + c.cy - (*ours)(1), c.first_pixel, 1e-12) << c.text;
    }
}

TEST(ForeignFiles, SayWhatTheyDoNotHold) {
    CameraModel camera = webcam();
    const auto lost = [&](CalibrationTool tool) { return lost_in_foreign_file(tool, camera); };
    EXPECT_TRUE(lost(CalibrationTool::ros).empty());
    camera.serial = "U3V-7";
    camera.sensor = Sensor{.pixel_pitch_um = 5};
    EXPECT_THAT(lost(CalibrationTool::ros), ElementsAre("serial", "sensor"));
    camera.covariance = ParameterCovariance{{"fx", "k1"}, Eigen::Matrix2d::Identity()};
    EXPECT_THAT(lost(CalibrationTool::ros), ElementsAre("serial", "covariance", "sensor"));
    EXPECT_THAT(lost(CalibrationTool::opencv), ElementsAre("serial", "sensor"));
    camera.covariance->matrix(0, 1) = camera.covariance->matrix(1, 0) = 0.5;
    EXPECT_THAT(lost(CalibrationTool::opencv),
                ElementsAre("serial", "correlations of the covariance", "sensor"));
    camera.projection.kind = Projection::telecentric;
    EXPECT_THROW(write_foreign_camera(written(""), CalibrationTool::colmap, camera), ConfigError);
}

TEST(ForeignFiles, ASelectionNeedsSeveralCameras) {
    EXPECT_THAT(foreign_error(mrcal, "cam1"), HasSubstr("there is nothing to select"));
}

// ---- installed tools

// What we write, read and used by the tool that it is for, where that is installed.

// Debian's own interpreter, which has Debian's modules.
constexpr const char* python = "/usr/bin/python3";

bool succeeds(const std::string& command) {
    return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

std::vector<Eigen::Vector2d> projected_by_mrcal(const TemporaryFolder& folder,
                                                const std::vector<Eigen::Vector3d>& points) {
    std::string lines;
    for (const Eigen::Vector3d& point : points)
        lines += fmt::format("{} {} {}\n", point.x(), point.y(), point.z());
    write_text(folder / "points.txt", lines);
    write_text(folder / "project.py",
               "import mrcal, numpy\n"
               "model = mrcal.cameramodel('camera.cameramodel')\n"
               "for pixel in mrcal.project(numpy.loadtxt('points.txt'), *model.intrinsics()):\n"
               "    print(repr(float(pixel[0])), repr(float(pixel[1])))\n");
    const std::string command =
        fmt::format("cd '{}' && {} project.py > pixels.txt", (folder / "").string(), python);
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::istringstream answer(read_text(folder / "pixels.txt"));
    std::vector<Eigen::Vector2d> pixels;
    for (double x, y; answer >> x >> y;)
        pixels.emplace_back(x, y);
    return pixels;
}

// Over the whole image: our ray of a pixel, projected there, is the pixel; and so here.
TEST(InstalledTools, MrcalProjectsAsWeDo) {
    if (!succeeds(fmt::format("{} -c 'import mrcal'", python)))
        GTEST_SKIP() << "mrcal is not installed (python3-mrcal)";
    std::vector<CameraModel> cameras{webcam(), all_fourteen(),
                                     wide_truth({Projection::stereographic}, 140.0),
                                     wide_truth(cahvors()[0], 400.0)};
    cameras[1].distortion.tau_x = cameras[1].distortion.tau_y = 0.0;
    for (const LensProjection& projection :
         {cahvors()[2], cahvors()[3], cahvors()[4], splines()[0], splines()[1]})
        cameras.push_back(wide_truth(projection, 140.0));
    for (const CameraModel& camera : cameras) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const TemporaryFolder folder;
        write_foreign_camera(folder / "camera.cameramodel", CalibrationTool::mrcal, camera);
        const Projector projector(camera);
        std::vector<Eigen::Vector3d> rays;
        std::vector<Eigen::Vector2d> pixels;
        for (int y = 0; y < camera.height; y += 20)
            for (int x = 0; x < camera.width; x += 20)
                if (const auto ray = projector.ray({x, y})) {
                    rays.push_back(617.0 * *ray);
                    pixels.emplace_back(x, y);
                }
        const auto theirs = projected_by_mrcal(folder, rays);
        ASSERT_EQ(theirs.size(), rays.size());
        ASSERT_GT(rays.size(), 600u);
        for (std::size_t i = 0; i < rays.size(); ++i) {
            ASSERT_LT((theirs[i] - pixels[i]).norm(), 1e-9) << pixels[i].transpose();
            ASSERT_LT((*projector.project(rays[i]) - theirs[i]).norm(), 1e-9);
        }
    }
}

// ---- COLMAP

constexpr const char* colmap = "QT_QPA_PLATFORM=offscreen colmap";

struct Sighting {
    Eigen::Vector3d point;
    Eigen::Vector2d pixel;
};

// COLMAP measures how far each point of a reconstruction lies from its two sightings when it
// filters them: here both by the same camera, at the origin. The mean distance of each point, px.
std::vector<double> distances_by_colmap(const TemporaryFolder& folder,
                                        const std::vector<Sighting>& sightings) {
    std::string seen, points;
    for (std::size_t i = 0; i < sightings.size(); ++i) {
        const auto& [point, pixel] = sightings[i];
        const Eigen::Vector2d theirs = pixel.array() + 0.5;
        seen += fmt::format("{} {} {} ", theirs.x(), theirs.y(), i + 1);
        points += fmt::format("{} {} {} {} 0 0 0 9 1 {} 2 {}\n", i + 1, point.x(), point.y(),
                              point.z(), i, i);
    }
    write_text(folder / "images.txt",
               "1 1 0 0 0 0 0 0 1 a.png\n" + seen + "\n2 1 0 0 0 0 0 0 1 b.png\n" + seen + "\n");
    write_text(folder / "points3D.txt", points);
    const std::string command = fmt::format(
        "cd '{0}' && mkdir out && {1} point_filtering --input_path . --output_path out "
        "--max_reproj_error 1e-3 --min_tri_angle 0 --min_track_len 2 >log 2>&1 && "
        "{1} model_converter --input_path out --output_path out --output_type TXT >log 2>&1",
        (folder / "").string(), colmap);
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::istringstream lines(read_text(folder / "out/points3D.txt"));
    std::vector<double> distances;
    for (std::string line; std::getline(lines, line);) {
        double number[8] = {};
        std::istringstream words(line);
        for (double& word : number)
            words >> word;
        if (words)
            distances.push_back(number[7]);
    }
    return distances;
}

std::vector<CameraModel> cameras_of_colmap() {
    using enum Projection;
    CameraModel pinhole = webcam(), full = all_fourteen();
    pinhole.distortion = {};
    auto coefficients = full.distortion.coefficients();
    std::fill(coefficients.begin() + 8, coefficients.end(), 0.0);  // from s1 on
    full.distortion = Distortion::of(coefficients);
    CameraModel four = pinhole;
    four.distortion = {.k1 = -0.286, .k2 = 0.057, .p1 = 0.0021, .p2 = -0.0034};
    const Distortion kannala_brandt{.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4};
    Distortion prism = kannala_brandt;
    prism.p1 = 0.0012;
    prism.p2 = -0.0007;
    prism.s1 = 0.001;
    prism.s3 = -0.002;
    return {pinhole,
            four,
            full,
            wide_truth({field_of_view, 0.93}, 190.0),
            wide_truth({equidistant}, 181.0, kannala_brandt),
            wide_truth({equidistant}, 181.0, prism)};
}

// Over the whole image, as far as COLMAP goes: not beside or behind the camera.
TEST(InstalledTools, ColmapProjectsAsWeDo) {
    if (!succeeds(fmt::format("{} help", colmap)))
        GTEST_SKIP() << "COLMAP is not installed (colmap)";
    for (const CameraModel& camera : cameras_of_colmap()) {
        const TemporaryFolder folder;
        write_foreign_camera(folder / "cameras.txt", CalibrationTool::colmap, camera);
        SCOPED_TRACE(read_text(folder / "cameras.txt"));
        const Projector projector(camera);
        std::vector<Sighting> sightings;
        for (int y = 0; y < camera.height; y += 20)
            for (int x = 0; x < camera.width; x += 20)
                if (const auto ray = projector.ray({x, y}); ray && ray->z() > 0.1)
                    sightings.push_back({617.0 * *ray, {x, y}});
        const std::vector<double> distances = distances_by_colmap(folder, sightings);
        ASSERT_GT(sightings.size(), 400u);
        ASSERT_EQ(distances.size(), sightings.size());
        EXPECT_LT(*std::max_element(distances.begin(), distances.end()), 1e-9);
    }
}

}  // namespace
}  // namespace etalon
