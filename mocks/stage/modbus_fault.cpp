#include "mocks/stage/modbus_fault.h"

namespace etalon {
namespace {

bool happens(const FaultTrigger& at, const ModbusRequest& request, int requests,
             SimulatedStage& stage) {
    switch (at.when) {
        case FaultTrigger::When::time_ms:
            return stage.uptime() >= std::chrono::milliseconds(at.value);
        case FaultTrigger::When::move:
            return stage.moves_started() >= at.value;
        case FaultTrigger::When::request:
            return requests >= at.value;
        default:
            return !request.values.empty() && at.value >= request.address &&
                   at.value < request.address + request.count;
    }
}

}  // namespace

ModbusReaction reaction_to(const ModbusFault& fault) {
    using Kind = ModbusFault::Kind;
    using namespace std::chrono_literals;
    const auto is = [&](Kind kind) { return fault.kind == kind; };
    return {.carry_out = fault.carried_out || is(Kind::late_reply) || is(Kind::slow_bytes),
            .reply = !is(Kind::silence) && !is(Kind::half_open) && !is(Kind::reset),
            .delay = is(Kind::late_reply) ? fault.delay : 0ms,
            .close = is(Kind::reset),
            .exception = is(Kind::exception) ? fault.code : 0,
            .garbage = is(Kind::garbage),
            .wrong_id = is(Kind::wrong_id),
            .between_bytes = is(Kind::slow_bytes) ? fault.delay : 0ms,
            .half_open = is(Kind::half_open)};
}

ModbusScript scripted_faults(std::vector<ModbusFault> faults, SimulatedStage& stage) {
    struct State {
        std::vector<ModbusFault> pending;  // that have not happened yet
        std::optional<ModbusFault> running = {};
        int requests = 0;
    };
    return [&stage, state = std::make_shared<State>(State{std::move(faults)})](
               const ModbusRequest& request) {
        ++state->requests;
        const auto due = std::ranges::find_if(state->pending, [&](const ModbusFault& fault) {
            return happens(fault.at, request, state->requests, stage);
        });
        if (!state->running && due != state->pending.end()) {
            state->running = *due;
            state->pending.erase(due);
        }
        if (!state->running)
            return ModbusReaction{};
        const ModbusReaction reaction = reaction_to(*state->running);
        if (--state->running->requests <= 0)
            state->running.reset();
        return reaction;
    };
}

}  // namespace etalon
