#include "bench/stability/stability_case.h"

#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr double tolerance_gray = 0.1;
constexpr int probes = 24;
constexpr ReferenceEffort effort{.samples_per_scramble = 1024, .rounds = 2};

constexpr double radiance_in_gray = 255.0;

// A place on the marker: one of its corners, on its outline, on a grid line, or anywhere.
Eigen::Vector2d place_on(const CellGrid& grid, RandomStream& random) {
    const auto line = [&](int last) {
        return std::min(last, static_cast<int>(random.uniform() * (last + 1)));
    };
    const auto end = [&](int last) { return random.uniform() < 0.5 ? 0.0 : double(last); };
    const int columns = grid.columns(), rows = grid.rows();
    double u = columns * random.uniform(), v = rows * random.uniform();
    const double kind = random.uniform();
    if (kind < 0.2)
        return {end(columns), end(rows)};
    if (kind < 0.6)
        return kind < 0.4 ? Eigen::Vector2d(end(columns), v) : Eigen::Vector2d(u, end(rows));
    if (kind < 0.9)
        return kind < 0.75 ? Eigen::Vector2d(line(columns), v) : Eigen::Vector2d(u, line(rows));
    return {u, v};
}

std::optional<cv::Point> pixel_near(const Projector& projector, const PlacedMarker& marker,
                                    RandomStream& random) {
    const Eigen::Vector2d place = place_on(marker.grid, random);
    const auto seen =
        projector.project(marker.camera_from_marker * marker.grid.point_mm(place.x(), place.y()));
    if (!seen || !(seen->cwiseAbs().maxCoeff() < 1e8))
        return std::nullopt;
    return cv::Point(static_cast<int>(std::lround(seen->x() + random.normal())),
                     static_cast<int>(std::lround(seen->y() + random.normal())));
}

}  // namespace

RenderedImage render_once(const CameraModel& camera, const Scene& scene,
                          const RenderOptions& options) {
    return Renderer(camera).render(scene, options);
}

std::vector<StabilityCase> stability_cases() {
    std::vector<StabilityCase> all;
    for (const auto& group : {geometry_cases(), camera_cases(), input_cases(), invariant_cases(),
                              projection_cases(), wide_lens_cases(), wide_render_cases(),
                              servo_cases(), calibration_cases(), registration_cases()})
        all.insert(all.end(), group.begin(), group.end());
    return all;
}

StabilityOutcome outcome_of(const StabilityCase& one, const RenderFunction& render) {
    try {
        return one.run(render);
    } catch (const std::exception& error) {
        return {.words = error.what()};
    }
}

StabilityOutcome compare_with_reference(const Radiance& radiance, const CameraModel& camera,
                                        const Scene& scene) {
    const ReferenceCheck check = check_against_reference(
        radiance, camera, scene, probe_pixels(camera, scene, probes, 1), tolerance_gray, effort);
    return {check.within() && check.pixels > 0 && cv::checkRange(radiance),
            std::abs(check.difference_gray), check.bound_gray,
            fmt::format("{} pixels, the worst at ({}, {})", check.pixels, check.pixel.x,
                        check.pixel.y)};
}

StabilityOutcome at_most(double bound, double figure, const std::string& words) {
    return {figure <= bound, figure, bound, words};
}

StabilityCase without_render(const std::string& name, const std::string& expectation,
                             std::function<StabilityOutcome()> run) {
    return {name, expectation, [run = std::move(run)](const RenderFunction&) { return run(); }};
}

StabilityCase agrees_with_reference(const std::string& name, const CameraModel& camera,
                                    const Scene& scene) {
    return {name, "reference, gray", [=](const RenderFunction& render) {
                const RenderedImage image = render(camera, scene, {});
                StabilityOutcome outcome = compare_with_reference(image.radiance, camera, scene);
                outcome.words += "; " + image.plan.describe();
                return outcome;
            }};
}

StabilityCase is_refused(const std::string& name, const CameraModel& camera, const Scene& scene) {
    return {name, "refused", [=](const RenderFunction& render) -> StabilityOutcome {
                try {
                    render(camera, scene, {});
                } catch (const NumericalError& refusal) {
                    return {.passed = true, .words = refusal.what()};
                }
                return {.figure = 1.0, .words = "an image instead of a refusal"};
            }};
}

StabilityOutcome differ_by(const Radiance& a, const Radiance& b, double bound_gray) {
    return at_most(bound_gray, radiance_in_gray * cv::norm(a, b, cv::NORM_INF),
                   "largest difference of the two images");
}

std::vector<cv::Point> probe_pixels(const CameraModel& camera, const Scene& scene, int count,
                                    std::uint64_t seed) {
    const Projector projector(camera);
    const cv::Rect image(0, 0, camera.width, camera.height);
    RandomStream random(seed, 17);
    std::vector<cv::Point> pixels;
    for (int n = 0; n < 4 * count && static_cast<int>(pixels.size()) < count; ++n) {
        const double x = random.uniform() * camera.width, y = random.uniform() * camera.height;
        std::optional pixel = cv::Point(static_cast<int>(x), static_cast<int>(y));
        if (n % 4 != 0 && !scene.markers.empty())
            pixel = pixel_near(projector,
                               scene.markers[static_cast<std::size_t>(n) % scene.markers.size()],
                               random);
        if (pixel && image.contains(*pixel) &&
            std::find(pixels.begin(), pixels.end(), *pixel) == pixels.end())
            pixels.push_back(*pixel);
    }
    return pixels;
}

ReferenceCheck check_against_reference(const Radiance& radiance, const CameraModel& camera,
                                       const Scene& scene, const std::vector<cv::Point>& pixels,
                                       double tolerance_gray, const ReferenceEffort& effort) {
    ReferenceCheck worst;
    worst.bound_gray = tolerance_gray;
    std::vector<cv::Point> open = pixels;
    ReferenceOptions options;
    options.samples_per_scramble = effort.samples_per_scramble;
    bool found = false;
    for (int round = 1; round <= effort.rounds && !open.empty(); ++round) {
        const auto references = integrate_reference(camera, scene, open, options);
        std::vector<cv::Point> in_doubt;
        for (std::size_t i = 0; i < open.size(); ++i) {
            const auto& [mean, standard_error] = references[i];
            const double se_gray = radiance_in_gray * standard_error;
            const ReferenceCheck check{open[i],
                                       radiance_in_gray * (radiance.at<float>(open[i]) - mean),
                                       se_gray, tolerance_gray + 4.0 * se_gray};
            const bool unsure = round == 1 && 2.0 * se_gray > tolerance_gray;
            if (round < effort.rounds && (unsure || !check.within()))
                in_doubt.push_back(open[i]);
            else if (!found || !(check.part_of_bound() <= worst.part_of_bound()))
                worst = check, found = true;
        }
        open = in_doubt;
        options.samples_per_scramble *= 8;
        ++options.seed;
    }
    worst.pixels = static_cast<int>(pixels.size());
    return worst;
}

CameraModel short_camera(double f_number, double focus_mm) {
    CameraModel camera = camera_without_lens(160, 120, {800.0, 800.0, 79.5, 59.5});
    camera.sensor = Sensor{.pixel_pitch_um = 10.0};
    camera.lens = Lens{f_number, focus_mm, 550.0, {}};
    return camera;
}

cv::Mat random_cells(int rows, int columns, std::uint64_t seed) {
    RandomStream random(seed, 23);
    cv::Mat cells(rows, columns, CV_32FC1);
    for (int j = 0; j < rows; ++j)
        for (int i = 0; i < columns; ++i)
            cells.at<float>(j, i) = random.uniform() < 0.5 ? 0.0f : 1.0f;
    return cells;
}

Distortion every_distortion() {
    return {.k1 = 0.31,
            .k2 = -0.12,
            .p1 = 0.0021,
            .p2 = -0.0034,
            .k3 = 0.05,
            .k4 = 0.41,
            .k5 = -0.08,
            .k6 = 0.03,
            .s1 = 0.0031,
            .s2 = -0.0012,
            .s3 = -0.0023,
            .s4 = 0.0017,
            .tau_x = 0.07,
            .tau_y = -0.11};
}

Scene marker_scene(const CameraModel& camera, const StabilityMarker& place) {
    const double mm_per_px = place.depth_mm / camera.intrinsics.fx;
    const double side = place.side_px * mm_per_px;
    PlacedMarker marker;
    marker.grid.cells = random_cells(10, 10, 1);
    marker.grid.cell_mm = Eigen::Vector2d::Constant(side / 10.0);
    marker.grid.corner_mm = Eigen::Vector2d::Constant(-side / 2.0);
    const Eigen::Vector3d axis(std::cos(35 * rad_per_deg), std::sin(35 * rad_per_deg), 0.0);
    marker.camera_from_marker.rotation =
        Eigen::AngleAxisd(place.tilt_deg * rad_per_deg, axis) *
        Eigen::AngleAxisd(20 * rad_per_deg, Eigen::Vector3d::UnitZ());
    const Intrinsics& k = camera.intrinsics;
    const Eigen::Vector2d pixel =
        Eigen::Vector2d(camera.width - 1, camera.height - 1) / 2.0 + place.off_centre_px;
    marker.camera_from_marker.translation = {(pixel.x() - k.cx) / k.fx * place.depth_mm,
                                             (pixel.y() - k.cy) / k.fy * place.depth_mm,
                                             place.depth_mm};
    return {{marker}};
}

}  // namespace etalon
