// What every test may use: GoogleTest, what an action's error says, files as bytes, a full disk.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <regex>
#include <set>
#include <thread>
#include <vector>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "tests/temporary_folder.h"

namespace etalon::test {}

namespace etalon {

using namespace std::chrono_literals;
using namespace test;  // what the tests' headers declare
using testing::AllOf;
using testing::Contains;
using testing::Each;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

// Runs `act`, which must fail with such an error, and returns its text.
template <class Expected, class Act>
std::string text_of_error(Act act) {
    try {
        act();
    } catch (const Expected& error) {
        return error.what();
    }
    return "no error";
}

template <class Act>
std::string device_error_of(Act act) {
    return text_of_error<DeviceError>(act);
}

template <class Act>
std::string config_error_of(Act act) {
    return text_of_error<ConfigError>(act);
}

// Each of the words is somewhere in the text.
template <class... Words>
auto HasSubstrs(const Words&... words) {
    return AllOf(HasSubstr(words)...);
}

// The text with one part of it replaced, which must be there.
inline std::string replaced(std::string text, const std::string& what, const std::string& by) {
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

inline bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

inline void expect_80_columns(const std::string& text) {
    for (const std::string& line : split(text, '\n'))
        EXPECT_LE(line.size(), 80u) << line;
}

// What every page that the program writes must be, as far as no browser is needed: every figure's
// caption is a sentence or more; an outcome stands beside the name of what it is about; nothing is
// loaded from outside.
inline void expect_readable_page(const std::string& page) {
    EXPECT_THAT(page, Not(testing::ContainsRegex("(src|href)=\"?https?:")));
    const auto all = [&](const std::string& pattern) {
        const std::regex expression(pattern);
        return std::vector<std::smatch>(std::sregex_iterator(page.begin(), page.end(), expression),
                                        {});
    };
    const auto captions = all("<figcaption>(?:<div.*?</div>)?([^<]*)</figcaption>");
    EXPECT_EQ(captions.size(), all("<figure").size());
    for (const std::smatch& caption : captions)
        EXPECT_THAT(caption.str(1), testing::MatchesRegex(".+ .+\\.")) << "as a caption";
    EXPECT_THAT(page, Not(testing::ContainsRegex("</th><th[^>]*>[^<]*</th><th>outcome<")));
}

// A whole file as it is: pictures and pages for print are no text.
inline std::string read_bytes(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file)
        throw std::runtime_error("cannot read " + path.string());
    return {std::istreambuf_iterator<char>(file), {}};
}

// A disk that takes no more than so many bytes of each file of this process, while it lives:
// writing further fails with EFBIG.
class FileSizeLimit {
public:
    explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
        getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit limit{bytes, before_.rlim_max};
        setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~FileSizeLimit() {
        setrlimit(RLIMIT_FSIZE, &before_);
        std::signal(SIGXFSZ, handler_);
    }
    FileSizeLimit(const FileSizeLimit&) = delete;
    FileSizeLimit& operator=(const FileSizeLimit&) = delete;

private:
    rlimit before_{};
    void (*handler_)(int);
};

}  // namespace etalon
