// Numbers without a meaning are refused, each by itself; and the sensor's quantisation.
#include <fmt/format.h>

#include "bench/stability/stability_case.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct RenderInput {
    CameraModel camera = short_camera(2.8, 330.0);
    Scene scene = marker_scene(camera, {});
    RenderOptions options;
};

struct Number {
    std::string name;
    double* value;
};
using Numbers = std::vector<Number> (*)(RenderInput&);

std::vector<Number> camera_numbers(RenderInput& input) {
    Intrinsics& k = input.camera.intrinsics;
    Distortion& d = input.camera.distortion;
    Lens& lens = *input.camera.lens;
    std::vector<Number> numbers = {{"fx", &k.fx},
                                   {"fy", &k.fy},
                                   {"cx", &k.cx},
                                   {"cy", &k.cy},
                                   {"f_number", &lens.f_number},
                                   {"focus_distance", &lens.focus_distance_mm},
                                   {"wavelength", &lens.wavelength_nm},
                                   {"pixel_pitch", &input.camera.sensor->pixel_pitch_um}};
    for (int i = 0; double* coefficient : {&d.k1, &d.k2, &d.p1, &d.p2, &d.k3, &d.k4, &d.k5, &d.k6,
                                           &d.s1, &d.s2, &d.s3, &d.s4, &d.tau_x, &d.tau_y})
        numbers.push_back({distortion_names[i++], coefficient});
    return numbers;
}

std::vector<Number> pose_numbers(RenderInput& input) {
    Rigid& pose = input.scene.markers[0].camera_from_marker;
    return {{"qx", &pose.rotation.x()},    {"qy", &pose.rotation.y()},
            {"qz", &pose.rotation.z()},    {"qw", &pose.rotation.w()},
            {"tx", &pose.translation.x()}, {"ty", &pose.translation.y()},
            {"tz", &pose.translation.z()}};
}

std::vector<Number> grid_numbers(RenderInput& input) {
    CellGrid& grid = input.scene.markers[0].grid;
    return {{"corner x", &grid.corner_mm.x()},
            {"corner y", &grid.corner_mm.y()},
            {"cell width", &grid.cell_mm.x()},
            {"cell height", &grid.cell_mm.y()},
            {"background", &input.scene.background}};
}

std::vector<Number> option_numbers(RenderInput& input) {
    return {{"tolerance", &input.options.tolerance_gray}};
}

std::vector<Number> spread_numbers(RenderInput& input) {
    input.camera.lens->psf.kind = PointSpread::Kind::gaussian;
    return {{"sigma", &input.camera.lens->psf.sigma_px}};
}

std::vector<Number> profile_numbers(RenderInput& input) {
    PointSpread& psf = input.camera.lens->psf;
    psf.kind = PointSpread::Kind::measured;
    psf.profile = {{0.0, 1.0}, {0.5, 0.7}, {1.0, 0.2}, {1.5, 0.1}, {2.0, 0.0}};
    return {{"radius", &psf.profile[2].first}, {"density", &psf.profile[3].second}};
}

bool is_accepted(const RenderFunction& render, const RenderInput& input) {
    try {
        render(input.camera, input.scene, input.options);
    } catch (const NumericalError&) {
        return false;
    } catch (const ConfigError&) {
        return false;
    }
    return true;
}

// Every number of the group with every one of the values; the figure is how many were accepted.
StabilityCase all_refused(const std::string& name, Numbers numbers, std::vector<double> values) {
    return {name, "number accepted", [=](const RenderFunction& render) {
                std::string accepted;
                int tried = 0, wrong = 0;
                RenderInput count;
                const std::size_t size = numbers(count).size();
                for (std::size_t n = 0; n < size; ++n)
                    for (const double value : values) {
                        RenderInput input;
                        const Number number = numbers(input)[n];
                        if (number.name == "focus_distance" && value > 0.0)
                            continue;  // at infinity
                        *number.value = value;
                        ++tried;
                        if (is_accepted(render, input)) {
                            ++wrong;
                            accepted += fmt::format(" {} = {}", number.name, value);
                        }
                    }
                return StabilityOutcome{
                    wrong == 0, double(wrong), 0.0,
                    wrong == 0 ? fmt::format("{} refused", tried) : "accepted:" + accepted};
            }};
}

StabilityCase cell_refused(const std::string& name, float value) {
    RenderInput input;
    input.scene.markers[0].grid.cells.at<float>(3, 4) = value;
    return is_refused(name, input.camera, input.scene);
}

// Radiances across the range, against rounding half up by hand; the figure in code values.
StabilityOutcome quantise_all_depths() {
    double worst = 0.0;
    for (int bits = 1; bits <= 16; ++bits) {
        CameraModel camera = short_camera(2.8, 330.0);
        camera.sensor->bits = bits;
        Radiance ramp(camera.height, camera.width, CV_32FC1);
        for (int i = 0; i < static_cast<int>(ramp.total()); ++i)
            ramp.at<float>(i / ramp.cols, i % ramp.cols) = static_cast<float>(i * 7.3e-5 - 0.1);
        const CodeImage image = SensorModel(camera).expose(ramp);
        const double full = std::exp2(bits) - 1.0;
        for (int i = 0; i < static_cast<int>(ramp.total()); ++i) {
            const cv::Point pixel(i % ramp.cols, i / ramp.cols);
            const double exact = std::clamp(full * double(ramp.at<float>(pixel)), 0.0, full);
            const double code =
                bits <= 8 ? image.pixels.at<uchar>(pixel) : image.pixels.at<std::uint16_t>(pixel);
            worst = std::max(worst, std::abs(code - exact));
        }
    }
    return at_most(0.5 + 1e-6, worst, "largest rounding, code values");
}

}  // namespace

std::vector<StabilityCase> input_cases() {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    std::vector<StabilityCase> cases;
    const std::pair<std::string, Numbers> groups[] = {
        {"camera and lens", camera_numbers},   {"pose", pose_numbers},
        {"grid and background", grid_numbers}, {"options", option_numbers},
        {"point spread", spread_numbers},      {"measured profile", profile_numbers}};
    for (const auto& [group, numbers] : groups) {
        cases.push_back(all_refused("nan: " + group, numbers, {nan}));
        cases.push_back(all_refused("infinity: " + group, numbers, {infinity, -infinity}));
    }
    cases.push_back(cell_refused("nan: a cell", static_cast<float>(nan)));
    cases.push_back(cell_refused("infinity: a cell", static_cast<float>(infinity)));
    cases.push_back(without_render("sensor of 1 to 16 bits", "rounding, DN", quantise_all_depths));
    return cases;
}

}  // namespace etalon
