// A controller that does not tell whether its axes are homed.

#include "tests/stage/motion/modbus_rig.h"

namespace etalon {
namespace {

using namespace test;

class ATacitController : public testing::Test {
protected:
    static constexpr int inputs = 0x7D, home_bit = 0x10;  // of base/oriental

    ATacitController() {
        axes[0].counts_per_unit = 800.0;
        rig = std::make_unique<Rig>(builtin_stage_profile("oriental-ar"), axes);
    }
    void ignore_homing() {
        rig->controller.set_script([this](const ModbusRequest& request) {
            const bool home = writes_to(request, inputs) && (request.values[0] & home_bit) != 0;
            homings += home;
            return ModbusReaction{.carry_out = !home};
        });
    }

    std::vector<Axis> axes = {fast_axes()[0]};
    std::unique_ptr<Rig> rig;
    int homings = 0;
};

TEST_F(ATacitController, IsHomedWhenItsAxesWereSeenToMoveForIt) {
    rig->connect_and_home()->move(std::vector{7.0}, {});
    EXPECT_NEAR(rig->simulation.true_positions()[0], 7.0, 1e-6);
}

TEST_F(ATacitController, IsNotTakenForHomedBecauseItRests) {
    ignore_homing();
    auto stage = rig->connect();
    stage->enable({});
    const std::string error = device_error_of([&] { stage->home({}); });
    EXPECT_THAT(
        error,
        HasSubstr("home: axis x did not move, and its controller does not tell whether it is "
                  "homed"));
    EXPECT_THAT(error, HasSubstr("--homed"));
    EXPECT_EQ(homings, 1);
    EXPECT_THROW(stage->move(std::vector{7.0}, {}), DeviceError);
    EXPECT_EQ(rig->simulation.moves_started(), 0);
}

TEST_F(ATacitController, StandsAtItsZeroWhenTheOperatorSaysSo) {
    ignore_homing();
    auto stage = rig->connect();
    stage->take_for_homed();
    stage->enable({});
    EXPECT_EQ(device_error_of([&] { stage->home({}); }), "no error");
    EXPECT_EQ(homings, 1) << "homing is commanded all the same";
}

TEST_F(ATacitController, IsMovedByHandOnTheOperatorsWordAlone) {
    rig->connect_and_home();
    auto stage = rig->connect();
    EXPECT_THAT(device_error_of([&] { stage->resume(); }),
                HasSubstr("say that they are (--homed)"));
    EXPECT_THROW(stage->move(std::vector{7.0}, {}), DeviceError);
    stage->take_for_homed();
    stage->resume();
    stage->move(std::vector{7.0}, {});
    EXPECT_NEAR(rig->simulation.true_positions()[0], 7.0, 1e-6);
}

// What a controller tells, nobody's word outweighs.
TEST(ModbusStageMoves, AControllerThatSaysItIsNotHomedIsBelieved) {
    Rig rig;
    auto stage = rig.connect();
    stage->enable({});
    stage->take_for_homed();
    EXPECT_THAT(device_error_of([&] { stage->resume(); }), HasSubstr("axis x is not homed"));
}

}  // namespace
}  // namespace etalon
