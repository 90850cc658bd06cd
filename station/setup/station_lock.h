// One program moves a stage at a time: an advisory lock for each stage, held while a run or a
// motion goes on, with the name of who holds it. The kernel lets it go when its holder dies,
// however it dies. Looking and stopping need none.
//
// It is a file in /run/lock (else in the folder of temporary files), named after the stage's
// address and the network that this is an address in: it holds on one machine, for all of its
// users. It does not keep anybody off who does not ask for it.
#pragma once

#include <string>

#include "stage/link/stage_link.h"

namespace etalon {

class StationLock {
public:
    // Does not wait. Throws ConfigError with the holder's words when another has it. Where no such
    // file can be made nothing is locked: a stage that works must not need a folder.
    StationLock(const StageLink& stage, const std::string& holder);
    ~StationLock();
    StationLock(const StationLock&) = delete;
    StationLock& operator=(const StationLock&) = delete;

private:
    int descriptor_;
};

// "a qualification by Anna since 14:05 UTC, process 4711"; without a name that of the user.
std::string stage_holder(const std::string& what, const std::string& who);

}  // namespace etalon
