#include "study/external_detector.h"

#include <fmt/format.h>

#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t max_answer = 65536;  // bytes

std::optional<Rigid> pose_in(const nlohmann::json& numbers) {
    if (!numbers.is_array() || numbers.size() != 6)
        return std::nullopt;
    Vector6d pose;
    for (std::size_t i = 0; i < 6; ++i) {
        if (!numbers[i].is_number())
            return std::nullopt;
        pose[static_cast<Eigen::Index>(i)] = numbers[i].get<double>();
    }
    if (!pose.allFinite())
        return std::nullopt;
    return rigid_from_vector(pose);
}

}  // namespace

std::optional<ExternalAnswer> external_answer(const std::string& line) {
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object())
        return std::nullopt;
    if (const auto pose = json.find("camera_from_marker"); pose != json.end()) {
        const auto rigid = pose_in(*pose);
        return rigid ? std::optional(ExternalAnswer{rigid, ""}) : std::nullopt;
    }
    const auto failure = json.find("failure");
    if (failure == json.end() || !failure->is_string())
        return std::nullopt;
    return ExternalAnswer{std::nullopt, printable(failure->get<std::string>())};
}

ExternalDetector::ExternalDetector(std::vector<std::string> command, milliseconds time_out,
                                   const std::string& place)
    : command_(std::move(command)), time_out_(time_out) {
    if (command_.empty() || command_[0].empty())
        throw ConfigError({place}, "no program is named");
    try {
        start();
    } catch (const std::system_error& error) {
        throw ConfigError(
            {place}, fmt::format("{} cannot be started: {}", command_[0], error.code().message()));
    }
}

ExternalDetector::~ExternalDetector() {
    constexpr milliseconds patience(500);
    if (!process_)
        return;
    process_->close_input();
    process_->wait_for(patience);
    process_->send(SIGKILL);
}

void ExternalDetector::start() {
    SubprocessOptions options;
    options.has_input = options.inherits_stderr = true;
    process_ = std::make_unique<Subprocess>(command_, std::move(options));
}

std::string ExternalDetector::ended() {
    constexpr milliseconds patience(200);
    if (!process_->wait_for(patience))
        return "the program has closed its output";
    const SubprocessResult result = process_->result();
    if (result.signal == 0)
        return fmt::format("the program ended with exit code {}", result.exit_code);
    return fmt::format("the program was ended by signal {} ({})", result.signal,
                       strsignal(result.signal));
}

// It is ended at once, whatever it is doing, with all that it started.
ExternalAnswer ExternalDetector::failed(const std::string& why) {
    process_->send(SIGKILL);
    process_.reset();
    return {std::nullopt, why};
}

ExternalAnswer ExternalDetector::receive(Instant deadline) {
    std::string line;
    while (line.find('\n') == std::string::npos) {
        if (line.size() > max_answer)
            return failed(fmt::format("the answer is longer than {} bytes", max_answer));
        const std::string part =
            process_->read_output(std::max(deadline - SteadyClock().now(), Duration::zero()));
        if (part.empty())
            return failed(process_->has_closed_output()
                              ? ended()
                              : fmt::format("no answer within {} ms", time_out_.count()));
        line += part;
    }
    if (line.find('\n') + 1 != line.size())
        return failed("the answer is more than one line");
    const auto answer = external_answer(line);
    return answer ? *answer : failed("the answer is neither a pose nor a failure");
}

ExternalAnswer ExternalDetector::detect(const std::filesystem::path& image,
                                        const std::filesystem::path& camera) {
    const std::string line = image.string() + "\t" + camera.string() + "\n";
    if (line.find_first_of("\t\n") != image.string().size() ||
        line.find_first_of("\t\n", image.string().size() + 1) != line.size() - 1)
        throw ConfigError({image.string()}, "a path with a tab or a line break has no line");
    // The next line of one that has said more would not belong to this image.
    if (process_ && (!process_->read_output({}).empty() || process_->has_closed_output()))
        failed("");
    try {
        if (!process_)
            start();
    } catch (const std::system_error& error) {
        return {std::nullopt,
                fmt::format("the program cannot be started: {}", error.code().message())};
    }
    const Instant deadline = SteadyClock().now() + time_out_;
    const std::error_code error = process_->write(line, time_out_);
    if (error == std::errc::timed_out)
        return failed(
            fmt::format("the program did not read its input within {} ms", time_out_.count()));
    return error ? failed(ended()) : receive(deadline);
}

}  // namespace etalon
