// A stage controller on Modbus TCP (127.0.0.1) or on a serial line with Modbus RTU: the registers
// of a profile in front of a simulated stage. For the twin and for tests, which script its faults.
#pragma once

#include <memory>
#include <vector>

#include "mocks/stage/modbus_controller.h"
#include "mocks/stage/modbus_fault.h"
#include "mocks/stage/modbus_server.h"
#include "mocks/stage/serial_pair.h"
#include "mocks/stage/simulated_stage.h"
#include "stage/profile/profile.h"

namespace etalon {

class ModbusStageServer {
public:
    // Listens at once; port 0 takes any free one. Throws DeviceError when the port is taken,
    // ConfigError when it is none. The stage must outlive the server. One thread serves every
    // client (at most 16). Axes that name no unit answer to every unit.
    ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, int port = 0);

    // Answers on the serial line, which must outlive the server. Axes that name no unit answer to
    // `unit`; to others nobody answers.
    ModbusStageServer(SimulatedStage& stage, const StageProfile& profile, const SerialPair& line,
                      int unit = 1);

    int port() const;  // the bound one; 0 on a serial line

    // Asked about every request from now on, on the server's thread; an empty one ends the faults.
    // Safe from every thread.
    void set_script(ModbusScript script);

    // Closes every connection that is open now; a serial line has none.
    void close_connections();

    // Every write that was carried out, in order. Safe from every thread.
    std::vector<ModbusRequest> writes() const;

private:
    std::unique_ptr<ModbusController> controller_;
    std::unique_ptr<ModbusServer> server_;  // last: its thread uses the other
};

}  // namespace etalon
