// What a program of this project ends with.
#pragma once

namespace etalon {

struct ExitCode {
    static constexpr int done = 0, pass = 0;
    static constexpr int fail = 1;
    static constexpr int inconclusive = 2;
    static constexpr int usage_error = 3;  // or an input that cannot be used
    static constexpr int run_error = 4;    // a device, or anything that no input explains
    static constexpr int interrupted = 130;
};

}  // namespace etalon
