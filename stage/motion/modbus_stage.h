// A stage behind Modbus TCP or RTU: carries out a profile's sequences (stage/profile/profile.h) on
// all units of its axes. What keeps it safe:
//
//   * targets are read back before the start, where the profile allows it;
//   * a motion command without a reply is read back before it is given again; where that tells
//     nothing the axes must be seen to start. Targets are absolute;
//   * an emergency stop, alarm, limit switch or impossible position in any poll ends the run;
//   * after any failure the axes are stopped first, and the error says whether that was confirmed;
//   * the controller's watchdog, where there is one, stops the axes when the program is gone.
//
// One owner thread; trace() from any.
#pragma once

#include "stage/link/modbus_transport.h"
#include "stage/motion/stage.h"
#include "stage/profile/profile.h"

namespace etalon {

// Connects and reads the status once; commands nothing. Consecutive axes of a unit are one
// controller's. Throws ConfigError when the axes do not fit the profile or the link's numbers are
// out of range, DeviceError when nobody answers. The clock must outlive the stage.
std::unique_ptr<Stage> open_modbus_stage(const StageLink& link, StageProfile profile,
                                         std::vector<Axis> axes, Clock& clock,
                                         std::unique_ptr<ModbusTransport> transport = nullptr,
                                         Opening opening = Opening::asks);

}  // namespace etalon
