// A stage controller as its bus sees it: requests for its units are carried out on the registers of
// a profile, in front of a simulated stage, and a script says which of them go wrong. Behind
// sockets and serial lines (mocks/stage/modbus_stage_server.h) or in memory
// (tests/fakes/memory_transport.h).
#pragma once

#include <mutex>
#include <optional>
#include <vector>

#include "mocks/stage/modbus_fault.h"
#include "mocks/stage/modbus_framing.h"
#include "mocks/stage/modbus_server.h"
#include "mocks/stage/simulated_stage.h"
#include "mocks/stage/stage_registers.h"
#include "stage/profile/profile.h"

namespace etalon {

class ModbusController final : public ModbusUnits {
public:
    // One unit for each of the stage's controllers. A controller whose axes name no unit answers to
    // `unit`, and to every unit if there is none. The stage must outlive this. Throws ConfigError
    // when a controller has more axes than the profile.
    ModbusController(SimulatedStage& stage, const StageProfile& profile,
                     std::optional<int> unit = std::nullopt);

    bool has_unit(int unit) const override;

    // On one thread: carries the request out. The unit must be here.
    ModbusAnswer handle(const ModbusRequest& request) override;

    // On the same thread, every few milliseconds: the controllers' own watchdogs.
    void tick() override;

    // Safe from every thread, as in ModbusStageServer.
    void set_script(ModbusScript script);
    std::vector<ModbusRequest> writes() const;

private:
    struct Unit {
        std::optional<int> number;  // nothing: every
        StageRegisters registers;
    };

    static bool is(const Unit& unit, int number) { return !unit.number || *unit.number == number; }
    ModbusReaction ask_script(const ModbusRequest& request);
    void carry_out(StageRegisters& registers, const ModbusRequest& request, ModbusAnswer& answer);

    SimulatedStage& stage_;
    std::vector<Unit> units_;
    mutable std::mutex mutex_;
    ModbusScript script_;
    std::vector<ModbusRequest> writes_;
};

}  // namespace etalon
