// A stage whose controller answers what it likes: its axes are enabled, homed, moved and stopped on
// virtual time, with every profile that is built in. The controller keeps what is written to it;
// before each answer the input changes a register or makes it fail.
// Input: profile, then for each answer a byte that says how, and what it needs.
#include <map>

#include "stage/motion/modbus_stage.h"
#include "tests/fakes/test_axes.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

class Controller final : public ModbusTransport {
public:
    explicit Controller(std::span<const std::uint8_t> input) : input_(input) {}

    std::string connect(std::chrono::milliseconds) override { return {}; }
    void close() noexcept override {}
    Heard discard(Duration) override { return Heard::nothing; }

    ModbusReply exchange(const ModbusRequest& request, std::chrono::milliseconds) override {
        if (input_.empty())
            return {.values = {}, .cause = "it is gone"};
        const std::uint8_t how = next();
        if (how >= 0xFC)
            return {ModbusReply::Outcome::refused, 1 + how % 4, {}, "it will not"};
        if (how >= 0xF8)
            return {.values = {}, .cause = "it is silent"};
        const int space = space_of(request.function);
        if (how >= 0x80) {
            const int address = request.address + next() % request.count;
            const int high = next();
            registers_[{space, address}] = static_cast<std::uint16_t>(high << 8 | next());
        }
        return answer(request, space);
    }

private:
    static int space_of(int function) {
        return function == 5 || function == 15 ? 1 : function == 6 || function == 16 ? 3 : function;
    }

    ModbusReply answer(const ModbusRequest& request, int space) {
        ModbusReply reply{.outcome = ModbusReply::Outcome::answered, .values = {}, .cause = {}};
        for (int i = 0; i < request.count; ++i) {
            std::uint16_t& held = registers_[{space, request.address + i}];
            if (request.values.empty())
                reply.values.push_back(space <= 2 ? held & 1 : held);
            else
                held = request.values[static_cast<std::size_t>(i)];
        }
        return reply;
    }

    std::uint8_t next() {
        if (input_.empty())
            return 0;
        const std::uint8_t byte = input_.front();
        input_ = input_.subspan(1);
        return byte;
    }

    std::span<const std::uint8_t> input_;
    std::map<std::pair<int, int>, std::uint16_t> registers_;
};

const std::vector<StageProfile>& profiles() {
    static const std::vector<StageProfile> all = [] {
        std::vector<StageProfile> read;
        for (const std::string& name : builtin_stage_profile_names())
            read.push_back(builtin_stage_profile(name));
        return read;
    }();
    return all;
}

// Axes with all that a profile may leave to them.
std::vector<Axis> axes_driven(const StageProfile& profile) {
    std::vector<Axis> axes = xz();
    axes.resize(std::min<std::size_t>(axes.size(), static_cast<std::size_t>(profile.max_axes)));
    for (Axis& axis : axes) {
        if (!profile.counts.per_mm)
            axis.counts_per_unit = 1000.0;
        axis.lead = 5.0;
    }
    return axes;
}

void drive(std::span<const std::uint8_t> input) {
    const StageProfile& profile = profiles()[input[0] % profiles().size()];
    const std::vector<Axis> axes = axes_driven(profile);
    VirtualClock clock;
    const auto stage =
        open_modbus_stage({}, profile, axes, clock, std::make_unique<Controller>(input.subspan(1)));
    stage->enable({});
    stage->home({});
    const std::vector<double> target{-12.5, 33.0};
    stage->move(std::span(target).first(axes.size()), {});
    require_all_finite(stage->position());
    for (const AxisStatus& status : stage->status())
        require_finite(status.position);
    stage->stop();
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    if (size > 1)
        read_or_refuse([&] { drive({data, size}); });
    return 0;
}
