// A stage controller as its bus sees it: requests for its units act on a profile's registers, in
// front of a simulated stage; a script says which go wrong. Behind sockets and serial lines
// (ModbusStageServer) or in memory (tests/fakes/memory_transport.h).
#pragma once

#include "mocks/stage/modbus_server.h"
#include "mocks/stage/stage_registers.h"

namespace etalon {

class ModbusController : public ModbusUnits {
public:
    // One unit for each of the stage's controllers. A controller whose axes name no unit answers to
    // `unit`, and to every unit if there is none. The stage must outlive this. Throws ConfigError
    // when a controller has more axes than the profile.
    ModbusController(SimulatedStage& stage, const StageProfile& profile,
                     std::optional<int> unit = std::nullopt)
        : stage_(stage) {
        for (std::size_t i = 0; i < stage.controllers().size(); ++i) {
            const std::optional<int> own = stage.controllers()[i].unit;
            units_.push_back({own ? own : unit, StageRegisters(stage, profile, i)});
        }
    }

    bool has_unit(int unit) const override {
        return std::ranges::any_of(units_, [unit](const Unit& one) { return is(one, unit); });
    }

    // On one thread: carries the request out. The unit must be here.
    ModbusAnswer handle(const ModbusRequest& request) override {
        const auto unit =
            std::ranges::find_if(units_, [&](const Unit& one) { return is(one, request.unit); });
        const bool writes = !request.values.empty();
        stage_.notice_request(request.address, writes ? request.count : 0);
        ModbusScript script;
        {
            const std::scoped_lock lock(mutex_);
            script = script_;
        }
        ModbusAnswer answer;
        if (script)
            answer.reaction = script(request);
        if (answer.reaction.exception != 0)
            answer.exception = answer.reaction.exception;
        else if (answer.reaction.carry_out)
            carry_out(unit->registers, request, answer);
        else
            answer.values.resize(writes ? 0 : static_cast<std::size_t>(request.count));
        return answer;
    }

    // On the same thread, every few milliseconds: the controllers' own watchdogs.
    void tick() override {
        for (Unit& unit : units_)
            unit.registers.check_watchdog();
    }

    // Asked about every request from now on, on the server's thread; an empty one ends the faults.
    // Safe from every thread.
    void set_script(ModbusScript script) {
        const std::scoped_lock lock(mutex_);
        script_ = std::move(script);
    }

    // Every write that was carried out, in order. Safe from every thread.
    std::vector<ModbusRequest> writes() const {
        const std::scoped_lock lock(mutex_);
        return writes_;
    }

private:
    static RegisterSpace space_of(int function) {
        if (function == 1 || function == 5 || function == 15)
            return RegisterSpace::coils;
        return function == 2   ? RegisterSpace::discrete_inputs
               : function == 4 ? RegisterSpace::input_registers
                               : RegisterSpace::holding_registers;
    }

    struct Unit {
        std::optional<int> number;  // nothing: every
        StageRegisters registers;
    };

    static bool is(const Unit& unit, int number) { return !unit.number || *unit.number == number; }
    void carry_out(StageRegisters& registers, const ModbusRequest& request, ModbusAnswer& answer) {
        const RegisterSpace space = space_of(request.function);
        if (request.values.empty()) {
            const auto values = registers.read(space, request.address, request.count);
            answer.exception = values ? no_exception : illegal_address;
            answer.values = values.value_or(std::vector<std::uint16_t>{});
        } else if (registers.write(space, request.address, request.values)) {
            const std::scoped_lock lock(mutex_);
            writes_.push_back(request);
        } else {
            answer.exception = illegal_address;
        }
    }

    SimulatedStage& stage_;
    std::vector<Unit> units_;
    mutable std::mutex mutex_;
    ModbusScript script_;
    std::vector<ModbusRequest> writes_;
};

// A controller on Modbus TCP (127.0.0.1) or on a serial line with Modbus RTU. Throws as
// ModbusServer.
class ModbusStageServer final : public ModbusController {
public:
    // Axes that name no unit answer to every unit.
    ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, int port = 0)
        : ModbusController(stage, profile), server_(*this, port) {}

    // Axes that name no unit answer to `unit`; to others nobody answers.
    ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, const SerialPair& line,
                      int unit = 1)
        : ModbusController(stage, profile, unit), server_(*this, line) {}

    int port() const { return server_.port(); }
    void close_connections() { server_.close_connections(); }

private:
    ModbusServer server_;  // last: its thread uses the others
};

}  // namespace etalon
