// `etalon detect` and `etalon compare`: station/shell/command.h.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace etalon {

class Command;

struct DetectArguments {
    std::string marker;
    std::filesystem::path camera;
    std::vector<std::filesystem::path> photos;
    std::string detector = "auto";
    std::filesystem::path poses;  // starts for the photometric detector; empty: another detector's
    bool json = false;
};
int run_detect(const DetectArguments& arguments);

struct CompareArguments {
    std::filesystem::path camera, out;
    std::string board;  // "9x6" with square_mm, or a marker
    double square_mm = 0.0;
    std::string marker;
    std::string detector = "auto";
    std::filesystem::path poses;     // optional pose file, one row per photo
    std::string score_margin;        // "X,Y" in squares
    std::filesystem::path baseline;  // optional folder of an earlier comparison
    std::vector<std::filesystem::path> photos;
    bool json = false;
};
int run_compare(const CompareArguments& arguments);

void declare_detect(Command& program);
void declare_compare(Command& program);

}  // namespace etalon
