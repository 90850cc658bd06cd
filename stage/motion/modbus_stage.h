// A stage behind Modbus TCP or RTU: carries out the sequences of a profile
// (stage/profile/profile.h) on all units that drive its axes. What keeps it safe:
//
//   * targets are read back before the start, where the profile allows it;
//   * a command for motion whose reply is missing is read back before it is given again; where that
//     tells nothing the axes must be seen to start. Targets are absolute;
//   * an emergency stop, alarm or limit switch in any poll ends the run; so does a position that no
//     axis can have reached;
//   * after any failure the axes are stopped first, then the error says whether that was confirmed;
//   * the controller's watchdog, where there is one, stops the axes when nobody is left to do it.
//
// One owner thread; trace() from any.
#pragma once

#include "stage/link/modbus_transport.h"
#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

// Connects and reads the status once; commands nothing. Consecutive axes of the same unit are
// one controller's. Throws ConfigError when the axes do not fit the profile (number, counts,
// units) or the link's numbers are out of range, DeviceError when nobody answers. The clock
// must outlive the stage. Without a transport libmodbus is taken.
std::unique_ptr<Stage> open_modbus_stage(const StageLink& link, StageProfile profile,
                                         std::vector<Axis> axes, Clock& clock,
                                         std::unique_ptr<ModbusTransport> transport = nullptr,
                                         Opening opening = Opening::asks);

}  // namespace etalon
