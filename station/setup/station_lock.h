// One program moves a stage at a time: an advisory lock, held while a run or a motion goes on, with
// the name of who holds it. The kernel releases it when its holder dies, however it dies. Reading
// and stopping need none.
//
// It is a file for each controller: address, port and Modbus unit, or the serial device. A loopback
// address is another place in each network namespace. The folder is $ETALON_LOCK_FOLDER, else
// /run/lock where everybody may write, else /tmp. Programs that see different folders, and those
// that do not ask, are not kept off: docs/stage.md says what protects then.
#pragma once

#include "station/setup/station_file.h"

namespace etalon {

class StationLock {
public:
    // Does not wait. Throws ConfigError with the holder's words when another has one of the stage's
    // controllers, and with the file and the cause when it cannot be locked: nothing moves then.
    StationLock(const StationStage& stage, const std::string& holder);
    ~StationLock();
    StationLock(const StationLock&) = delete;
    StationLock& operator=(const StationLock&) = delete;

private:
    std::vector<int> descriptors_;
};

// "a qualification by Anna since 14:05 UTC, process 4711"; without a name that of the user.
std::string stage_holder(const std::string& what, const std::string& who);

}  // namespace etalon
