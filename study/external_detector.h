// A detector that is a program: docs/study.md, "Programs of your own". A crash, a wrong answer or
// silence beyond the time-out counts as no detection, with the reason in words. The program and all
// that it started are then ended, and it is started again for the next image.
#pragma once

#include <filesystem>
#include <memory>

#include "core/geometry/rigid.h"
#include "core/process/subprocess.h"

namespace etalon {

struct ExternalAnswer {
    std::optional<Rigid> camera_from_marker;
    std::string failure;  // why there is none
};

// What a line of its output says; nothing when the line is no answer.
std::optional<ExternalAnswer> external_answer(const std::string& line);

// Not thread-safe: one per thread.
class ExternalDetector {
public:
    // The program (found as a shell does) and its arguments. Throws ConfigError at `place`.
    ExternalDetector(std::vector<std::string> command, std::chrono::milliseconds time_out,
                     const std::string& place);
    ~ExternalDetector();
    ExternalDetector(const ExternalDetector&) = delete;
    ExternalDetector& operator=(const ExternalDetector&) = delete;

    // Throws ConfigError for a path with a tab or a line break: no line can tell it.
    ExternalAnswer detect(const std::filesystem::path& image, const std::filesystem::path& camera);

private:
    void start();         // throws std::system_error
    std::string ended();  // how it ended by itself, in words
    ExternalAnswer receive(Instant deadline);
    ExternalAnswer failed(const std::string& why);

    std::vector<std::string> command_;
    std::chrono::milliseconds time_out_;
    std::unique_ptr<Subprocess> process_;
};

}  // namespace etalon
