// libapriltag 3. Its C handles never leave this file.
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
#include <fmt/format.h>

#include <cmath>

#include "compare/detect/detector_adaptors.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct FamilyMaker {
    const char* name;
    apriltag_family_t* (*create)();
    void (*destroy)(apriltag_family_t*);
};

constexpr FamilyMaker family_makers[] = {
    {"36h11", tag36h11_create, tag36h11_destroy},
    {"36h10", tag36h10_create, tag36h10_destroy},
    {"25h9", tag25h9_create, tag25h9_destroy},
    {"16h5", tag16h5_create, tag16h5_destroy},
    {"Circle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    {"Circle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    {"Custom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    {"Standard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    {"Standard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
};

using Family = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;
using Finder = std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)>;
using Detections = std::unique_ptr<zarray_t, void (*)(zarray_t*)>;

Family make_family(const std::string& name) {
    for (const FamilyMaker& maker : family_makers)
        if (name == maker.name)
            return {maker.create(), maker.destroy};
    throw ConfigError({}, "libapriltag has no family '" + name + "'");
}

// The library's families have a border of one cell; wider ones move the data inwards.
void widen_border(apriltag_family_t& family, int border_cells) {
    const int more = border_cells - 1;
    family.width_at_border += 2 * more;
    family.total_width += 2 * more;
    for (std::uint32_t i = 0; i < family.nbits; ++i) {
        family.bit_x[i] += static_cast<std::uint32_t>(more);
        family.bit_y[i] += static_cast<std::uint32_t>(more);
    }
}

// The library cuts other factors to whole numbers when it reduces the image, and takes them as they
// are when it scales the outlines back: the corners would be pixels off.
void require_exact_decimation(double factor, const std::string& place) {
    constexpr double max_factor = 8.0;
    const bool is_whole = factor >= 1.0 && factor <= max_factor && factor == std::floor(factor);
    if (!is_whole && factor != 1.5)
        throw ConfigError(
            {place, 0, "quad_decimate"},
            fmt::format("{} is not 1, 1.5 or a whole number up to {}", factor, max_factor));
}

}  // namespace

struct ApriltagFinder::Handles {
    Family family;  // outlives the finder, which refers to it
    Finder finder;
};

ApriltagFinder::ApriltagFinder(const std::string& family, int border_cells,
                               const ApriltagOptions& options)
    : handles_(new Handles{make_family(family),
                           {apriltag_detector_create(), apriltag_detector_destroy}}) {
    if (border_cells > 1)
        widen_border(*handles_->family, border_cells);
    apriltag_detector_t& finder = *handles_->finder;
    finder.nthreads = 1;  // the same image gives the same result
    finder.quad_decimate = static_cast<float>(options.quad_decimate);
    finder.refine_edges = options.refine_edges;
    // The library's table of correctable codes grows with codes * bits^errors: two wrong bits in a
    // family of 42 211 codes would take gigabytes.
    apriltag_detector_add_family_bits(&finder, handles_->family.get(),
                                      handles_->family->ncodes > 5000 ? 1 : 2);
}

std::vector<DetectedCorners> ApriltagFinder::find(cv::Mat image) const {
    constexpr int min_tag = 8;  // px; the library's tiles need this much, too
    const double smallest_side = min_tag * handles_->finder->quad_decimate;
    if (image.cols < smallest_side || image.rows < smallest_side)
        return {};
    image_u8_t view{image.cols, image.rows, static_cast<int32_t>(image.step), image.data};
    const Detections detections(apriltag_detector_detect(handles_->finder.get(), &view),
                                apriltag_detections_destroy);
    std::vector<DetectedCorners> tags;
    for (int i = 0; i < zarray_size(detections.get()); ++i) {
        apriltag_detection_t* found = nullptr;
        zarray_get(detections.get(), i, &found);
        DetectedCorners& tag = tags.emplace_back(DetectedCorners{found->id, {}});
        for (int corner = 3; corner >= 0; --corner)  // from the bottom left counter-clockwise
            tag.pixels.emplace_back(found->p[corner][0] - library_offset_px,
                                    found->p[corner][1] - library_offset_px);
    }
    return tags;
}

std::unique_ptr<Detector> make_apriltag_detector(const Marker& marker, const std::string& place,
                                                 const ApriltagOptions& options) {
    if (marker.kind != Marker::Kind::apriltag)
        throw ConfigError({place}, "the apriltag detector cannot see " + marker.spec);
    require_exact_decimation(options.quad_decimate, place);
    return std::make_unique<Detector>(
        "apriltag",
        [id = marker.id, finder = ApriltagFinder(marker.family, 1, options)](
            const CodeImage& image) { return only_one(id, finder.find(as_8_bit(image))); },
        ApriltagFinder::library_offset_px);
}

}  // namespace etalon
