// A stage controller as its bus sees it: requests for its units are carried out on the registers of
// a profile, in front of a simulated stage, and a script says which of them go wrong. Behind
// sockets and serial lines (ModbusStageServer) or in memory
// (tests/fakes/memory_transport.h).
#pragma once

#include <mutex>
#include <optional>
#include <vector>

#include "mocks/stage/modbus_server.h"
#include "mocks/stage/stage_registers.h"

namespace etalon {

class ModbusController : public ModbusUnits {
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

    // Asked about every request from now on, on the server's thread; an empty one ends the faults.
    // Safe from every thread.
    void set_script(ModbusScript script);

    // Every write that was carried out, in order. Safe from every thread.
    std::vector<ModbusRequest> writes() const;

private:
    struct Unit {
        std::optional<int> number;  // nothing: every
        StageRegisters registers;
    };

    static bool is(const Unit& unit, int number) { return !unit.number || *unit.number == number; }
    void carry_out(StageRegisters& registers, const ModbusRequest& request, ModbusAnswer& answer);

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
