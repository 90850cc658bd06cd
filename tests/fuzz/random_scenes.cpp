#include "tests/fuzz/random_scenes.h"

#include <fmt/format.h>

#include <limits>
#include <numbers>

#include "calib/camera/projector.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"
#include "tests/image_of.h"

namespace etalon::test {
namespace {

constexpr std::uint64_t seeds_per_camera = 16;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double degree = std::numbers::pi / 180.0;

// Draws of one stream.
class Dice {
public:
    Dice(std::uint64_t seed, std::uint32_t stream) : random_(seed, stream) {}

    bool chance(double probability) { return random_.uniform() < probability; }
    double between(double low, double high) { return low + (high - low) * random_.uniform(); }
    double log_between(double low, double high) {
        return std::exp(between(std::log(low), std::log(high)));
    }
    int whole(int first, int last) {
        return std::min(last, first + static_cast<int>(random_.uniform() * (last - first + 1)));
    }
    double normal() { return random_.normal(); }
    template <class T, std::size_t n>
    T one_of(const T (&values)[n]) {
        return values[static_cast<std::size_t>(whole(0, static_cast<int>(n) - 1))];
    }

private:
    RandomStream random_;
};

PointSpread random_spread(Dice& dice) {
    PointSpread spread;
    if (dice.chance(0.25)) {
        spread.kind = PointSpread::Kind::gaussian;
        spread.sigma_px = dice.log_between(0.05, 3.0);
    } else if (dice.chance(0.12)) {
        spread.kind = PointSpread::Kind::measured;
        const double radius = dice.log_between(0.3, 6.0);
        spread.profile = {{0.0, 1.0},
                          {0.4 * radius, dice.between(0.2, 1.0)},
                          {0.7 * radius, dice.between(0.0, 0.3)},
                          {radius, 0.0}};
    }
    return spread;
}

Distortion mild_distortion(Dice& dice) {
    Distortion d;
    if (dice.chance(0.3))
        return d;
    d.k1 = dice.between(-0.3, 0.2);
    d.k2 = dice.between(-0.1, 0.1);
    if (dice.chance(0.5)) {
        d.p1 = 0.003 * dice.normal();
        d.p2 = 0.003 * dice.normal();
    }
    return d;
}

// Scaled so that the corner of the image, at the radius r, feels it.
Distortion wild_distortion(Dice& dice, double r) {
    Distortion d = mild_distortion(dice);
    const double s = 1.0 / (r * r);
    if (dice.chance(0.5)) {
        d.k1 = s * dice.normal();
        d.k2 = s * s * dice.normal() * dice.log_between(0.01, 1.0);
        d.k3 = s * s * s * dice.normal() * dice.log_between(0.01, 1.0);
    }
    if (dice.chance(0.3)) {  // poles where 1 + k4 r^2 + ... vanishes
        d.k4 = s * dice.normal();
        d.k5 = 0.3 * s * s * dice.normal();
        d.k6 = 0.1 * s * s * s * dice.normal();
    }
    if (dice.chance(0.2)) {
        d.s1 = 0.1 * r * s * dice.normal();
        d.s4 = 0.1 * r * s * s * dice.normal();
    }
    if (dice.chance(0.2)) {
        d.tau_x = 0.3 * dice.normal();
        d.tau_y = 0.3 * dice.normal();
    }
    return d;
}

CameraModel ordinary_camera(Dice& dice) {
    CameraModel camera;
    camera.width = dice.whole(16, 64);
    camera.height = dice.whole(16, 64);
    const double f = dice.log_between(60.0, 1500.0);
    camera.intrinsics = {f, f * dice.between(0.9, 1.1), 0.5 * camera.width + 3.0 * dice.normal(),
                         0.5 * camera.height + 3.0 * dice.normal()};
    camera.distortion = mild_distortion(dice);
    if (dice.chance(0.1))
        return camera;
    camera.sensor = Sensor{.pixel_pitch_um = dice.between(2.0, 9.0)};
    camera.lens = Lens{dice.log_between(1.2, 16.0), dice.log_between(60.0, 3000.0),
                       dice.between(400.0, 700.0), random_spread(dice)};
    return camera;
}

CameraModel hostile_camera(Dice& dice) {
    CameraModel camera;
    camera.width = dice.chance(0.1) ? 1 : dice.whole(1, 128);
    camera.height = dice.chance(0.1) ? 1 : dice.whole(1, 96);
    const double f =
        dice.chance(0.7) ? dice.log_between(50.0, 5000.0) : dice.log_between(5.0, 500000.0);
    const double away = dice.chance(0.1) ? 1000.0 : 10.0;
    camera.intrinsics = {f, dice.chance(0.3) ? f * dice.log_between(0.5, 2.0) : f,
                         0.5 * camera.width + away * dice.normal(),
                         0.5 * camera.height + away * dice.normal()};
    const double corner = std::hypot(camera.width, camera.height) / 2.0 / f;
    camera.distortion = dice.chance(0.5) ? wild_distortion(dice, corner) : mild_distortion(dice);
    if (dice.chance(0.1))
        return camera;
    const bool any_f_number = dice.chance(0.1);  // patterns of many px: slow to prepare
    camera.sensor = Sensor{.pixel_pitch_um = dice.log_between(any_f_number ? 0.5 : 2.0, 20.0)};
    const double focus = dice.chance(0.15) ? infinity : dice.log_between(2.0, 1e5);
    camera.lens = Lens{dice.log_between(0.95, any_f_number ? 200.0 : 11.0), focus,
                       dice.log_between(200.0, 1000.0), random_spread(dice)};
    if (dice.chance(0.08)) {  // fx is px/mm
        camera.projection.kind = Projection::telecentric;
        camera.intrinsics.fx = dice.log_between(2.0, 100.0);
        camera.intrinsics.fy = camera.intrinsics.fx * dice.between(0.8, 1.2);
        camera.distortion = {};
        camera.lens->object_na = dice.log_between(1e-3, 0.3);
    }
    return camera;
}

CellGrid random_grid(Dice& dice, int most_cells, double side_mm) {
    CellGrid grid;
    grid.cells.create(dice.whole(1, most_cells), dice.whole(1, most_cells), CV_32FC1);
    const bool black_or_white = dice.chance(0.6);
    for (int j = 0; j < grid.cells.rows; ++j)
        for (int i = 0; i < grid.cells.cols; ++i)
            grid.cells.at<float>(j, i) = static_cast<float>(
                black_or_white ? (dice.chance(0.5) ? 1.0 : 0.0) : dice.between(0.0, 1.0));
    grid.cell_mm = {side_mm / grid.columns(), side_mm / grid.rows() * dice.between(0.5, 1.5)};
    grid.corner_mm = {-0.5 * side_mm, -0.5 * side_mm};
    return grid;
}

// Tilted by the angle about an axis in the image plane, after a turn in its own plane.
Eigen::Quaterniond orientation(Dice& dice, double tilt) {
    const double axis = dice.between(0.0, 2.0 * std::numbers::pi);
    return (Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(axis), std::sin(axis), 0.0)) *
            Eigen::AngleAxisd(dice.between(-4.0, 4.0), Eigen::Vector3d::UnitZ())) *
           Eigen::Quaterniond::Identity();
}

// The place at the depth that the pixel sees, or would without distortion.
Eigen::Vector3d seen_at(const CameraModel& camera, const Eigen::Vector2d& pixel, double depth) {
    const Intrinsics& k = camera.intrinsics;
    const double scale = camera.projection.kind == Projection::telecentric ? 1.0 : depth;
    const Eigen::Vector2d plain((pixel.x() - k.cx) / k.fx, (pixel.y() - k.cy) / k.fy);
    const Eigen::Vector2d x = Projector(camera).unproject(pixel).value_or(plain);
    return {scale * x.x(), scale * x.y(), depth};
}

PlacedMarker place(const CameraModel& camera, Dice& dice, double side_px, double depth, double tilt,
                   int most_cells, double aside_px) {
    const double per_mm = camera.projection.kind == Projection::telecentric
                              ? camera.intrinsics.fx
                              : camera.intrinsics.fx / depth;
    PlacedMarker marker;
    marker.grid = random_grid(dice, most_cells, side_px / per_mm);
    const Eigen::Vector2d pixel(dice.between(-aside_px, camera.width + aside_px),
                                dice.between(-aside_px, camera.height + aside_px));
    marker.camera_from_marker = {orientation(dice, tilt), seen_at(camera, pixel, depth)};
    return marker;
}

// All of it is before the lens, its front to it.
bool is_seen(const PlacedMarker& marker) {
    constexpr double min_mm = 20.0;  // more than an aperture's radius
    const CellGrid& grid = marker.grid;
    const Rigid& pose = marker.camera_from_marker;
    if (!((pose.rotation * Eigen::Vector3d::UnitZ()).dot(pose.translation) > min_mm))
        return false;
    for (const int u : {0, grid.columns()})
        for (const int v : {0, grid.rows()})
            if (!((pose * grid.point_mm(u, v)).z() > min_mm))
                return false;
    return true;
}

double random_background(Dice& dice) {
    constexpr double usual[] = {0.0, 0.5, 0.99, 1.0, 1.0};
    return dice.chance(0.7) ? dice.one_of(usual) : dice.between(0.0, 1.0);
}

PlacedMarker hostile_marker(const CameraModel& camera, Dice& dice) {
    const double depth = dice.chance(0.3) && camera.lens && camera.lens->focus_distance_mm < 1e6
                             ? camera.lens->focus_distance_mm * dice.between(0.97, 1.03)
                             : dice.log_between(dice.chance(0.2) ? 0.1 : 30.0, 1e4);
    constexpr double edge_on[] = {85.0, 89.0, 89.9, 89.99, 90.0, 91.0, 180.0};
    const double tilt =
        degree * (dice.chance(0.15) ? dice.one_of(edge_on) : dice.between(0.0, 80.0));
    const double side_px =
        dice.chance(0.2) ? dice.log_between(0.1, 2.0) : dice.log_between(2.0, 400.0);
    PlacedMarker marker = place(camera, dice, side_px, depth, tilt, dice.chance(0.1) ? 100 : 10,
                                dice.chance(0.2) ? 60.0 : 0.0);
    if (dice.chance(0.03))
        marker.camera_from_marker.translation.z() *= -1.0;
    return marker;
}

// One number that the renderer uses becomes NaN or infinite (focus at infinity is a meaning).
std::string poison(RandomInput& input, Dice& dice) {
    constexpr double poisons[] = {std::numeric_limits<double>::quiet_NaN(), infinity, -infinity};
    const double bad = dice.one_of(poisons);
    Intrinsics& k = input.camera.intrinsics;
    PlacedMarker& marker = input.scene.markers.front();
    Eigen::Vector3d& t = marker.camera_from_marker.translation;
    Eigen::Quaterniond& q = marker.camera_from_marker.rotation;
    std::vector<std::pair<const char*, double*>> numbers = {
        {"fx", &k.fx},
        {"fy", &k.fy},
        {"cx", &k.cx},
        {"cy", &k.cy},
        {"k1", &input.camera.distortion.k1},
        {"k6", &input.camera.distortion.k6},
        {"p2", &input.camera.distortion.p2},
        {"s3", &input.camera.distortion.s3},
        {"tau_x", &input.camera.distortion.tau_x},
        {"tx", &t.x()},
        {"ty", &t.y()},
        {"tz", &t.z()},
        {"qx", &q.x()},
        {"qw", &q.w()},
        {"cell width", &marker.grid.cell_mm.x()},
        {"corner y", &marker.grid.corner_mm.y()},
        {"background", &input.scene.background},
        {"tolerance", &input.tolerance_gray}};
    if (input.camera.lens && input.camera.projection.kind == Projection::perspective) {
        Lens& lens = *input.camera.lens;
        numbers.emplace_back("f-number", &lens.f_number);
        numbers.emplace_back("pixel pitch", &input.camera.sensor->pixel_pitch_um);
        if (!(bad > 0.0))
            numbers.emplace_back("focus distance", &lens.focus_distance_mm);
        if (lens.psf.kind == PointSpread::Kind::ideal)
            numbers.emplace_back("wavelength", &lens.wavelength_nm);
        if (lens.psf.kind == PointSpread::Kind::gaussian)
            numbers.emplace_back("sigma", &lens.psf.sigma_px);
        if (lens.psf.kind == PointSpread::Kind::measured)
            numbers.emplace_back("profile", &lens.psf.profile[1].second);
    }
    const auto chosen = static_cast<std::size_t>(dice.whole(0, static_cast<int>(numbers.size())));
    if (chosen == numbers.size()) {
        marker.grid.cells.at<float>(0, 0) = static_cast<float>(bad);
        return "cell";
    }
    const auto& [name, value] = numbers[chosen];
    *value = bad;
    return name;
}

}  // namespace

RandomInput ordinary_input(std::uint64_t seed) {
    Dice dice(seed, 1);
    RandomInput input;
    input.camera_key = seed / seeds_per_camera + 1;
    Dice camera_dice(input.camera_key, 3);
    input.camera = ordinary_camera(camera_dice);
    const double depth = dice.log_between(100.0, 2000.0), side_px = dice.log_between(6.0, 80.0);
    const auto any_marker = [&] {
        return place(input.camera, dice, side_px, depth, dice.between(0.0, 70.0) * degree, 8, 0.0);
    };
    PlacedMarker marker = any_marker();
    while (!is_seen(marker))  // a wide one, tilted, of a short lens
        marker = any_marker();
    input.scene.markers = {marker};
    input.scene.background = random_background(dice);
    return input;
}

RandomInput hostile_input(std::uint64_t seed) {
    Dice dice(seed, 2);
    RandomInput input;
    input.camera_key = seed / seeds_per_camera + 1;
    Dice camera_dice(input.camera_key, 4);
    input.camera = hostile_camera(camera_dice);
    const int count = dice.chance(0.1) ? 2 : 1;
    for (int n = 0; n < count; ++n)
        input.scene.markers.push_back(hostile_marker(input.camera, dice));
    input.scene.background = random_background(dice);
    if (dice.chance(0.2))
        input.tolerance_gray = dice.log_between(0.03, 3.0);
    if (dice.chance(0.1)) {
        input.poison = poison(input, dice);
        input.camera_key = 0;
    }
    return input;
}

// ---- what is checked of every scene

namespace {

struct Attempt {
    std::optional<RenderedImage> image;
    std::string refusal;
};

Attempt attempt(const Renderer& renderer, const RandomInput& input, RenderMethod method,
                const cv::Rect& region = {}) {
    const RenderOptions options{
        .method = method, .tolerance_gray = input.tolerance_gray, .region = region};
    try {
        return {renderer.render(input.scene, options), {}};
    } catch (const Error& refusal) {
        return {std::nullopt, refusal.what()};
    }
}

// All radiances that a pixel can show lie between those of the scene: no spread is negative.
std::optional<Violation> outside_hull(const RandomInput& input, const RenderedImage& image) {
    double low = input.scene.background, high = low;
    for (const PlacedMarker& marker : input.scene.markers) {
        double least, most;
        cv::minMaxLoc(marker.grid.cells, &least, &most);
        low = std::min(low, least);
        high = std::max(high, most);
    }
    const double allowed = 2.0 * input.tolerance_gray * gray;
    double least, most;
    cv::minMaxLoc(image.radiance, &least, &most);
    if (least >= low - allowed && most <= high + allowed)
        return std::nullopt;
    return Violation{"hull", fmt::format("radiance {:.6g}..{:.6g} beyond {:.6g}..{:.6g}", least,
                                         most, low, high)};
}

std::optional<Violation> not_finite(const RenderedImage& image) {
    if (cv::checkRange(image.radiance))
        return std::nullopt;
    return Violation{"finite", "a pixel is not finite"};
}

// Without distortion every pixel has a ray; a pixel without one shows the background.
std::optional<Violation> wrong_mask(const RandomInput& input, const RenderedImage& image) {
    cv::Mat wrong = (image.valid == 0) & (image.radiance != input.scene.background);
    if (cv::countNonZero(wrong) == 0 ||
        input.scene.background != static_cast<float>(input.scene.background))
        return std::nullopt;
    return Violation{"mask", "a pixel without a ray is not background"};
}

// The last third of the columns and of the rows, alone. At the distortion model's end both may be
// off by what their plans state.
void compare_region(const Renderer& renderer, const RandomInput& input, const RenderedImage& whole,
                    SceneCheck& check) {
    const cv::Size size = whole.radiance.size();
    const cv::Rect region(cv::Point(2 * size.width / 3, 2 * size.height / 3), cv::Point(size));
    const Attempt part = attempt(renderer, input, RenderMethod::automatic, region);
    const double difference =
        part.image ? cv::norm(part.image->radiance(region), whole.radiance(region), cv::NORM_INF)
                   : std::numeric_limits<double>::infinity();
    const double allowed_gray = input.tolerance_gray + 2.0 * whole.plan.border_gray;
    if (difference > allowed_gray * gray)
        check.violations.push_back(
            {"region", fmt::format("differs from the whole's part by {:.4g} gray {}",
                                   difference / gray, part.refusal)});
}

void compare_methods(const RandomInput& input, const Attempt& lens, const Attempt& area,
                     SceneCheck& check) {
    constexpr double area_up_to_px = 0.5;
    if (!lens.image || !area.image || area.image->plan.max_blur_radius_px > area_up_to_px)
        return;
    check.methods_gray = cv::norm(lens.image->radiance, area.image->radiance, cv::NORM_INF) / gray;
    if (*check.methods_gray > 2.0 * input.tolerance_gray)
        check.violations.push_back(
            {"E and C", fmt::format("differ by {:.4g} gray, tolerance {:.3g}", *check.methods_gray,
                                    input.tolerance_gray)});
}

void compare_reference(const RandomInput& input, const RenderedImage& image, int probes,
                       const ReferenceEffort& effort, SceneCheck& check) {
    const auto pixels = probe_pixels(input.camera, input.scene, probes, 5);
    const ReferenceCheck against = check_against_reference(
        image.radiance, input.camera, input.scene, pixels, input.tolerance_gray, effort);
    check.reference_gray =
        std::max(0.0, std::abs(against.difference_gray) - 4.0 * against.standard_error_gray);
    if (!against.within())
        check.violations.push_back(
            {"reference", fmt::format("pixel ({}, {}) off by {:.4g} gray, bound {:.4g}; {}",
                                      against.pixel.x, against.pixel.y, against.difference_gray,
                                      against.bound_gray, image.plan.describe())});
}

}  // namespace

const Renderer& KeptRenderer::of(const RandomInput& input) {
    if (!renderer_ || input.camera_key == 0 || input.camera_key != key_) {
        renderer_.reset();
        renderer_.emplace(input.camera);
        key_ = input.camera_key;
    }
    return *renderer_;
}

SceneCheck check_scene_of(KeptRenderer& kept, const RandomInput& input, int probes,
                          const ReferenceEffort& effort) {
    SceneCheck check;
    const Renderer* renderer = nullptr;
    try {
        renderer = &kept.of(input);
    } catch (const Error& refusal) {
        check.refusal = refusal.what();
        return check;
    }
    const Attempt automatic = attempt(*renderer, input, RenderMethod::automatic);
    const Attempt lens = attempt(*renderer, input, RenderMethod::exact_lens);
    const Attempt area = attempt(*renderer, input, RenderMethod::exact_area);
    check.refusal = automatic.refusal;
    for (const Attempt* made : {&automatic, &lens, &area}) {
        if (!made->image)
            continue;
        for (const auto& found : {not_finite(*made->image), outside_hull(input, *made->image),
                                  wrong_mask(input, *made->image)})
            if (found)
                check.violations.push_back(*found);
    }
    if (!automatic.image)
        return check;
    if (!input.poison.empty())
        check.violations.push_back(
            {"poison", fmt::format("rendered with {} not finite", input.poison)});
    compare_region(*renderer, input, *automatic.image, check);
    compare_methods(input, lens, area, check);
    if (probes > 0 && input.poison.empty())
        compare_reference(input, *automatic.image, probes, effort, check);
    return check;
}

}  // namespace etalon::test
