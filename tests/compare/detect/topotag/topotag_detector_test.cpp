// Truth: tags rendered exactly at known poses; vertices where the projector puts them. The same at
// full size: tests/evidence/topotag.cpp.
#include "compare/detect/topotag/topotag_detector.h"

#include <deque>
#include <tuple>

#include "core/statistics/distributions.h"
#include "tests/compare/rendered_tags.h"
#include "tests/evidence/topotag_study.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(TopotagDetector, FindsTheVerticesRowByRowInEveryFamily) {
    for (const char* name : {"3x3:70", "4x4:9283", "5x5:7654321", "6x6:1122334455", "3x3-circle:93",
                             "4x4-circle:16383", "5x5-circle:0", "6x6-circle:7"}) {
        const Marker tag = parse_marker(fmt::format("topotag:{}@70mm", name), "test");
        const auto photo = render_tag(sharp_camera(), tag, {0.3, -0.2, 2.1, 10, -7, 350});
        EXPECT_LT(detection_error_px(tag, photo.image, photo.corners), 0.05) << name;
    }
}

struct Tally {
    int found = 0;
    std::vector<double> errors;
};

Tally study(const CameraModel& camera, const std::string& family, int count, double near_mm,
            double far_mm, double tilt_deg) {
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Projector projector(camera);
    Tally tally;
    for (int i = 0; i < count; ++i) {
        Draw draw(1, static_cast<std::uint64_t>(i));
        const Marker tag = Distraction::random_tag(draw, family, 50.0);
        const SeenTag seen = study_pose(projector, tag, draw, near_mm, far_mm, tilt_deg);
        const Scene scene{{{tag.grid, seen.camera_from_marker}}, 1.0};
        const CodeImage image = sensor.expose(renderer.render(scene).radiance,
                                              NoiseKey{1, static_cast<std::uint32_t>(i)});
        const auto found = make_detector("auto", tag, "test")->detect(image).corners;
        if (!found)
            continue;
        ++tally.found;
        for (std::size_t v = 0; v < found->pixels.size(); ++v)
            tally.errors.push_back((found->pixels[v] - seen.vertices[v]).norm());
    }
    return tally;
}

// The original finds 57.65 % of the published comparison's poses (FMAC, arXiv 2601.07723). Of 50
// poses that would be 29; 40 are asked for, 45 and more are found (93 % of thousands).
TEST(TopotagDetector, FindsMoreOfThePublishedPosesThanTheOriginal) {
    const Tally tally = study(study_camera(), "4x4", 50, 500, 1500, 45);
    EXPECT_GE(tally.found, 40);
    EXPECT_LT(median(tally.errors), 0.05);
}

// 60 px are 50 mm at 685 mm. Defocus, noise and distortion are the camera's; with a tone curve,
// too.
TEST(TopotagDetector, PlacesVerticesToAHundredthOfAPixel) {
    for (const CameraModel& camera : {study_camera(), with_tone_curve(study_camera())}) {
        const Tally tally = study(camera, "4x4", 16, 300, 600, 50);
        EXPECT_GE(tally.found, 13);
        EXPECT_LT(median(tally.errors), 0.02);
    }
}

// The tone curve makes white grow. The baseline has an edge on its left and two dots: each must
// stay where it is.
TEST(TopotagDetector, IsNotMovedByAToneCurve) {
    CameraModel camera = with_tone_curve(study_camera());
    camera.sensor->gain_e_per_dn = camera.sensor->read_noise_e = 0.0;
    camera.distortion = {};
    const Marker tag = parse_marker("topotag:4x4:9283@50mm", "test");
    const auto photo = render_tag(camera, tag, {0.2, -0.1, 0.05, 3, 5, 500});
    EXPECT_LT(detection_error_px(tag, photo.image, photo.corners), 0.03)
        << "0.1 px if white did not grow";
}

// Twice as much light on one side of the tag as on the other.
TEST(TopotagDetector, IsNotMovedByUnevenLight) {
    const Marker tag = parse_marker("topotag:4x4:9283@50mm", "test");
    const auto photo = render_tag(sharp_camera(), tag, {0.2, -0.3, 0.4, 3, 5, 400});
    const auto [left, right] =
        std::ranges::minmax_element(photo.corners, {}, [](const auto& pixel) { return pixel.x(); });
    CodeImage lit{photo.image.pixels.clone(), 8};
    for (int x = 0; x < lit.pixels.cols; ++x) {
        const double share = std::clamp((x - left->x()) / (right->x() - left->x()), -0.3, 1.3);
        lit.pixels.col(x) *= 0.4 + 0.4 * share;
    }
    EXPECT_LT(detection_error_px(tag, lit, photo.corners), 0.05);
}

// A small share of the 100 000 images of the evidence program.
TEST(TopotagDetector, FindsNothingThatIsNotThere) {
    const CameraModel camera = cropped(study_camera(), 320, 240);
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Distraction distraction(renderer, sensor);
    for (int kind = 0; kind < Distraction::kinds; ++kind)
        for (std::uint64_t n = 0; n < 8; ++n) {
            const std::string& family = topotag_families()[n];
            EXPECT_TRUE(find_in(distraction.picture(kind, n, family), family).empty())
                << Distraction::names[kind] << ", " << n << ", " << family;
        }
}

// ---- region tree

// Truth: the same regions by flooding from the outside inwards, pixel by pixel.

// What is told of a region and of the one around it, in any order of the regions.
using Told = std::tuple<bool, double, double, double, double>;  // dark, area, sums, parent's area

std::vector<Told> told_of(const std::vector<Region>& regions) {
    std::vector<Told> told;
    for (const Region& region : regions)
        told.emplace_back(
            region.is_dark, region.area, region.sum.x(), region.sum.y(),
            region.parent < 0 ? -1.0 : regions[static_cast<std::size_t>(region.parent)].area);
    std::sort(told.begin(), told.end());
    return told;
}

cv::Mat picture(const std::vector<std::string>& rows) {
    cv::Mat dark(static_cast<int>(rows.size()), static_cast<int>(rows[0].size()), CV_8UC1);
    for (int y = 0; y < dark.rows; ++y)
        for (int x = 0; x < dark.cols; ++x)
            dark.at<uchar>(y, x) =
                rows[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] == '#' ? 255 : 0;
    return dark;
}

// The image with a white border stands for the outside; its pixels do not count.
std::vector<Told> by_flooding(const cv::Mat& dark) {
    cv::Mat all, label(dark.rows + 2, dark.cols + 2, CV_32SC1, cv::Scalar::all(-1));
    cv::copyMakeBorder(dark, all, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar::all(0));
    std::vector<Region> regions;
    std::deque<std::pair<cv::Point, int>> seeds = {{{0, 0}, -1}};
    while (!seeds.empty()) {
        const auto [seed, parent] = seeds.front();
        seeds.pop_front();
        if (label.at<int>(seed) >= 0)
            continue;
        const int index = static_cast<int>(regions.size());
        Region region;
        region.parent = parent;
        region.is_dark = all.at<uchar>(seed) != 0;
        std::deque<cv::Point> open = {seed};
        label.at<int>(seed) = index;
        while (!open.empty()) {
            const cv::Point at = open.front();
            open.pop_front();
            if (at.x > 0 && at.y > 0 && at.x <= dark.cols && at.y <= dark.rows) {
                region.area += 1.0;
                region.sum += Eigen::Vector2d(at.x - 1, at.y - 1);
            }
            for (int dy = -1; dy <= 1; ++dy)
                for (int dx = -1; dx <= 1; ++dx) {
                    const cv::Point next(at.x + dx, at.y + dy);
                    if (next.x < 0 || next.y < 0 || next.x >= all.cols || next.y >= all.rows ||
                        label.at<int>(next) >= 0)
                        continue;
                    const bool beside = dx == 0 || dy == 0;
                    if (all.at<uchar>(next) != all.at<uchar>(seed)) {
                        if (beside)
                            seeds.push_back({next, index});
                    } else if (beside || !region.is_dark) {
                        label.at<int>(next) = index;
                        open.push_back(next);
                    }
                }
        }
        regions.push_back(region);
    }
    return told_of(regions);
}

TEST(RegionTree, TellsWhatEnclosesWhat) {
    const std::vector<Region> tree = region_tree(picture({".........",  //
                                                          ".#######.",  //
                                                          ".#.....#.",  //
                                                          ".#.###.#.",  //
                                                          ".#.#.#.#.",  //
                                                          ".#.###.#.",  //
                                                          ".#.....#.",  //
                                                          ".#######.",  //
                                                          "........."}));
    ASSERT_EQ(tree.size(), 5u);
    const std::vector<double> areas = {32, 24, 16, 8, 1};
    for (int i = 0; i < 5; ++i) {
        const Region& region = tree[static_cast<std::size_t>(i)];
        EXPECT_EQ(region.parent, i - 1);
        EXPECT_EQ(region.is_dark, i % 2 == 1);
        EXPECT_EQ(region.area, areas[static_cast<std::size_t>(i)]);
        EXPECT_EQ(region.sum, Eigen::Vector2d(4, 4) * region.area);
        EXPECT_EQ(region.children.size(), i < 4 ? 1u : 0u);
    }
}

TEST(RegionTree, WhiteIsJoinedOverCornersAndBlackIsNot) {
    const std::vector<Region> tree = region_tree(picture({"#.", ".#"}));
    EXPECT_EQ(tree.size(), 3u) << "white all around, two black pixels";
    EXPECT_EQ(tree[0].children.size(), 2u);
}

// An arm that is met before the region it belongs to, and black at the image's edges.
TEST(RegionTree, OfRandomPicturesIsThatOfFlooding) {
    for (std::uint64_t n = 0; n < 60; ++n) {
        RandomStream random(77, 1, n);
        const int columns = 1 + static_cast<int>(random.uniform() * 40),
                  rows = 1 + static_cast<int>(random.uniform() * 25);
        const double share = 0.3 + 0.4 * random.uniform();
        cv::Mat dark(rows, columns, CV_8UC1);
        for (int y = 0; y < rows; ++y)
            for (int x = 0; x < columns; ++x)
                dark.at<uchar>(y, x) = random.uniform() < share ? 255 : 0;
        EXPECT_EQ(told_of(region_tree(dark)), by_flooding(dark)) << n;
    }
}

}  // namespace
}  // namespace etalon
