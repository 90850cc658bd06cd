// `etalon calibrate`, `characterise` and `camera show|convert|check`: station/shell/command.h.
#pragma once

#include "compare/characterise/characterisation.h"

namespace etalon {

class Command;

// Either a target or, in short for a chessboard, board and square_mm.
struct CalibrateArguments {
    std::string target;  // "chessboard:9x6@25mm"
    std::string board;   // "9x6"
    double square_mm = 0.0;
    std::vector<std::filesystem::path> photos;
    std::string model = "auto";        // or the name of a calibration model
    std::string refine;                // empty or "photometric"
    bool fit_board = false;            // the board's shape with the camera
    std::filesystem::path out;         // camera.yml
    std::filesystem::path opencv_out;  // optional: the same as OpenCV YAML
    std::filesystem::path report;      // optional: folder
    bool json = false;
};
int run_calibrate(const CalibrateArguments& arguments);

// What is not given is not measured. Exit code 2 when photographs were given that cannot be used.
struct CharacteriseArguments {
    std::filesystem::path camera;
    std::string target;                                        // "chessboard:9x6@25mm"
    std::vector<std::filesystem::path> photos;                 // the target in several places
    std::vector<std::filesystem::path> repeats, flats, darks;  // one view; uniform field; no light
    std::filesystem::path exposures;                           // CSV file,exposure_us
    std::string edge;  // "auto" or "X,Y,WxH": slanted edges of any photographs, and nothing else
    std::filesystem::path out;     // camera.yml
    std::filesystem::path report;  // folder; empty: none
    bool json = false;
};
int run_characterise(const CharacteriseArguments& arguments);
int run_edge(const CharacteriseArguments& arguments);  // of run_characterise(), with `edge`

// "gain 3.021 +- 0.034 e/DN": U = 2u with two digits, the value to the same place.
std::string with_uncertainty(const MeasuredValue& value);

// Writes report.html into the folder, which is made. Throws ConfigError when it cannot be written.
void write_characterise_report(const std::filesystem::path& folder, const CharacteriseInput& input,
                               const Characterisation& result);

// `etalon camera show|convert|check`.
struct CameraFileArguments {
    std::filesystem::path file, out;  // out: convert
    std::string select;               // which of several cameras; empty: the only one
    std::string to;                   // convert: etalon or a tool's name
    bool json = false;
};
int run_camera_show(const CameraFileArguments& arguments);
int run_camera_convert(const CameraFileArguments& arguments);
int run_camera_check(const CameraFileArguments& arguments);

void declare_calibrate(Command& program);
void declare_characterise(Command& program);
void declare_camera(Command& program);

}  // namespace etalon
