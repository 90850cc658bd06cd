// The link's guards against what a wire can do, on virtual time: thousands of faults in a moment.
#include "tests/fakes/memory_transport.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Registers 100 to 131 of the generic profile keep what is written to them.
constexpr int first_register = 100, register_count = 32;

std::uint16_t content_of(int address) {
    return static_cast<std::uint16_t>(address * 7 + 5);
}

struct Rig {
    explicit Rig(bool serial)
        : link(memory_link(serial), clock,
               std::make_unique<MemoryTransport>(controller, clock, serial)) {
        std::vector<std::uint16_t> values;
        for (int i = 0; i < register_count; ++i)
            values.push_back(content_of(first_register + i));
        link.write(1, RegisterSpace::holding_registers, first_register, values);
    }

    VirtualClock clock;
    StageProfile profile = builtin_stage_profile("generic");
    SimulatedStage stage{{{.name = "x", .low = -7.0, .high = 700.0, .speed = 50.0}}, {}, clock};
    ModbusController controller{stage, profile, 1};
    ModbusLink link;
};

// What the guards are for: without them the next request takes the old reply for its own.
TEST(MemoryTransport, GivesALateSerialReplyToTheNextRequest) {
    Rig rig(true);
    MemoryTransport bare(rig.controller, rig.clock, true);
    ASSERT_EQ(bare.connect(100ms), "");
    rig.controller.set_script([&](const ModbusRequest& request) {
        return ModbusReaction{.delay = request.address == 103 ? 150ms : 0ms};
    });
    EXPECT_EQ(bare.exchange({1, 3, 103, 2, {}}, 100ms).outcome, ModbusReply::Outcome::unknown);
    rig.clock.advance(45ms);
    bare.close();
    ASSERT_EQ(bare.connect(100ms), "");
    rig.controller.set_script([](const ModbusRequest&) { return ModbusReaction{.delay = 20ms}; });
    const ModbusReply reply = bare.exchange({1, 3, 107, 2, {}}, 100ms);
    EXPECT_EQ(reply.outcome, ModbusReply::Outcome::answered);
    EXPECT_EQ(reply.values.front(), content_of(103)) << "of another register";
}

// Every fault at random, one request in five, on a socket and on a serial line. A wrong value or a
// write that is carried out twice would show.
TEST(MemoryTransport, NoFaultMakesAWrongValue) {
    for (const bool serial : {false, true}) {
        Rig rig(serial);
        RandomStream random(7, 5, serial ? 1 : 0);
        const auto draw = [&](int count) { return static_cast<int>(random.uniform() * count); };
        int faults = 0;
        rig.controller.set_script([&](const ModbusRequest&) {
            if (draw(5) != 0)
                return ModbusReaction{};
            ++faults;
            ModbusFault fault{.kind = static_cast<ModbusFault::Kind>(draw(8)),
                              .delay = std::chrono::milliseconds(draw(240)),
                              .code = 6,
                              .carried_out = draw(2) == 0};
            if (fault.kind == ModbusFault::Kind::slow_bytes)
                fault.delay /= 10;
            return reaction_to(fault);
        });
        int failed = 0, wrong = 0;
        for (int i = 0; i < 10'000; ++i) {
            const int address = first_register + draw(register_count - 1);
            try {
                const auto values = rig.link.read(1, RegisterSpace::holding_registers, address, 2);
                wrong += values != std::vector{content_of(address), content_of(address + 1)};
            } catch (const DeviceError&) {
                ++failed;
            }
        }
        EXPECT_EQ(wrong, 0);
        EXPECT_GT(faults, 2000);
        EXPECT_LT(failed, 300) << "three attempts each: 1 in 125, more where faults last";
        EXPECT_EQ(rig.controller.writes().size(), 1U);
    }
}

TEST(MemoryTransport, TheWatchdogRunsWhileTheStationWaits) {
    Rig rig(false);
    const std::vector<std::uint16_t> watchdog = {70};
    for (const std::uint16_t command : {1, 3, 1}) {  // enable, home
        rig.link.write(1, RegisterSpace::holding_registers, 200, std::span(&command, 1));
        rig.clock.advance(30s);
    }
    rig.link.write(1, RegisterSpace::holding_registers, 201, watchdog);
    rig.stage.start({690.0}, {50.0});
    rig.controller.set_script([](const ModbusRequest&) { return ModbusReaction{.reply = false}; });
    EXPECT_THROW(rig.link.read(1, RegisterSpace::holding_registers, 100, 1, 1), DeviceError);
    EXPECT_EQ(rig.stage.status()[0].alarm, StageAlarm::watchdog);
    // 70 ms after the write, looked at every 10 ms; 50 mm/s.
    EXPECT_LT(rig.stage.true_positions()[0], 50.0 * 0.1);
}

}  // namespace
}  // namespace etalon
