// The built program, run in a folder of its own, and commands in this process: what they printed
// and how they ended.
#pragma once

#include <sys/wait.h>

#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {

struct Finished {
    int exit_code = -1;
    std::string out, err;
};

inline Finished etalon_with(const TemporaryFolder& folder, const std::string& arguments) {
    const std::string command =
        fmt::format("cd '{}' && '{}' {} > out.txt 2> err.txt", (folder / "").string(),
                    built_program("etalon"), arguments);
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_text(folder / "out.txt"),
            read_text(folder / "err.txt")};
}

// Of a command in this process, which returns its exit code or throws.
template <class Command>
Finished finished(Command command) {
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    Finished result;
    const auto end = [&] {
        std::fflush(stdout);
        result.out = testing::internal::GetCapturedStdout();
        result.err = testing::internal::GetCapturedStderr();
    };
    try {
        result.exit_code = command();
    } catch (...) {
        end();
        throw;
    }
    end();
    return result;
}

inline void expect_one_line_error(const Finished& finished, int exit_code,
                                  const std::string& message) {
    EXPECT_EQ(finished.exit_code, exit_code) << finished.err;
    EXPECT_THAT(finished.err, StartsWith("etalon: "));
    EXPECT_THAT(finished.err, HasSubstr(message));
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_EQ(finished.out, "");
}

}  // namespace etalon
