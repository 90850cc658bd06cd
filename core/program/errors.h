// The errors that a caller cannot simply go on from, each in one line for a user: where, and what
// was expected. Not for measurements: a camera out of limits is a value with a verdict.
#pragma once

#include <filesystem>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>
#include <variant>

namespace etalon {

// Text of others (names, file names, devices) on one line, as it is printed: control characters of
// Unicode, line separators and what turns the direction of text become "\n", "\t" or "\x1b", but
// for those in `kept`. All else stays, also what is not UTF-8.
std::string printable(std::string_view text, std::string_view kept = {});

// Base of all errors thrown on purpose by this project. The message is printable.
class Error : public std::runtime_error {
public:
    explicit Error(const std::string& message) : std::runtime_error(printable(message)) {}
};

// The place of a value in a file, or an argument on the command line.
struct SourcePlace {
    std::string file;  // path as the user gave it, or the option's name ("--pose")
    int line = 0;      // 1-based; 0 where the format has no lines
    std::string key;   // dotted path of the value ("plan.volume.x"); empty for the whole file
};

// An input that cannot be used: a file, a key, an argument. Exit code 3. "file:line: key: message".
class ConfigError : public Error {
public:
    ConfigError(SourcePlace place, const std::string& message);

    const SourcePlace& place() const { return place_; }

private:
    SourcePlace place_;
};

// A file that its disk does not take: full, failing or only for reading. Exit code 4.
class DiskError : public ConfigError {
public:
    using ConfigError::ConfigError;
};

// DiskError where the disk is the cause, otherwise ConfigError.
[[noreturn]] void fail_writing(const std::filesystem::path& path, std::error_code cause);

// A device that did not do what was asked of it. Exit code 4.
// what() reads "device: request: cause".
class DeviceError : public Error {
public:
    DeviceError(std::string device, std::string request, std::string cause);

    const std::string& device() const { return device_; }    // "stage 127.0.0.1:1502"
    const std::string& request() const { return request_; }  // "read registers 0..13"
    const std::string& cause() const { return cause_; }      // "timed out after 300 ms"

private:
    std::string device_, request_, cause_;
};

// A computation without a trustworthy result (rank lost, no convergence, not finite); the message
// holds the values that tell why. Exit code 4.
class NumericalError : public Error {
public:
    using Error::Error;
};

// A value, or the cause why there is none.
template <class T>
struct Result {
    std::optional<T> value;
    std::string cause;

    explicit operator bool() const { return value.has_value(); }
    T& operator*() { return *value; }
    T* operator->() { return &*value; }
};

// What a computation returns, or why it has no trustworthy result (one photograph of many, one
// model of several); of one that returns nothing, whether it went well.
template <class Computation>
auto attempted(Computation&& computation) {
    using Value = std::invoke_result_t<Computation>;
    using Kept = std::conditional_t<std::is_void_v<Value>, std::monostate, Value>;
    try {
        if constexpr (std::is_void_v<Value>) {
            std::forward<Computation>(computation)();
            return Result<Kept>{std::monostate{}, {}};
        } else {
            return Result<Kept>{std::forward<Computation>(computation)(), {}};
        }
    } catch (const NumericalError& error) {
        return Result<Kept>{std::nullopt, error.what()};
    }
}

// The run was stopped on request (a signal). Exit code 130.
class Interrupted : public Error {
public:
    Interrupted() : Error("interrupted") {}
};

// For loops that may take long.
inline void throw_if_stopped(const std::stop_token& stop) {
    if (stop.stop_requested())
        throw Interrupted();
}

// What a program of this project ends with.

struct ExitCode {
    static constexpr int done = 0, pass = 0;
    static constexpr int fail = 1;
    static constexpr int inconclusive = 2;
    static constexpr int usage_error = 3;  // or an input that cannot be used
    static constexpr int run_error = 4;    // a device, or anything that no input explains
    static constexpr int interrupted = 130;
};

}  // namespace etalon
