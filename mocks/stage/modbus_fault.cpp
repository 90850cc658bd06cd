#include "mocks/stage/modbus_fault.h"

namespace etalon {
namespace {

bool writes_to(const ModbusRequest& request, int address) {
    return !request.values.empty() && address >= request.address &&
           address < request.address + request.count;
}

class FaultScript {
public:
    FaultScript(std::vector<ModbusFault> faults, SimulatedStage& stage)
        : faults_(std::move(faults)), stage_(stage) {}

    ModbusReaction react(const ModbusRequest& request) {
        ++requests_;
        for (std::size_t i = 0; !running_ && i < faults_.size(); ++i) {
            if (!happens(faults_[i].at, request))
                continue;
            running_ = faults_[i];
            faults_.erase(faults_.begin() + static_cast<std::ptrdiff_t>(i));
        }
        if (!running_)
            return {};
        const ModbusReaction reaction = reaction_to(*running_);
        if (--running_->requests <= 0)
            running_.reset();
        return reaction;
    }

private:
    bool happens(const FaultTrigger& at, const ModbusRequest& request) {
        switch (at.when) {
            case FaultTrigger::When::time_ms:
                return stage_.uptime() >= std::chrono::milliseconds(at.value);
            case FaultTrigger::When::move:
                return stage_.moves_started() >= at.value;
            case FaultTrigger::When::request:
                return requests_ >= at.value;
            case FaultTrigger::When::write_to:
                return writes_to(request, at.value);
        }
        return false;
    }

    std::vector<ModbusFault> faults_;  // that have not happened yet
    SimulatedStage& stage_;
    std::optional<ModbusFault> running_;
    int requests_ = 0;
};

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
    return [script = std::make_shared<FaultScript>(std::move(faults), stage)](
               const ModbusRequest& request) { return script->react(request); };
}

}  // namespace etalon
