// What each option of a detector does to its corners, and what a detection costs: the tables of
// compare/detect/detector_adaptors.h and docs. Exact renderings without blur and noise of tags of
// 30 to 120 px at 40 poses each, tilted by up to 0.35 rad; 640x480 px.
//
//   detector_options        prints tables in px: mean offset towards the tag's centre, mean offset
//                           in x and in y, RMS distance of a corner, tags found, CPU time
#include <fmt/format.h>

#include <functional>

#include "compare/detect/detector_adaptors.h"
#include "core/time/clock.h"
#include "tests/compare/rendered_tags.h"

namespace etalon {
namespace {

using test::RenderedTag;
using test::sharp_camera;

constexpr int poses = 40;
constexpr double sides_px[] = {30, 45, 60, 90, 120};

struct Variant {
    std::string label;
    std::function<std::unique_ptr<Detector>(const Marker&)> make;
};

std::vector<Variant> apriltag_variants() {
    std::vector<Variant> variants;
    for (const double decimate : {1.0, 1.5, 2.0, 3.0})
        for (const bool refine : {true, false})
            variants.push_back({fmt::format("quad_decimate {}, refine_edges {}", decimate, refine),
                                [=](const Marker& tag) {
                                    return make_apriltag_detector(tag, "", {decimate, refine});
                                }});
    return variants;
}

std::vector<Variant> aruco_variants() {
    std::vector<Variant> variants;
    for (const int half_px : {2, 3, 5, 8})
        variants.push_back(
            {fmt::format("half window {} px", half_px), [=](const Marker& tag) {
                 return make_aruco_detector(tag, "", {ArucoRefinement::subpixel, half_px});
             }});
    for (const char* name : {"aruco-none", "aruco-contour", "aruco-apriltag"})
        variants.push_back(
            {name, [=](const Marker& tag) { return make_detector(name, tag, "evidence"); }});
    return variants;
}

void print_table(const char* spec, const std::vector<Variant>& variants) {
    const Marker tag = parse_marker(spec, "evidence");
    fmt::print("{}\n{:<34} {:>5} {:>8} {:>8} {:>8} {:>8} {:>7} {:>7}\n", spec, "", "side", "inward",
               "x", "y", "rms", "found", "CPU ms");
    for (const double side_px : sides_px) {
        const auto photos = test::tag_photos(sharp_camera(), tag, poses, side_px / 120.0);
        for (const Variant& variant : variants) {
            const auto detector = variant.make(tag);
            const double before = process_cpu_ms();
            const test::Offsets offsets = test::mean_offset(photos, *detector);
            fmt::print("{:<34} {:5.0f} {:+8.3f} {:+8.3f} {:+8.3f} {:8.3f} {:3}/{:<3} {:7.2f}\n",
                       variant.label, side_px, offsets.inward, offsets.mean.x(), offsets.mean.y(),
                       offsets.rms, offsets.detected, poses, (process_cpu_ms() - before) / poses);
        }
    }
    fmt::print("\n");
}

void print_costs() {
    fmt::print("{:<34} {:>7}\n", "CPU time of a detection", "ms");
    for (const char* spec :
         {"apriltag:36h11:17@50mm", "aruco:4X4_50:7@50mm", "stag:HD21:5@50mm",
          "topotag:4x4:9283@50mm", "charuco:4X4_50:9x6@12mm/9mm", "chessboard:9x6@12mm"}) {
        const Marker marker = parse_marker(spec, "evidence");
        const auto detector = make_detector("auto", marker, "evidence");
        const RenderedTag photo =
            test::render_tag(Renderer(sharp_camera()), marker,
                             test::board_pose(marker, {0.1, -0.2, 0.3}, {10, -7, 290}));
        if (const Detection seen = detector->detect(photo.image); !seen.corners)
            fmt::print("{}: {}\n", spec, seen.reason);
        const double before = process_cpu_ms();
        constexpr int repeats = 20;
        for (int i = 0; i < repeats; ++i)
            detector->detect(photo.image);
        fmt::print("{:<34} {:7.2f}\n", spec, (process_cpu_ms() - before) / repeats);
    }
}

}  // namespace
}  // namespace etalon

int main() {
    etalon::print_costs();
    etalon::print_table("apriltag:36h11:17@50mm", etalon::apriltag_variants());
    etalon::print_table("aruco:4X4_50:7@50mm", etalon::aruco_variants());
}
