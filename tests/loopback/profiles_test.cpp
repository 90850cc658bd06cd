// Every shipped profile end to end, over TCP and over a serial line: the client and the twin's
// controller read the same file, and two axes do what they are told. Profiles of one axis drive
// them as two units on one bus.

#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

// Half a count, and the last digit of the conversion.
double half_count(const StageRig& rig, std::size_t axis) {
    return 0.501 / std::abs(rig.profile.counts_of(rig.axes[axis], 1.0) -
                            rig.profile.counts_of(rig.axes[axis], 0.0));
}

void expect_at(StageRig& rig, Stage& stage, const std::vector<double>& target) {
    const std::vector<double> truth = rig.simulation.true_positions(), read = stage.position();
    for (std::size_t i = 0; i < target.size(); ++i) {
        EXPECT_NEAR(truth[i], target[i], half_count(rig, i));
        EXPECT_NEAR(read[i], target[i], half_count(rig, i));
    }
}

// Whether a request gives the command that starts a move.
bool starts(const StageProfile& profile, const ModbusRequest& request) {
    if (request.values.empty())
        return false;
    const auto input = profile.inputs.find(Input::start);
    if (input == profile.inputs.end())
        return request.address == profile.target.back().address;
    const InputPoint& point = input->second;
    return request.address == point.address &&
           (point.act == InputPoint::Act::code ? request.values[0] == point.code
                                               : (request.values[0] >> point.bit & 1) != 0);
}

class ProfileOnAWire : public testing::TestWithParam<std::tuple<std::string, Wire>> {
protected:
    Wire wire() const { return std::get<1>(GetParam()); }
    int units() const { return static_cast<int>(rig.simulation.controllers().size()); }

    StageProfile profile = builtin_stage_profile(std::get<0>(GetParam()));
    StageRig rig{2s, wire(), profile, axes_for(profile)};
};

TEST_P(ProfileOnAWire, EnablesHomesAndMovesToWhereItIsTold) {
    auto stage = rig.connect();
    EXPECT_TRUE(rig.server->writes().empty());
    stage->enable({});
    stage->home({});
    expect_at(rig, *stage, {0.0, 0.0});
    const std::vector<double> first = {7.1234, -0.25}, second = {-5.5, 0.375};
    stage->move(first, {});
    expect_at(rig, *stage, first);
    stage->move(second, {});
    expect_at(rig, *stage, second);
    for (const AxisStatus& axis : stage->status())
        EXPECT_TRUE(axis.enabled && axis.homed && axis.in_position && !axis.moving && !axis.alarm);
    EXPECT_EQ(rig.simulation.moves_started(), 2 * units());
}

TEST_P(ProfileOnAWire, StopsInMidMoveAndGoesOn) {
    auto stage = rig.connect_and_home();
    std::stop_source interrupt;
    rig.server->set_script([&](const ModbusRequest&) {
        if (rig.is_beyond(10.0))
            interrupt.request_stop();
        return ModbusReaction{};
    });
    EXPECT_THROW(stage->move(std::vector{690.0, 1.0}, interrupt.get_token()), Interrupted);
    EXPECT_FALSE(rig.simulation.is_moving());
    EXPECT_LT(rig.simulation.true_positions()[0], 600.0);
    rig.server->set_script({});
    const std::vector<double> target = {7.0, 0.5};
    stage->move(target, {});
    expect_at(rig, *stage, target);
}

TEST_P(ProfileOnAWire, AnAlarmStopsAllAxesAndIsResetWhenEnabledAgain) {
    auto stage = rig.connect_and_home();
    bool raised = false;
    rig.server->set_script([&](const ModbusRequest&) {
        if (!raised && rig.is_beyond(10.0)) {
            rig.simulation.raise_alarm(17);
            raised = true;
        }
        return ModbusReaction{};
    });
    const std::string error = device_error_of([&] { stage->move(std::vector{690.0, 1.0}, {}); });
    EXPECT_NE(error.find(profile.alarm_code ? "axis x: alarm 17" : "axis x: alarm without a"),
              std::string::npos)
        << error;
    EXPECT_NE(error.find("; the axes were stopped"), std::string::npos) << error;
    EXPECT_FALSE(rig.simulation.is_moving());
    rig.server->set_script({});
    stage.reset();
    stage = rig.connect_and_home();
    const std::vector<double> target = {7.0, 0.5};
    stage->move(target, {});
    expect_at(rig, *stage, target);
}

// What the controller takes for a start, however it is given.
TEST_P(ProfileOnAWire, AStartWhoseReplyIsLostIsNotGivenTwice) {
    StageRig impatient(300ms, wire(), profile, axes_for(profile));
    auto stage = impatient.connect_and_home();
    bool dropped = false;
    impatient.server->set_script([&](const ModbusRequest& request) {
        const bool drop = !dropped && starts(profile, request);
        dropped = dropped || drop;
        return ModbusReaction{.reply = !drop};
    });
    const std::vector<double> target = {70.0, 0.5};
    stage->move(target, {});
    EXPECT_TRUE(dropped);
    EXPECT_EQ(impatient.simulation.moves_started(), units());
    expect_at(impatient, *stage, target);
}

INSTANTIATE_TEST_SUITE_P(Every, ProfileOnAWire,
                         testing::Combine(testing::ValuesIn(builtin_stage_profile_names()),
                                          testing::Values(Wire::tcp, Wire::rtu)),
                         [](const auto& one) {
                             std::string name = std::get<0>(one.param);
                             std::erase(name, '-');
                             return name + name_of(std::get<1>(one.param));
                         });

}  // namespace
}  // namespace etalon
