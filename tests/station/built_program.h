// The built program, run in a folder of its own: what it printed and how it ended.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>

#include "core/file/text.h"
#include "tests/paths.h"
#include "tests/temporary_folder.h"

namespace etalon {

struct Finished {
    int exit_code = -1;
    std::string out, err;
};

inline Finished etalon_with(const TemporaryFolder& folder, const std::string& arguments) {
    const std::string command = fmt::format("cd '{}' && '{}/etalon' {} > out.txt 2> err.txt",
                                            (folder / "").string(), ETALON_BINARY_DIR, arguments);
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_text(folder / "out.txt"),
            read_text(folder / "err.txt")};
}

inline void expect_one_line_error(const Finished& finished, int exit_code,
                                  const std::string& message) {
    EXPECT_EQ(finished.exit_code, exit_code) << finished.err;
    EXPECT_THAT(finished.err, testing::StartsWith("etalon: "));
    EXPECT_THAT(finished.err, testing::HasSubstr(message));
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    EXPECT_EQ(finished.out, "");
}

}  // namespace etalon
