#include "stage/axes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace etalon {
namespace {

constexpr double pi = std::numbers::pi;

std::vector<Axis> axes_from(const std::string& list) {
    const auto file = StrictFile::from_text("etalon: test/1\naxes:\n" + list, "s.yml", "test/1");
    auto axes = read_axes(file.root().at("axes"));
    file.finish();
    return axes;
}

std::string error_of(const std::string& list) {
    try {
        axes_from(list);
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "no error";
}

Axis linear(Eigen::Vector3d direction) {
    Axis axis;
    axis.direction = direction.normalized();
    return axis;
}

Axis rotary(Eigen::Vector3d direction, Eigen::Vector3d point) {
    Axis axis = linear(direction);
    axis.kind = Axis::Kind::rotary;
    axis.point_mm = point;
    return axis;
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
    EXPECT_EQ(error_of("  []\n"), "s.yml:3: axes: must have at least one axis");
    EXPECT_EQ(error_of("- " + x + "\n- " + x + "\n"),
              "s.yml:4: axes[1].name: two axes are called 'x'");
    EXPECT_EQ(error_of("- {name: x, kind: linear, direction: [0, 0, 0], travel: [0, 5], speed: 7}"),
              "s.yml:3: axes[0].direction: must be a direction, not zero");
    EXPECT_EQ(error_of("- {name: x, kind: linear, direction: [1, 0, 0], travel: [5, 5], speed: 7}"),
              "s.yml:3: axes[0].travel: must be [low, high] with low < high, not [5, 5]");
    EXPECT_EQ(error_of("- {name: x, kind: linear, direction: [1, 0, 0], travel: [0, 5], speed: 0}"),
              "s.yml:3: axes[0].speed: must be greater than 0, not 0");
    EXPECT_EQ(error_of("- {name: x, kind: rotary, direction: [1, 0, 0], point_mm: [0, 0, 0],"
                       " travel: [0, 5], speed_deg: 7}"),
              "s.yml:3: axes[0].travel_deg: missing");
    EXPECT_EQ(error_of("- {name: x, kind: rotary, direction: [1, 0, 0], travel_deg: [0, 5],"
                       " speed_deg: 7}"),
              "s.yml:3: axes[0].point_mm: missing");
}

// x, then a quarter turn about (7, 5), then y in the turned frame. By hand: the turn takes the
// origin to (7, 5) + (5, -7) = (12, -2); x adds (3, 0); y = 2 points along -x after the turn.
TEST(Axes, ChainFromTheBaseOutwards) {
    const std::vector<Axis> axes = {linear({1, 0, 0}), rotary({0, 0, 1}, {7, 5, 0}),
                                    linear({0, 1, 0})};
    const Rigid base_from_carriage_q = base_from_carriage(axes, std::vector{3.0, pi / 2, 2.0});
    EXPECT_LT((base_from_carriage_q.translation - Eigen::Vector3d(13, -2, 0)).norm(), 1e-14);
    const Eigen::Vector3d turned = base_from_carriage_q.rotation * Eigen::Vector3d(5, 7, 11);
    EXPECT_LT((turned - Eigen::Vector3d(-7, 5, 11)).norm(), 1e-14);
}

// A third of a turn about (1, 1, 1) permutes the coordinates: x -> y -> z -> x.
TEST(Axes, TurnAboutAnObliqueDirection) {
    const std::vector<Axis> axes = {rotary({1, 1, 1}, {2, 2, 2})};
    const Rigid turn = base_from_carriage(axes, std::vector{2 * pi / 3});
    EXPECT_LT((turn * Eigen::Vector3d(5, 7, 11) - Eigen::Vector3d(11, 5, 7)).norm(), 1e-14);
}

TEST(Axes, LeaveThePointsOfARotaryAxisWhereTheyAre) {
    const std::vector<Axis> axes = {rotary({1, -2, 3}, {7, 5, -3})};
    const Rigid turn = base_from_carriage(axes, std::vector{0.7});
    const Eigen::Vector3d on_axis = axes[0].point_mm + 11.0 * axes[0].direction;
    EXPECT_LT((turn * on_axis - on_axis).norm(), 1e-13);
}

TEST(SoftLimits, RefuseWhatIsOutsideAndNameTheAxis) {
    std::vector<Axis> axes = {linear({1, 0, 0}), rotary({0, 0, 1}, {0, 0, 0})};
    axes[0].name = "x";
    axes[0].low = -7.0;
    axes[0].high = 5.0;
    axes[1].name = "rz";
    axes[1].low = -pi / 2;
    axes[1].high = pi / 4;
    const auto check = [&](std::vector<double> positions) -> std::string {
        try {
            require_within_limits(axes, positions, {"plan.yml", 9, "poses"});
        } catch (const ConfigError& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(check({-7.0, pi / 4}), "");
    EXPECT_EQ(check({5.25, 0.0}),
              "plan.yml:9: poses: axis x at 5.25 mm is outside its soft limits -7 mm to 5 mm");
    EXPECT_EQ(
        check({0.0, -pi}),
        "plan.yml:9: poses: axis rz at -180 deg is outside its soft limits -90 deg to 45 deg");
    EXPECT_EQ(check({0.0}), "plan.yml:9: poses: 1 positions for 2 axes");
    EXPECT_NE(check({std::nan(""), 0.0}), "");
}

}  // namespace
}  // namespace etalon
