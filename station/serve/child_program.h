// One command of `etalon` as a process of its own: the page drives what the command line drives,
// and whatever becomes of a device's library in it, the page goes on and can stop it.
//
// It is asked to end (SIGTERM) when the process that started it dies, however that dies, and so
// stops its axes.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace etalon {

struct EndedProgram {
    int exit_code = -1;      // -1: a signal ended it
    std::string output;      // of stdout, the first megabyte
    std::string last_words;  // of stderr, its last lines
};

class ChildProgram {
public:
    // Starts this very program with these arguments. `said` is called with every line of stderr
    // and `ended` once, both on a thread of its own. Throws std::system_error when it cannot be
    // started.
    ChildProgram(const std::vector<std::string>& arguments,
                 std::function<void(const std::string& line)> said,
                 std::function<void(const EndedProgram&)> ended);
    // Asks it to end, kills it after 10 s, and waits.
    ~ChildProgram();
    ChildProgram(const ChildProgram&) = delete;
    ChildProgram& operator=(const ChildProgram&) = delete;

    // False when it has ended before.
    bool send(int signal);

private:
    void follow(int output, int errors);
    EndedProgram read_all(int output, int errors);

    std::function<void(const std::string&)> said_;
    std::function<void(const EndedProgram&)> ended_;
    std::mutex mutex_;
    std::condition_variable over_;
    int process_ = 0;  // 0: it has ended
    std::thread thread_;
};

// Runs it to its end on the calling thread. One that cannot be started has ended with exit code -1.
EndedProgram run_program(const std::vector<std::string>& arguments);

}  // namespace etalon
