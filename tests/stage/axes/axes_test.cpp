#include "stage/axes/axes.h"

#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

std::vector<Axis> axes_from(const std::string& list) {
    const auto file = StrictFile::from_text("etalon: test/1\naxes:\n" + list, "s.yml", "test/1");
    auto axes = read_axes(file.root().at("axes"));
    file.finish();
    return axes;
}

std::string error_of(const std::string& list) {
    return config_error_of([&] { axes_from(list); });
}

TEST(Axes, AreReadWithTheirUnits) {
    const auto axes = axes_from(
        "- {name: x, kind: linear, direction: [0, 3, 4], travel: [-7, 50], speed: 12,"
        " scale_uncertainty_ppm: 20, repeatability_um: 2}\n"
        "- {name: rz, kind: rotary, direction: [0, 0, -1], point_mm: [7, 5, 3],"
        " travel_deg: [-90, 45], speed_deg: 18, repeatability_deg: 0.9}\n");
    ASSERT_EQ(axes.size(), 2U);
    EXPECT_EQ(axes[0].name, "x");
    EXPECT_TRUE(axes[0].direction.isApprox(Eigen::Vector3d(0, 0.6, 0.8)));
    EXPECT_EQ(axes[0].low, -7.0);
    EXPECT_EQ(axes[0].high, 50.0);
    EXPECT_EQ(axes[0].speed, 12.0);
    EXPECT_DOUBLE_EQ(axes[0].scale_uncertainty.value(), 2e-5);
    EXPECT_DOUBLE_EQ(axes[0].repeatability.value(), 2e-3);
    EXPECT_EQ(axes[1].kind, Axis::Kind::rotary);
    EXPECT_EQ(axes[1].point_mm, Eigen::Vector3d(7, 5, 3));
    EXPECT_DOUBLE_EQ(axes[1].low, -pi / 2);
    EXPECT_DOUBLE_EQ(axes[1].high, pi / 4);
    EXPECT_DOUBLE_EQ(axes[1].speed, pi / 10);
    EXPECT_DOUBLE_EQ(axes[1].repeatability.value(), pi / 200);
    EXPECT_FALSE(axes[1].scale_uncertainty.has_value());
}

TEST(Axes, NameFileLineAndKeyOfEveryFault) {
    const std::string x = "{name: x, kind: linear, direction: [1, 0, 0], travel: [0, 5], speed: 7}";
    const auto linear = [](const std::string& keys) {
        return error_of("- {name: x, kind: linear, " + keys + "}");
    };
    EXPECT_EQ(error_of("  []\n"), "s.yml:3: axes: must have at least one axis");
    EXPECT_EQ(error_of("- " + x + "\n- " + x + "\n"),
              "s.yml:4: axes[1].name: two axes are called 'x'");
    EXPECT_EQ(linear("direction: [0, 0, 0], travel: [0, 5], speed: 7"),
              "s.yml:3: axes[0].direction: must be a direction, not zero");
    EXPECT_EQ(linear("direction: [1, 0, 0], travel: [5, 5], speed: 7"),
              "s.yml:3: axes[0].travel: must be [low, high] with low < high, not [5, 5]");
    EXPECT_EQ(linear("direction: [1, 0, 0], travel: [0, 5], speed: 0"),
              "s.yml:3: axes[0].speed: must be between 0.0001 and 100000 mm/s, not 0");
    EXPECT_EQ(linear("direction: [1, 0, 0], travel: [0, 5], speed: 1e-300"),
              "s.yml:3: axes[0].speed: must be between 0.0001 and 100000 mm/s, not 1e-300");
    EXPECT_EQ(linear("direction: [1, 0, 0], travel: [0, 1e300], speed: 7"),
              "s.yml:3: axes[0].travel[1]: must be between -10000000 and 10000000 mm, not 1e+300");
    EXPECT_EQ(linear("direction: [1, 0, 0], travel: [0, 5], speed: 7, counts_per_mm: -1e-300"),
              "s.yml:3: axes[0].counts_per_mm: must be at least 0.001 in size, not -1e-300");
    EXPECT_EQ(error_of("- {name: x, kind: rotary, direction: [1, 0, 0], point_mm: [0, 0, 0], "
                       "travel: [0, 5], speed_deg: 7}"),
              "s.yml:3: axes[0].travel_deg: missing");
    EXPECT_EQ(
        error_of(
            "- {name: x, kind: rotary, direction: [1, 0, 0], travel_deg: [0, 5], speed_deg: 7}"),
        "s.yml:3: axes[0].point_mm: missing");
}

TEST(Axes, AreReadWithTheirErrorsAndTheirController) {
    const auto axes = axes_from(
        "- {name: x, kind: linear, direction: [1, 0, 0], travel: [-7, 50], speed: 12, unit: 3,"
        " counts_per_mm: -250, lead_mm: 5, zero: 11, backlash_um: 8, backlash_uncertainty_um: 3,"
        " approach: {from: above, overrun_um: 90}, read_noise_um: 0.7,"
        " direction_uncertainty_urad: 40, error_map: [[-7, 2, 0.5], [50, -3, 0.7]]}\n"
        "- {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [7, 5, 3], speed_deg: 18,"
        " travel_deg: [-90, 45], zero_deg: 30, counts_per_deg: 500, lead_deg: 4,"
        " mount: {rotation_deg: [0, 90, 0], translation_mm: [3, 5, 7]}, backlash_deg: 0.09,"
        " approach: {from: below, overrun_deg: 0.36}, point_uncertainty_um: 6}\n");
    const Axis &x = axes.at(0), &rz = axes.at(1);
    EXPECT_EQ(x.unit, 3);
    EXPECT_DOUBLE_EQ(x.counts_per_unit.value(), -250.0);
    EXPECT_DOUBLE_EQ(x.lead.value(), 5.0);
    EXPECT_EQ(x.zero, 11.0);
    EXPECT_DOUBLE_EQ(x.backlash, 8e-3);
    EXPECT_DOUBLE_EQ(x.backlash_uncertainty.value(), 3e-3);
    EXPECT_EQ(x.approach, -1);
    EXPECT_DOUBLE_EQ(x.overrun, 90e-3);
    EXPECT_DOUBLE_EQ(x.read_noise.value(), 0.7e-3);
    EXPECT_DOUBLE_EQ(x.direction_uncertainty.value(), 40e-6);
    EXPECT_DOUBLE_EQ(x.errors->points().at(1).error, -3e-3);
    EXPECT_FALSE(rz.unit.has_value());
    EXPECT_DOUBLE_EQ(rz.counts_per_unit.value(), 500.0 * 180.0 / pi);
    EXPECT_DOUBLE_EQ(rz.lead.value(), pi / 45);
    EXPECT_DOUBLE_EQ(rz.zero, pi / 6);
    EXPECT_DOUBLE_EQ(rz.backlash, pi / 2000);
    EXPECT_EQ(rz.approach, 1);
    EXPECT_DOUBLE_EQ(rz.overrun, pi / 500);
    EXPECT_DOUBLE_EQ(rz.point_uncertainty.value(), 6e-3);
    EXPECT_EQ(rz.previous_from_mount.translation, Eigen::Vector3d(3, 5, 7));
    EXPECT_TRUE((rz.previous_from_mount.rotation * Eigen::Vector3d(0, 0, 2))
                    .isApprox(Eigen::Vector3d(2, 0, 0)));
}

TEST(Axes, RefuseWhatContradictsItself) {
    const auto with = [](const std::string& keys) {
        return error_of("- {name: x, kind: linear, direction: [1, 0, 0], travel: [-7, 50]," + keys +
                        " speed: 7}");
    };
    EXPECT_EQ(with(""), "no error");
    EXPECT_EQ(with("counts_per_mm: 0,"),
              "s.yml:3: axes[0].counts_per_mm: must be at least 0.001 in size, not 0");
    EXPECT_EQ(with("counts_per_deg: 7,"),
              "s.yml:3: axes[0].counts_per_deg: unknown key; did you mean 'counts_per_mm'?");
    EXPECT_EQ(with("error_map: [[-7, 1, 1], [49, 1, 1]],"),
              "s.yml:3: axes[0].error_map: does not cover the travel of axis x");
    EXPECT_EQ(with("backlash_um: 8, approach: {from: below, overrun_um: 7},"),
              "s.yml:3: axes[0].approach.overrun_um: must be at least the backlash");
    EXPECT_EQ(with("point_uncertainty_um: 7,"),
              "s.yml:3: axes[0].point_uncertainty_um: unknown key; did you mean "
              "'scale_uncertainty_ppm'?");
}

TEST(SoftLimits, RefuseWhatIsOutsideAndNameTheAxis) {
    const std::vector<Axis> axes = {
        {.name = "x", .low = -7.0, .high = 5.0},
        {.name = "rz", .kind = Axis::Kind::rotary, .low = -pi / 2, .high = pi / 4}};
    const auto check = [&](std::vector<double> positions) {
        return config_error_of([&] {
            require_within_limits(axes, positions, {"plan.yml", 9, "poses"});
        });
    };
    EXPECT_EQ(check({-7.0, pi / 4}), "no error");
    EXPECT_EQ(check({5.25, 0.0}),
              "plan.yml:9: poses: axis x at 5.25 mm is outside its soft limits -7 mm to 5 mm");
    EXPECT_EQ(
        check({0.0, -pi}),
        "plan.yml:9: poses: axis rz at -180 deg is outside its soft limits -90 deg to 45 deg");
    EXPECT_EQ(check({0.0}), "plan.yml:9: poses: 1 positions for 2 axes");
    EXPECT_NE(check({std::nan(""), 0.0}), "no error");
}

}  // namespace
}  // namespace etalon
