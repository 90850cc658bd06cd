#include "sim/marker/tag_pattern.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>

#include <opencv2/core/version.hpp>
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
#include <opencv2/objdetect/aruco_dictionary.hpp>
#else
#include <opencv2/aruco/dictionary.hpp>
#endif

#include <algorithm>
#include <memory>

#include "core/program/errors.h"
#include "sim/marker/cell_grid.h"

namespace etalon {
namespace {

struct Family {
    const char* name;
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
};

constexpr Family families[] = {
    {"16h5", tag16h5_create, tag16h5_destroy},
    {"25h9", tag25h9_create, tag25h9_destroy},
    {"36h10", tag36h10_create, tag36h10_destroy},
    {"36h11", tag36h11_create, tag36h11_destroy},
    {"Circle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    {"Circle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    {"Custom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    {"Standard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    {"Standard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
};

using FamilyTable = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;

FamilyTable load_family(const std::string& name) {
    for (const Family& family : families) {
        if (name == family.name)
            return {family.create(), family.destroy};
    }
    throw ConfigError({}, "no AprilTag family '" + name + "'");
}

// The ring of cells just inside the square that starts at `start` and is `side` cells wide.
void paint_ring(cv::Mat& cells, int start, int side, float radiance) {
    const auto value = cv::Scalar::all(radiance);
    cells(cv::Rect(start, start, side, 1)).setTo(value);
    cells(cv::Rect(start, start + side - 1, side, 1)).setTo(value);
    cells(cv::Rect(start, start, 1, side)).setTo(value);
    cells(cv::Rect(start + side - 1, start, 1, side)).setTo(value);
}

// 4.6 returns a shared pointer from the contrib module, 4.7 and later a value from objdetect.
cv::aruco::Dictionary load_dictionary(const std::string& name) {
    const auto& names = aruco_dictionaries();
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
        throw ConfigError({}, "no ArUco dictionary '" + name + "'");
    const int number = static_cast<int>(found - names.begin());
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
    return cv::aruco::getPredefinedDictionary(number);
#else
    return *cv::aruco::getPredefinedDictionary(number);
#endif
}

}  // namespace

const std::vector<std::string>& apriltag_families() {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> list;
        std::ranges::transform(families, std::back_inserter(list), &Family::name);
        return list;
    }();
    return names;
}

const std::vector<std::string>& aruco_dictionaries() {
    static const std::vector<std::string> names {
        "4X4_50", "4X4_100", "4X4_250", "4X4_1000", "5X5_50", "5X5_100", "5X5_250", "5X5_1000",
            "6X6_50", "6X6_100", "6X6_250", "6X6_1000", "7X7_50", "7X7_100", "7X7_250", "7X7_1000",
            "ARUCO_ORIGINAL", "APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11",
#if CV_VERSION_MAJOR * 100 + CV_VERSION_MINOR >= 407
            "ARUCO_MIP_36h12",
#endif
    };
    return names;
}

int apriltag_count(const std::string& family) {
    return static_cast<int>(load_family(family)->ncodes);
}

int aruco_count(const std::string& dictionary) {
    return load_dictionary(dictionary).bytesList.rows;
}

TagPattern apriltag_pattern(const std::string& family, int id) {
    const FamilyTable table = load_family(family);
    // `total_width` counts the classic families' white frame; the others have none of their own.
    const int frame = table->reversed_border ? 1 : 0;
    const int side = table->total_width + 2 * frame;
    TagPattern pattern;
    pattern.cells = cv::Mat(side, side, CV_32FC1, cv::Scalar::all(white));
    pattern.reference_cells = table->width_at_border;
    pattern.reference_start = (side - table->width_at_border) / 2;
    paint_ring(pattern.cells, pattern.reference_start, pattern.reference_cells,
               table->reversed_border ? white : black);
    paint_ring(pattern.cells, pattern.reference_start - 1, pattern.reference_cells + 2,
               table->reversed_border ? black : white);
    const std::uint64_t code = table->codes[id];
    for (std::uint32_t i = 0; i < table->nbits; ++i) {
        // Positions are relative to the reference square; those outside it are negative numbers
        // in an unsigned type. The code's highest bit comes first.
        const int x = pattern.reference_start + static_cast<int>(table->bit_x[i]);
        const int y = pattern.reference_start + static_cast<int>(table->bit_y[i]);
        pattern.cells.at<float>(y, x) = (code >> (table->nbits - 1 - i)) & 1 ? white : black;
    }
    return pattern;
}

TagPattern aruco_pattern(const std::string& dictionary, int id) {
    const cv::aruco::Dictionary table = load_dictionary(dictionary);
    const int bits = table.markerSize;
    TagPattern pattern;
    pattern.cells = cv::Mat(bits + 4, bits + 4, CV_32FC1, cv::Scalar::all(white));
    pattern.reference_start = 1;
    pattern.reference_cells = bits + 2;
    paint_ring(pattern.cells, 1, bits + 2, black);
    cv::aruco::Dictionary::getBitsFromByteList(table.bytesList.rowRange(id, id + 1), bits)
        .convertTo(pattern.cells(cv::Rect(2, 2, bits, bits)), CV_32F);
    return pattern;
}

}  // namespace etalon
