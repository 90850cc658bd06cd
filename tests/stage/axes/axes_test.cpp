#include "stage/axes/axes.h"

#include <Eigen/Eigenvalues>

#include "core/statistics/random.h"
#include "stage/axes/kinematics.h"
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

std::string axes_error(const std::string& list) {
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
        return axes_error("- {name: x, kind: linear, " + keys + "}");
    };
    EXPECT_EQ(axes_error("  []\n"), "s.yml:3: axes: must have at least one axis");
    EXPECT_EQ(axes_error("- " + x + "\n- " + x + "\n"),
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
    EXPECT_EQ(axes_error("- {name: x, kind: rotary, direction: [1, 0, 0], point_mm: [0, 0, 0], "
                         "travel: [0, 5], speed_deg: 7}"),
              "s.yml:3: axes[0].travel_deg: missing");
    EXPECT_EQ(
        axes_error(
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
        return axes_error("- {name: x, kind: linear, direction: [1, 0, 0], travel: [-7, 50]," +
                          keys + " speed: 7}");
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

// ---- error map

ErrorMap map_of(const std::filesystem::path& file, bool rotary) {
    const StrictFile yaml(file, "test/1");
    ErrorMap map = read_error_map(yaml.root().at("map"), rotary);
    yaml.finish();
    return map;
}

std::string table_error(const std::string& table) {
    return config_error_of([&] {
        const auto file =
            StrictFile::from_text("etalon: test/1\nmap: " + table + "\n", "m.yml", "test/1");
        read_error_map(file.root().at("map"), false);
    });
}

// By hand: 1/4 of the way from (10, 2) to (30, -6) the error is 0; the uncertainty 3 to 7 gives 4.
TEST(ErrorMap, InterpolatesErrorAndUncertaintyLinearly) {
    const ErrorMap map({{-5, 1, 3}, {10, 2, 3}, {30, -6, 7}}, {"test"});
    EXPECT_DOUBLE_EQ(map.at(15)->error, 0.0);
    EXPECT_DOUBLE_EQ(map.at(15)->uncertainty, 4.0);
    EXPECT_DOUBLE_EQ(map.at(1)->error, 1.4);
    EXPECT_DOUBLE_EQ(map.at(-5)->error, 1.0);
    EXPECT_DOUBLE_EQ(map.at(10)->error, 2.0);
    EXPECT_DOUBLE_EQ(map.at(30)->error, -6.0);
}

TEST(ErrorMap, SaysNothingOutside) {
    const ErrorMap map({{-5, 1, 3}, {30, -6, 7}}, {"test"});
    EXPECT_FALSE(map.at(-5.036));
    EXPECT_FALSE(map.at(30.036));
    EXPECT_FALSE(map.at(std::nan("")));
    // At rest at its end an axis reads a little beyond it.
    EXPECT_DOUBLE_EQ(map.at(-5.034)->error, 1.0);
    EXPECT_DOUBLE_EQ(map.at(30.034)->error, -6.0);
}

TEST(ErrorMap, IsReadFromATableBesideTheFile) {
    const TemporaryFolder folder;
    write_text(folder / "s.yml", "etalon: test/1\nmap: {file: x.csv}\n");
    write_text(folder / "x.csv", "position_mm,error_um,uncertainty_um\r\n-7,5,0.5\r\n3,-2,0.7\n\n");
    const ErrorMap x = map_of(folder / "s.yml", false);
    ASSERT_EQ(x.points().size(), 2u);
    EXPECT_EQ(x.points()[1].position, 3.0);
    EXPECT_DOUBLE_EQ(x.points()[1].error, -2e-3);
    EXPECT_DOUBLE_EQ(x.points()[1].uncertainty, 0.7e-3);
    write_text(folder / "x.csv", "position_deg,error_deg,uncertainty_deg\n-7,0.5,0.05\n3,-2,0.7\n");
    const ErrorMap rz = map_of(folder / "s.yml", true);
    EXPECT_DOUBLE_EQ(rz.points()[0].position, -7 * rad_per_deg);
    EXPECT_DOUBLE_EQ(rz.points()[0].error, 0.5 * rad_per_deg);
}

TEST(ErrorMap, NamesThePlaceOfEveryFault) {
    EXPECT_EQ(table_error("[[1, 2, 3]]"), "m.yml:2: map: an error map needs at least two points");
    EXPECT_EQ(table_error("[[1, 2, 3], [1, 2, 3]]"),
              "m.yml:2: map: the positions of an error map must rise, but point 2 does not");
    EXPECT_EQ(table_error("[[1, 2, 3], [2, 2, -3]]"),
              "m.yml:2: map[1]: the standard uncertainty -3 is negative");
    const TemporaryFolder folder;
    write_text(folder / "s.yml", "etalon: test/1\nmap: {file: x.csv}\n");
    const auto error = [&](const std::string& table) {
        write_text(folder / "x.csv", table);
        return config_error_of([&] { map_of(folder / "s.yml", false); })
            .substr((folder / "x.csv").string().size());
    };
    EXPECT_EQ(error("position_deg,error_deg,uncertainty_deg\n1,2,3\n2,3,4\n"),
              ":1: the first line must be 'position_mm,error_um,uncertainty_um', not "
              "'position_deg,error_deg,uncertainty_deg'");
    const std::string header = "position_mm,error_um,uncertainty_um\n";
    EXPECT_EQ(error(header + "1,2,3\n2,3\n"), ":3: has 2 cells, not the header's 3");
    EXPECT_EQ(error(header + "1,2,3\n2,x,4\n"), ":3: 'x' is not a finite number");
    EXPECT_EQ(error(header + "1,2,3\n2,3,-4\n"), ":3: the standard uncertainty -4 is negative");
}

// ---- kinematics

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

// x, then a quarter turn about (7, 5), then y in the turned frame. By hand: the turn takes the
// origin to (7, 5) + (5, -7) = (12, -2); x adds (3, 0); y = 2 points along -x after the turn.
TEST(Kinematics, ChainFromTheBaseOutwards) {
    const std::vector<Axis> axes = {linear({1, 0, 0}), rotary({0, 0, 1}, {7, 5, 0}),
                                    linear({0, 1, 0})};
    const Rigid base_from_carriage_q = base_from_carriage(axes, std::vector{3.0, pi / 2, 2.0});
    EXPECT_LT((base_from_carriage_q.translation - Eigen::Vector3d(13, -2, 0)).norm(), 1e-14);
    const Eigen::Vector3d turned = base_from_carriage_q.rotation * Eigen::Vector3d(5, 7, 11);
    EXPECT_LT((turned - Eigen::Vector3d(-7, 5, 11)).norm(), 1e-14);
}

// A third of a turn about (1, 1, 1) permutes the coordinates: x -> y -> z -> x.
TEST(Kinematics, TurnAboutAnObliqueDirection) {
    const std::vector<Axis> axes = {rotary({1, 1, 1}, {2, 2, 2})};
    const Rigid turn = base_from_carriage(axes, std::vector{2 * pi / 3});
    EXPECT_LT((turn * Eigen::Vector3d(5, 7, 11) - Eigen::Vector3d(11, 5, 7)).norm(), 1e-14);
}

TEST(Kinematics, LeaveThePointsOfARotaryAxisWhereTheyAre) {
    const std::vector<Axis> axes = {rotary({1, -2, 3}, {7, 5, -3})};
    const Rigid turn = base_from_carriage(axes, std::vector{0.7});
    const Eigen::Vector3d on_axis = axes[0].point_mm + 11.0 * axes[0].direction;
    EXPECT_LT((turn * on_axis - on_axis).norm(), 1e-13);
}

// By hand. The rotary axis is mounted 100 mm above the base with its z along base x, and its point
// is where it is mounted. A quarter turn from its zero (30 degrees) takes mount x to mount y, that
// is base -z to base y: the linear axis, which goes along mount x, moves the carriage along base y.
TEST(Kinematics, ChainsMountedAxesFromTheirZeros) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {0, 0, 0}), linear({1, 0, 0})};
    axes[0].previous_from_mount = {rotation_from_vector({0, pi / 2, 0}), {0, 0, 100}};
    axes[0].zero = pi / 6;
    axes[1].zero = 7.0;
    const Rigid pose = base_from_carriage(axes, std::vector{pi / 6 + pi / 2, 12.0});
    EXPECT_LT((pose.translation - Eigen::Vector3d(0, 5, 100)).norm(), 1e-13);
    EXPECT_LT((pose.rotation * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-15);
    EXPECT_LT((pose.rotation * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 1, 0)).norm(), 1e-15);
}

// Halfway between the points the axis is 3 um further than it reads.
TEST(Kinematics, GoAsFarAsTheErrorMapSays) {
    std::vector<Axis> axes = {linear({0, 0, -1})};
    axes[0].zero = 2.0;
    axes[0].errors = ErrorMap({{-10, 0.002, 0.0}, {30, 0.004, 0.0}}, {"test"});
    const Rigid pose = base_from_carriage(axes, std::vector{10.0});
    EXPECT_NEAR(pose.translation.z(), -8.003, 1e-12);
    EXPECT_THROW(base_from_carriage(axes, std::vector{31.0}), ConfigError);
    EXPECT_THROW(base_from_carriage(axes, std::vector{1.0, 2.0}), ConfigError);
}

// By hand: 250 mm from its zero 20 ppm are 5 um; the map says 3 um, the reading 1 um, repeatability
// 2 um, backlash 8 um from either side 4 um. Across it leans by 30 urad: 7.5 um.
TEST(StagePose, OfALinearAxisByHand) {
    std::vector<Axis> axes = {linear({0, 1, 0})};
    Axis& y = axes[0];
    y.zero = 50.0;
    y.scale_uncertainty = 20e-6;
    y.errors = ErrorMap({{0, 0, 0.003}, {400, 0, 0.003}}, {"test"});
    y.read_noise = 0.001;
    y.repeatability = 0.002;
    y.backlash = 0.008;
    y.direction_uncertainty = 30e-6;
    const StagePose pose = stage_pose(axes, std::vector{300.0});
    Matrix6d expected = Matrix6d::Zero();
    expected(4, 4) = 1e-6 * (25 + 9 + 1 + 4 + 16);
    expected(3, 3) = expected(5, 5) = std::pow(7.5e-3, 2);
    EXPECT_LT((pose.covariance - expected).norm(), 1e-15) << pose.covariance;
    // Always from the same side the backlash is a constant; a measured spread replaces the noise.
    y.approach = 1;
    y.backlash_uncertainty = 0.0015;
    expected(4, 4) = 1e-6 * (25 + 9 + 36 + 4 + 2.25);
    const StagePose measured = stage_pose(axes, std::vector{300.0}, std::vector{0.006});
    EXPECT_LT((measured.covariance - expected).norm(), 1e-15) << measured.covariance;
}

// By hand: the carriage's origin is 40 mm from a rotary axis along z; 0.1 mrad of angle are 4 um
// along the arc, fully correlated with the rotation.
TEST(StagePose, OfARotaryAxisMovesTheOriginAlongTheArc) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {40, 0, 5})};
    axes[0].repeatability = 1e-4;
    const StagePose pose = stage_pose(axes, std::vector{pi / 2});
    // The origin went from (0, 0) to (40, -40): seen from the axis it is at (0, -40).
    Vector6d arc = Vector6d::Zero();
    arc[2] = 1e-4;
    arc[3] = 40e-4;
    EXPECT_LT((pose.covariance - arc * arc.transpose()).norm(), 1e-17) << pose.covariance;
}

// Half a turn takes the point's error to the other side: the origin moves by twice as much. Halfway
// round, a leaning axis tips the carriage by twice its lean.
TEST(StagePose, OfARotaryAxisKnowsItsPointAndDirection) {
    std::vector<Axis> axes = {rotary({0, 0, 1}, {0, 0, 0})};
    axes[0].point_uncertainty = 0.007;
    axes[0].direction_uncertainty = 5e-5;
    const Matrix6d turned = stage_pose(axes, std::vector{pi}).covariance;
    Matrix6d expected = Matrix6d::Zero();
    expected(0, 0) = expected(1, 1) = std::pow(1e-4, 2);
    expected(3, 3) = expected(4, 4) = std::pow(0.014, 2);
    EXPECT_LT((turned - expected).norm(), 1e-16) << turned;
    EXPECT_EQ(stage_pose(axes, std::vector{0.0}).covariance.norm(), 0.0);
}

// ---- The covariance against draws of axes that are truly as wrong as declared.

// An oblique, mounted chain: linear, rotary, linear, rotary.
std::vector<Axis> uncertain_chain() {
    std::vector<Axis> axes = {linear({3, 1, -2}), rotary({1, -2, 3}, {7, 5, -3}), linear({0, 4, 3}),
                              rotary({2, 7, -1}, {-30, 12, 40})};
    axes[1].previous_from_mount = {rotation_from_vector({0.3, -0.5, 0.7}), {11, -7, 5}};
    axes[3].previous_from_mount = {rotation_from_vector({-0.2, 0.4, 1.1}), {60, 25, -35}};
    axes[0].zero = -20.0;
    axes[1].zero = 0.4;
    axes[0].scale_uncertainty = 200e-6;
    axes[0].direction_uncertainty = 3e-4;
    axes[0].read_noise = 0.01;
    axes[1].repeatability = 2e-4;
    axes[1].direction_uncertainty = 2e-4;
    axes[1].point_uncertainty = 0.02;
    axes[2].errors = ErrorMap({{-50, 0.1, 0.02}, {90, -0.05, 0.04}}, {"test"});
    axes[2].backlash = 0.05;
    axes[2].direction_uncertainty = 5e-4;
    axes[3].backlash_uncertainty = 3e-4;
    axes[3].point_uncertainty = 0.05;
    axes[3].direction_uncertainty = 1e-4;
    return axes;
}

// Independent of the code under test: the model itself is disturbed and the chain evaluated again.
Rigid drawn_pose(std::vector<Axis> axes, std::vector<double> q, RandomStream& random) {
    const auto draw = [&](const std::optional<double>& deviation) {
        return deviation.value_or(0.0) * random.normal();
    };
    for (std::size_t i = 0; i < axes.size(); ++i) {
        Axis& axis = axes[i];
        const double map = axis.errors ? axis.errors->at(q[i])->uncertainty : 0.0;
        const double side = random.uniform() < 0.5 ? -0.5 : 0.5;
        axis.zero -= draw(axis.scale_uncertainty) * (q[i] - axis.zero) + draw(axis.repeatability) +
                     draw(axis.backlash_uncertainty) + draw(axis.read_noise) + draw(map) +
                     side * axis.backlash;
        const Eigen::Vector3d a = axis.direction.unitOrthogonal(), b = axis.direction.cross(a);
        axis.point_mm += draw(axis.point_uncertainty) * a + draw(axis.point_uncertainty) * b;
        const double lean_a = draw(axis.direction_uncertainty),
                     lean_b = draw(axis.direction_uncertainty);
        axis.direction = (axis.direction + lean_a * a + lean_b * b).normalized();
    }
    return base_from_carriage(axes, q);
}

// A sample covariance of n normal draws scatters by sqrt((C_ii C_jj + C_ij^2) / n) about C_ij; the
// two-valued backlash scatters less. 5 of these for each of 21 entries: 1 false alarm in 80 000.
TEST(StagePose, HasTheCovarianceOfDrawnChains) {
    constexpr int draws = 40000;
    const std::vector<Axis> axes = uncertain_chain();
    const std::vector<double> q = {35.0, -0.9, 62.0, 1.3};
    const StagePose pose = stage_pose(axes, q);
    RandomStream random(7, 5);
    Vector6d sum = Vector6d::Zero();
    Matrix6d products = Matrix6d::Zero();
    for (int i = 0; i < draws; ++i) {
        const Vector6d delta =
            left_difference(pose.base_from_carriage, drawn_pose(axes, q, random));
        sum += delta;
        products += delta * delta.transpose();
    }
    const Vector6d mean = sum / draws;
    const Matrix6d sample = products / draws - mean * mean.transpose();
    const Matrix6d& c = pose.covariance;
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j)
            EXPECT_NEAR(sample(i, j), c(i, j),
                        5 * std::sqrt((c(i, i) * c(j, j) + c(i, j) * c(i, j)) / draws))
                << i << ", " << j;
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix6d>(c).eigenvalues().minCoeff(), 0.0);
}

TEST(ApproachDeviation, IsUnknownWithoutARepeatability) {
    Axis axis = linear({1, 0, 0});
    axis.backlash = 0.008;
    EXPECT_FALSE(approach_deviation(axis));
    axis.repeatability = 0.003;
    EXPECT_DOUBLE_EQ(*approach_deviation(axis), 0.005);
    axis.approach = -1;
    EXPECT_DOUBLE_EQ(*approach_deviation(axis), 0.003);
}

}  // namespace
}  // namespace etalon
