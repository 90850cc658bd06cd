// What every fuzz target here does with an input: it is read as a value whose numbers are all
// finite, or refused by an error of ours that says why. Anything else ends the program, which
// libFuzzer reports with the input that did it.
#pragma once

#include <sys/time.h>

#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <span>
#include <string_view>

#include "core/program/errors.h"
#include "tests/temporary_folder.h"

namespace etalon::test {

[[noreturn]] inline void violation(const std::string& what) {
    std::fprintf(stderr, "VIOLATION: %s\n", what.c_str());
    std::abort();
}

inline void require(bool holds, const char* what) {
    if (!holds)
        violation(what);
}

inline void require_finite(double value) {
    require(std::isfinite(value), "a number that is not finite was accepted");
}

template <class Numbers>
void require_all_finite(const Numbers& numbers) {
    for (const double value : numbers)
        require_finite(value);
}

// A read may take 20 s of the processor, instrumented as it is. Its time by the clock says nothing:
// other programs may have the processor. A read that waits for ever is found by libFuzzer's
// -timeout.
class ProcessorLimit {
public:
    ProcessorLimit() {
        std::signal(SIGPROF, [](int) { std::abort(); });
        set(20);
    }
    ~ProcessorLimit() { set(0); }
    ProcessorLimit(const ProcessorLimit&) = delete;
    ProcessorLimit& operator=(const ProcessorLimit&) = delete;

private:
    static void set(long seconds) {
        const itimerval limit{{0, 0}, {seconds, 0}};
        setitimer(ITIMER_PROF, &limit, nullptr);
    }
};

// Reads, and takes a refusal for an answer.
template <class Read>
void read_or_refuse(const Read& read) {
    const ProcessorLimit limit;
    try {
        read();
    } catch (const Error& error) {
        require(std::string_view(error.what()).size() > 10, "an error that says nothing");
    } catch (const std::exception& error) {
        violation(std::string("not an error of ours: ") + error.what());
    }
}

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
    return {reinterpret_cast<const char*>(data), size};
}

// The folder of this program's input files; scripts/fuzz.sh removes what is left of it.
inline const std::filesystem::path& input_folder() {
    static const TemporaryFolder folder;
    return folder.path();
}

inline std::filesystem::path write_input(const std::filesystem::path& name, std::string_view text) {
    const std::filesystem::path path = input_folder() / name;
    std::ofstream(path, std::ios::binary) << text;
    return path;
}

// Copied once, for inputs that name it.
inline void provide(const std::filesystem::path& source, const std::filesystem::path& name) {
    std::filesystem::create_directories((input_folder() / name).parent_path());
    std::filesystem::copy_file(source, input_folder() / name,
                               std::filesystem::copy_options::overwrite_existing);
}

// The source folder: the programs run in it (scripts/fuzz.sh).
inline std::filesystem::path examples() {
    return std::filesystem::current_path() / "examples";
}

}  // namespace etalon::test
