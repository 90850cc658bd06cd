#include "mocks/stage/modbus_controller.h"

#include <algorithm>

namespace etalon {
namespace {

RegisterSpace space_of(int function) {
    if (function == 1 || function == 5 || function == 15)
        return RegisterSpace::coils;
    return function == 2   ? RegisterSpace::discrete_inputs
           : function == 4 ? RegisterSpace::input_registers
                           : RegisterSpace::holding_registers;
}

}  // namespace

ModbusController::ModbusController(SimulatedStage& stage, const StageProfile& profile,
                                   std::optional<int> unit)
    : stage_(stage) {
    for (std::size_t i = 0; i < stage.controllers().size(); ++i) {
        const std::optional<int> own = stage.controllers()[i].unit;
        units_.push_back({own ? own : unit, StageRegisters(stage, profile, i)});
    }
}

bool ModbusController::has_unit(int unit) const {
    return std::ranges::any_of(units_, [unit](const Unit& one) { return is(one, unit); });
}

ModbusAnswer ModbusController::handle(const ModbusRequest& request) {
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

void ModbusController::carry_out(StageRegisters& registers, const ModbusRequest& request,
                                 ModbusAnswer& answer) {
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

void ModbusController::tick() {
    for (Unit& unit : units_)
        unit.registers.check_watchdog();
}

void ModbusController::set_script(ModbusScript script) {
    const std::scoped_lock lock(mutex_);
    script_ = std::move(script);
}

std::vector<ModbusRequest> ModbusController::writes() const {
    const std::scoped_lock lock(mutex_);
    return writes_;
}

}  // namespace etalon
