// Fuzzes the parsers of other tools' calibration files, each directly: damaged files must be read
// as a camera without a number that is not finite, or refused with a ConfigError.
//
//     calibration_fuzz SECONDS [SEED]
//
// Prints every violation with the parser and the seed that repeats it (calibration_fuzz 0 SEED),
// then the counts by parser. Exit code 1 when there was a violation, or a parser that accepted
// nothing or refused nothing in a run of some seconds.
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "calib/files/boofcv_file.h"
#include "calib/files/camera_file.h"
#include "calib/files/colmap_file.h"
#include "calib/files/kalibr_file.h"
#include "calib/files/matlab_file.h"
#include "calib/files/mrcal_file.h"
#include "calib/files/opencv_file.h"
#include "calib/files/ros_file.h"
#include "core/errors.h"
#include "core/random.h"
#include "tests/fuzz/damaged_files.h"
#include "tests/temporary_folder.h"

namespace etalon::test {
namespace {

struct Parser {
    const char* name;
    CameraModel (*read)(const std::filesystem::path&);
    const char* valid;
    long accepted = 0, refused = 0;
};

CameraModel any(const std::filesystem::path& path) {
    return read_camera(path);
}

constexpr const char* kalibr =
    "cam0:\n  cam_overlaps: []\n  camera_model: pinhole\n"
    "  distortion_coeffs: [-0.27, 0.067, 0.00087, 0.00011]\n  distortion_model: radtan\n"
    "  intrinsics: [461.5, 460.25, 362.75, 246.125]\n  resolution: [752, 480]\n";
constexpr const char* mrcal =
    "# note\n{\n    'lensmodel':  'LENSMODEL_OPENCV5',\n"
    "    'intrinsics': [ 1766.5, 1765.25, 1944.75, 1064.125, 2.16, -1.18, -9.3e-05, 0.00077, 1,],\n"
    "    'extrinsics': [ 0, 0, 0, 0, 0, 0,],\n    'imagersize': [ 3840, 2160,],\n"
    "    'optimization_inputs': b'P)h>@6a{}[]#w',\n}\n";
constexpr const char* matlab =
    "{\"RadialDistortion\":[-0.33,0.092,0.011],\"TangentialDistortion\":[0.0012,-0.0034],"
    "\"ImageSize\":[712,1072],\"Skew\":0,\"ReprojectionErrors\":null,"
    "\"IntrinsicMatrix\":[[715.25,0,0],[0,711.5,0],[565.75,355.375,1]],"
    "\"K\":[[715.25,0,565.75],[0,711.5,355.375],[0,0,1]]}";
constexpr const char* boofcv =
    "pinhole:\n  skew: 0.0\n  fx: 530.75\n  width: 640\n  fy: 529.5\n  cx: 323.25\n  cy: 234.625\n"
    "  height: 480\nmodel: pinhole_radial_tangential\nversion: 0\nradial_tangential:\n"
    "  t1: 0.0013\n  radial:\n  - -0.24\n  - 0.125\n  t2: -0.0021\n";
constexpr const char* colmap =
    "# Number of cameras: 1\n3 FULL_OPENCV 3072 2304 2559.75 2558.5 1536.25 1152.75 -0.2 0.1 0.001 "
    "-0.002 0.03 0.4 -0.05 0.06\n";
constexpr const char* ros =
    "image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [538, 0, 342.5, 0, 541, 233.5, 0, 0, 1]\ndistortion_model: plumb_bob\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.25, 0.125, 0.5, -0.0625, 7]\n";
constexpr const char* opencv =
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n"
    "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 538., 0., 342.5, 0., 541., 233.5, 0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
    "   data: [ -0.25, 0.125, 0.5, -0.0625, 7. ]\n";
constexpr const char* opencv_interactive =
    "<?xml version=\"1.0\"?>\n<opencv_storage>\n<cameraResolution>\n  1280 720</cameraResolution>\n"
    "<cameraMatrix type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n"
    "  <data>\n    1252.5 0. 666.75 0. 1251.25 363.5 0. 0. 1.</data></cameraMatrix>\n"
    "<cameraMatrix_std_dev type_id=\"opencv-matrix\">\n  <rows>4</rows>\n  <cols>1</cols>\n"
    "  <dt>d</dt>\n  <data>\n    0. 12.5 2.75 2.5</data></cameraMatrix_std_dev>\n"
    "<dist_coeffs type_id=\"opencv-matrix\">\n  <rows>1</rows>\n  <cols>5</cols>\n  <dt>d</dt>\n"
    "  <data>\n    0.125 -0.75 0. 0. 1.5</data></dist_coeffs>\n"
    "<dist_coeffs_std_dev type_id=\"opencv-matrix\">\n  <rows>5</rows>\n  <cols>1</cols>\n"
    "  <dt>d</dt>\n  <data>\n    0.015625 0.09375 0. 0. 0.1875</data></dist_coeffs_std_dev>\n"
    "</opencv_storage>\n";
constexpr const char* opencv_json =
    "{\n    \"image_width\": 640,\n    \"image_height\": 480,\n    \"camera_matrix\": {\n"
    "        \"type_id\": \"opencv-matrix\",\n        \"rows\": 3,\n        \"cols\": 3,\n"
    "        \"dt\": \"d\",\n        \"data\": [ 538.0, 0.0, 342.5, 0.0, 541.0, 233.5, 0.0, 0.0, "
    "1.0 ]\n"
    "    },\n    \"distortion_coefficients\": [ -0.25, 0.125, 0.5, -0.0625, 7.0 ]\n}\n";

std::array parsers{
    Parser{"kalibr", [](const auto& path) { return read_kalibr_camera(path); }, kalibr},
    Parser{"mrcal", read_mrcal_camera, mrcal},
    Parser{"matlab", read_matlab_camera, matlab},
    Parser{"boofcv", read_boofcv_camera, boofcv},
    Parser{"colmap", [](const auto& path) { return read_colmap_camera(path); }, colmap},
    Parser{"ros", read_ros_camera, ros},
    Parser{"opencv", read_opencv_camera, opencv},
    Parser{"opencv, XML", read_opencv_camera, opencv_interactive},
    Parser{"opencv, JSON", read_opencv_camera, opencv_json},
    Parser{"any, of kalibr", any, kalibr},
    Parser{"any, of mrcal", any, mrcal},
    Parser{"any, of colmap", any, colmap}};

bool is_sound(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    bool finite = std::isfinite(i.fx) && std::isfinite(i.fy) && std::isfinite(i.cx) &&
                  std::isfinite(i.cy) && i.fx > 0.0 && i.fy > 0.0;
    for (const double coefficient : camera.distortion.in_opencv_order())
        finite = finite && std::isfinite(coefficient);
    if (camera.covariance)
        finite = finite && camera.covariance->matrix.allFinite() &&
                 (camera.covariance->matrix.diagonal().array() > 0.0).all();
    return finite && camera.width >= 0 && camera.height >= 0;
}

// What is wrong with how the parser took the file; empty: nothing.
std::string violation_of(Parser& parser, const std::filesystem::path& path) {
    try {
        const CameraModel camera = parser.read(path);
        ++parser.accepted;
        return is_sound(camera) ? "" : "accepted a camera that is none";
    } catch (const ConfigError&) {
        ++parser.refused;
        return "";
    } catch (const std::exception& error) {
        return error.what();
    }
}

int fuzz(double seconds, std::uint64_t seed) {
    const TemporaryFolder folder;
    const auto path = folder / "camera";
    const auto start = std::chrono::steady_clock::now();
    long violations = 0, rounds = 0;
    do {
        for (Parser& parser : parsers) {
            RandomStream random(seed, 11);
            std::ofstream(path, std::ios::binary) << damaged(parser.valid, random);
            const std::string violation = violation_of(parser, path);
            if (violation.empty())
                continue;
            ++violations;
            std::printf("VIOLATION %s, seed %llu: %s\n", parser.name,
                        static_cast<unsigned long long>(seed), violation.c_str());
        }
        ++seed;
        ++rounds;
    } while (std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() <
             seconds);
    for (const Parser& parser : parsers) {
        std::printf("%-16s %8ld read %8ld refused\n", parser.name, parser.accepted, parser.refused);
        if (rounds > 100 && (parser.accepted == 0 || parser.refused == 0))
            ++violations;
    }
    std::printf("%ld violations\n", violations);
    return violations > 0 ? 1 : 0;
}

}  // namespace
}  // namespace etalon::test

int main(int argc, char** argv) {
    if (argc < 2 || argc > 3) {
        std::fprintf(stderr, "usage: calibration_fuzz SECONDS [SEED]\n");
        return 3;
    }
    return etalon::test::fuzz(std::strtod(argv[1], nullptr),
                              argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1);
}
