#include "mocks/stage/modbus_fault.h"

#include "tests/test.h"

namespace etalon {
namespace {

using LinkFault = ModbusFault::Kind;
using When = FaultTrigger::When;

struct FaultyLinkRig {
    VirtualClock clock;
    SimulatedStage stage{{{.name = "x", .low = -7.0, .high = 700.0, .speed = 50.0}}, {}, clock};
    const ModbusRequest reading{1, 3, 0, 5, {}};
    const ModbusRequest writing{1, 16, 100, 3, {1, 2, 3}};
};

TEST(ScriptedFaults, HappenWithTheCountedRequestAndAsManyInARow) {
    FaultyLinkRig rig;
    const auto script = scripted_faults(
        {{.kind = LinkFault::silence, .at = {When::request, 3}, .requests = 2}}, rig.stage);
    std::vector<bool> replies;
    for (int i = 0; i < 6; ++i)
        replies.push_back(script(rig.reading).reply);
    EXPECT_EQ(replies, (std::vector<bool>{true, true, false, false, true, true}));
}

TEST(ScriptedFaults, HappenWithTheFirstWriteToARegister) {
    FaultyLinkRig rig;
    const auto script = scripted_faults(
        {{.kind = LinkFault::exception, .at = {When::write_to, 102}, .code = 4}}, rig.stage);
    EXPECT_EQ(script({1, 3, 102, 1, {}}).exception, 0) << "only reads";
    EXPECT_EQ(script({1, 6, 103, 1, {7}}).exception, 0) << "beside it";
    EXPECT_EQ(script(rig.writing).exception, 4);
    EXPECT_EQ(script(rig.writing).exception, 0);
}

TEST(ScriptedFaults, HappenAfterATimeAndAfterAMove) {
    FaultyLinkRig rig;
    const auto script =
        scripted_faults({{.kind = LinkFault::slow_bytes, .at = {When::time_ms, 250}, .delay = 5ms},
                         {.kind = LinkFault::reset, .at = {When::move, 1}, .carried_out = false}},
                        rig.stage);
    EXPECT_EQ(script(rig.reading).between_bytes, 0ms);
    rig.clock.advance(251ms);
    EXPECT_EQ(script(rig.reading).between_bytes, 5ms);
    EXPECT_FALSE(script(rig.reading).close);
    rig.stage.enable(true);
    rig.stage.home();
    rig.clock.advance(30s);
    rig.stage.start({7.0}, {50.0});
    const ModbusReaction reaction = script(rig.reading);
    EXPECT_TRUE(reaction.close);
    EXPECT_FALSE(reaction.carry_out);
    EXPECT_FALSE(script(rig.reading).close);
}

}  // namespace
}  // namespace etalon
