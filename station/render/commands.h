// `etalon marker` and `etalon render`: station/shell/command.h.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace etalon {

class Command;

struct MarkerArguments {
    std::string marker;         // "apriltag:36h11:5@50mm"
    std::filesystem::path out;  // .svg, .pdf or .png
    double dots_per_mm = 40.0;  // of a PNG
    bool json = false;
};
int run_marker(const MarkerArguments& arguments);

// One image, or with a pose file an image set: out is then a folder.
struct RenderArguments {
    std::filesystem::path camera, out;
    std::vector<std::string> markers;
    std::vector<std::string> poses;  // "rx,ry,rz,tx,ty,tz", one a marker
    std::filesystem::path
        pose_file;                 // a set: camera_from_scene by image, `poses` place the markers
    std::string background = "1";  // a radiance, or an image file
    std::string method = "auto";   // auto, E, C or reference
    double tolerance_gray = 0.1;
    double exposure = 1.0;                    // factor on the radiance before the sensor
    std::string velocity;                     // "wx,wy,wz,vx,vy,vz", rad/s and mm/s; empty: still
    double shutter_ms = 0.0;                  // how long it moves
    std::string shard;                        // of a set: "2/5"; empty: all
    bool linear = false;                      // 32-bit TIFF of radiance
    std::optional<std::uint64_t> noise_seed;  // shot and read noise of the camera's sensor
    bool explain = false;                     // print the plan
    bool json = false;
};
int run_render(const RenderArguments& arguments);

void declare_marker(Command& program);
void declare_render(Command& program);

}  // namespace etalon
