// The twin as a child of a run: the simulated devices that it is for, and that end with it.
#pragma once

#include <sys/types.h>

#include <cstdio>
#include <string>
#include <vector>

namespace etalon {

// The program etalon-twin beside this one, from construction to destruction. It is in a process
// group of its own: Ctrl-C in a terminal is for the run, which must stop the axes before they go.
// Where this process is killed, the kernel ends the twin. Construct it before any thread is
// started: after fork() the child has but one, and the kernel watches the thread that forked.
class TwinProcess {
public:
    // Throws DeviceError where it cannot be started.
    explicit TwinProcess(const std::vector<std::string>& arguments);
    ~TwinProcess();
    TwinProcess(const TwinProcess&) = delete;
    TwinProcess& operator=(const TwinProcess&) = delete;

    // Waits for the line that it prints when both devices listen; empty when it has ended.
    std::string ready_line();

    // How it ended; waits for it.
    int exit_code();

private:
    pid_t id_ = -1;
    FILE* said_ = nullptr;  // its stdout
};

}  // namespace etalon
