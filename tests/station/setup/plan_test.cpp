#include "station/setup/plan.h"

#include "stage/axes/kinematics.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

const std::vector<Axis> axes = {{.name = "x", .low = -130, .high = 120, .speed = 70},
                                {.name = "y", .low = -90, .high = 95, .speed = 50},
                                {.name = "z", .low = 0, .high = 400, .speed = 110}};

PlanRequest request() {
    return {.volume = {{-120, 110}, {-80, 90}, {50, 350}},
            .poses = 75,
            .hold_out = 0.533,  // 40 of 75
            .frames = 3,
            .seed = 5,
            .settle = std::chrono::milliseconds(70),
            .place = {"station.yaml", 17, "plan.volume"}};
}

Plan plan_of(const PlanRequest& wanted) {
    return make_plan(wanted, axes, std::chrono::milliseconds(5));
}

TEST(Plan, FillsTheVolumeAndStaysInside) {
    const PlanRequest wanted = request();
    const Plan plan = plan_of(wanted);
    ASSERT_EQ(plan.poses.size(), 75u);
    for (std::size_t k = 0; k < axes.size(); ++k) {
        const auto [low, high] = wanted.volume[k];
        double smallest = high, largest = low;
        for (const PlannedPose& pose : plan.poses) {
            smallest = std::min(smallest, pose.target[k]);
            largest = std::max(largest, pose.target[k]);
        }
        EXPECT_GE(smallest, low);
        EXPECT_LE(largest, high);
        EXPECT_LT(smallest, low + 0.1 * (high - low)) << axes[k].name;
        EXPECT_GT(largest, high - 0.1 * (high - low)) << axes[k].name;
    }
}

// Low discrepancy: of n points about n/2 lie in each half of each axis, in both splits. A Halton
// block of 35 or more points misses that by less than 4 in bases 2, 3 and 5.
TEST(Plan, SpreadsTrainingAndHoldOutEachOverTheWholeVolume) {
    const PlanRequest wanted = request();
    const Plan plan = plan_of(wanted);
    for (const bool hold_out : {false, true}) {
        int total = 0;
        std::vector<int> low_half(axes.size());
        for (const PlannedPose& pose : plan.poses) {
            if (pose.hold_out != hold_out)
                continue;
            ++total;
            for (std::size_t k = 0; k < axes.size(); ++k)
                low_half[k] += pose.target[k] < (wanted.volume[k].low + wanted.volume[k].high) / 2;
        }
        EXPECT_EQ(total, hold_out ? 40 : 35);
        for (std::size_t k = 0; k < axes.size(); ++k)
            EXPECT_NEAR(low_half[k], total / 2.0, 4.0) << axes[k].name << hold_out;
    }
}

TEST(Plan, MixesTrainingAndHoldOutInTime) {
    const Plan plan = plan_of(request());
    for (std::size_t begin = 0; begin + 15 <= plan.poses.size(); begin += 15) {
        int hold_out = 0;
        for (std::size_t i = begin; i < begin + 15; ++i)
            hold_out += plan.poses[i].hold_out;
        EXPECT_GE(hold_out, 2) << "poses from " << begin;
        EXPECT_LE(hold_out, 13) << "poses from " << begin;
    }
}

TEST(Plan, ComesToEachAxisFromBothSides) {
    const Plan plan = plan_of(request());
    for (std::size_t k = 0; k < axes.size(); ++k) {
        int upwards = 0, downwards = 0;
        for (std::size_t i = 1; i < plan.poses.size(); ++i) {
            if (!plan.poses[i].hold_out)
                continue;
            const double step = plan.poses[i].target[k] - plan.poses[i - 1].target[k];
            (step > 0 ? upwards : downwards) += 1;
        }
        EXPECT_GE(upwards, 8) << axes[k].name;
        EXPECT_GE(downwards, 8) << axes[k].name;
    }
}

double travelled_s(const std::vector<PlannedPose>& poses) {
    Duration sum{};
    for (std::size_t i = 1; i < poses.size(); ++i)
        sum += travel_time(axes, poses[i - 1].target, poses[i].target);
    return std::chrono::duration<double>(sum).count();
}

TEST(Plan, TravelsLessThanHalfOfWhatARandomOrderWould) {
    const Plan plan = plan_of(request());
    // A random order: every pose to the one half the plan further on.
    std::vector<PlannedPose> shuffled;
    for (std::size_t i = 0; i < plan.poses.size(); ++i)
        shuffled.push_back(plan.poses[i * 37 % plan.poses.size()]);
    EXPECT_LT(travelled_s(plan.poses), 0.5 * travelled_s(shuffled));
}

TEST(Plan, IsTheSameForTheSameSeedAndAnotherForAnother) {
    PlanRequest wanted = request();
    const Plan first = plan_of(wanted), again = plan_of(wanted);
    wanted.seed = 6;
    const Plan other = plan_of(wanted);
    for (std::size_t i = 0; i < first.poses.size(); ++i)
        EXPECT_EQ(first.poses[i].target, again.poses[i].target);
    EXPECT_NE(first.poses[0].target, other.poses[0].target);
}

TEST(Plan, KeepsAnAxisThatIsNotToMoveWhereItIs) {
    PlanRequest wanted = request();
    wanted.volume[1] = {17, 17};
    for (const PlannedPose& pose : plan_of(wanted).poses)
        EXPECT_EQ(pose.target[1], 17);
}

TEST(Plan, RefusesAPoseOutsideTheSoftLimitsNamingAxisAndPose) {
    PlanRequest wanted = request();
    wanted.volume[1].high = 300;
    const std::string message = config_error_of([&] { plan_of(wanted); });
    EXPECT_TRUE(message.starts_with("station.yaml:17: plan.volume (pose ")) << message;
    EXPECT_TRUE(has(message, "y")) << message;
}

TEST(Plan, RefusesASplitWithAnEmptySide) {
    PlanRequest wanted = request();
    wanted.poses = 3;
    wanted.hold_out = 0.1;
    EXPECT_THROW(plan_of(wanted), ConfigError);
}

// A box in the middle of the volume, of 8 % of its size, and whole axes of slow ways beside it.
TEST(Plan, KeepsOutOfForbiddenBoxesOnItsWayAsWell) {
    const PlanRequest wanted = request();
    const MotionRules rules{{{"lens", {{-60, 30}, {-40, 50}, {100, 250}}}}, {5, 5, 5}, 0.25};
    const Plan plan = make_plan(wanted, axes, std::chrono::milliseconds(5), rules);
    ASSERT_EQ(plan.poses.size(), 75u);
    ASSERT_EQ(plan.legs.size(), 75u);
    EXPECT_EQ(std::ranges::count(plan.poses, true, &PlannedPose::hold_out), 40);
    const std::vector<double> home = {0, 0, 0};
    std::size_t split = 0;
    Duration travel{};
    for (std::size_t i = 0; i < plan.poses.size(); ++i) {
        EXPECT_TRUE(is_clear(axes, rules, plan.poses[i].target));
        EXPECT_EQ(plan.legs[i].front().from, i == 0 ? home : plan.poses[i - 1].target);
        EXPECT_EQ(plan.legs[i].back().to, plan.poses[i].target);
        split += plan.legs[i].size() > 1;
        for (const MotionSegment& segment : plan.legs[i])
            travel += segment.time;
    }
    EXPECT_GE(split, 3u);
    EXPECT_EQ(plan.expected_duration,
              travel + 75 * (std::chrono::milliseconds(70) + 3 * std::chrono::milliseconds(35)));
}

TEST(Plan, LeavesOutWhatIsOfNoUse) {
    const auto is_useful = [](const std::vector<double>& target) {
        return target[0] + 2.0 * target[1] < 50.0;
    };
    const Plan plan = make_plan(request(), axes, {}, {}, is_useful);
    ASSERT_EQ(plan.poses.size(), 75u);
    for (const PlannedPose& pose : plan.poses)
        EXPECT_TRUE(is_useful(pose.target));
}

// Six of the 40, spread over the path; the first way back starts at the path's end.
TEST(Plan, VisitsHoldOutPosesAgainInReverse) {
    PlanRequest wanted = request();
    const Plan once = plan_of(wanted);
    wanted.repeats = 6;
    const Plan plan = plan_of(wanted);
    ASSERT_EQ(plan.poses.size(), 81u);
    ASSERT_EQ(plan.legs.size(), 81u);
    std::size_t last = 75;
    for (std::size_t i = 0; i < plan.poses.size(); ++i) {
        const auto before = plan.poses[i].repeats;
        EXPECT_EQ(before.has_value(), i >= 75) << i;
        if (i < 75) {
            EXPECT_EQ(plan.poses[i].target, once.poses[i].target);
            continue;
        }
        EXPECT_TRUE(plan.poses[i].hold_out && plan.poses[*before].hold_out);
        EXPECT_LT(*before, last);
        EXPECT_GT(*before + 20, last) << "a sixth of 75 poses and what lies between";
        last = *before;
    }
    wanted.repeats = 41;
    EXPECT_THROW(plan_of(wanted), ConfigError);
}

// Where a position was gone to upwards it is mostly come to downwards the second time.
TEST(Plan, ComesToRepeatedPosesMostlyFromTheOtherSide) {
    PlanRequest wanted = request();
    wanted.repeats = 20;
    const Plan plan = plan_of(wanted);
    const auto step = [&](std::size_t pose, std::size_t axis) {
        return plan.poses[pose].target[axis] - plan.poses[pose - 1].target[axis];
    };
    int other = 0, same = 0;
    for (std::size_t i = 75; i < plan.poses.size(); ++i)
        if (const std::size_t before = *plan.poses[i].repeats; before > 0)
            for (std::size_t k = 0; k < axes.size(); ++k)
                (step(i, k) * step(before, k) < 0.0 ? other : same) += 1;
    EXPECT_GT(other, same);
}

// And from a camera that stands 5 m beside the stage, where there is nothing to be seen, no plan.
TEST(Plan, KeepsToWhatTheCameraSees) {
    const TemporaryFolder folder;
    StationFile station = read_station(write_station(folder, station_text));
    station.camera_from_base_nominal = Rigid{Eigen::Quaterniond::Identity(), {0.0, 0.0, 380.0}};
    const Plan plan = plan_of(station);
    const Projector projector(station.camera.model);
    EXPECT_EQ(std::ssize(plan.poses), station.plan.poses + station.plan.repeats);
    for (const PlannedPose& pose : plan.poses) {
        const Rigid camera_from_marker = *station.camera_from_base_nominal *
                                         base_from_carriage(station.stage.axes, pose.target) *
                                         station.carriage_from_marker_nominal;
        for (const Eigen::Vector3d& point : station.marker.points_mm) {
            const auto pixel = projector.project(camera_from_marker * point);
            ASSERT_TRUE(pixel);
            EXPECT_GT(pixel->minCoeff(), 0.02 * station.camera.model.width);
            EXPECT_LT(pixel->x(), 0.98 * station.camera.model.width);
        }
    }
    station.camera_from_base_nominal->translation.x() = 5000.0;
    EXPECT_THROW(plan_of(station), ConfigError);
}

TEST(Plan, RefusesAVolumeWithoutRoom) {
    const auto error = [](const MotionRules& rules) {
        return config_error_of([&] { make_plan(request(), axes, {}, rules); });
    };
    EXPECT_EQ(
        error({{{"all", {{-121, 111}, {}, {}}}}, {}, 1.0}),
        "station.yaml:17: plan.volume: hardly any of it is clear of forbidden boxes and seen by "
        "the camera: 0 of 7500 points");
    // A wall through the whole travel.
    EXPECT_TRUE(has(error({{{"wall", {{}, {5, 15}, {}}}}, {}, 1.0}), "no way was found"));
}

// x: 70 mm at 70 mm/s, y: 100 mm at 50 mm/s, z: 55 mm at 110 mm/s, together: the slowest counts.
TEST(Plan, TakesTheSlowestAxisForTheTravelTime) {
    const std::vector<double> from = {0, 0, 0}, to = {70, -100, 55};
    EXPECT_EQ(travel_time(axes, from, to), std::chrono::seconds(2));
}

TEST(Plan, ExpectsAtLeastTravelSettlingAndExposures) {
    const Plan plan = plan_of(request());
    const double least_s = travelled_s(plan.poses) + 75 * (0.070 + 3 * 0.005);
    EXPECT_GT(std::chrono::duration<double>(plan.expected_duration).count(), least_s);
    EXPECT_LT(std::chrono::duration<double>(plan.expected_duration).count(), 2 * least_s);
}

// 230 mm at 1e-7 mm/s are 73 years; at 1e-300 no clock counts that far.
TEST(Plan, RefusesWhatWouldTakeMoreThanAYear) {
    for (const double speed : {1e-7, 1e-300}) {
        std::vector<Axis> slow = axes;
        slow[0].speed = speed;
        EXPECT_GT(
            travel_time(slow, std::vector<double>{-120, 0, 0}, std::vector<double>{110, 0, 0}),
            Duration{});
        EXPECT_EQ(
            config_error_of([&] { make_plan(request(), slow, std::chrono::milliseconds(5)); }),
            "station.yaml:17: plan.volume: the poses would take more than a year");
    }
}

}  // namespace
}  // namespace etalon
