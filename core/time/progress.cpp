#include "core/time/progress.h"

#include <fmt/format.h>

namespace etalon {
namespace {

constexpr int trusted_steps = 3;  // after so many, measured time replaces the expected one
constexpr int bar_columns = 30;

}  // namespace

std::string duration_text(Duration duration) {
    const long long s = std::chrono::round<std::chrono::seconds>(duration).count();
    if (s < 60)
        return fmt::format("{} s", s);
    if (s < 3600)
        return fmt::format("{}:{:02} min", s / 60, s % 60);
    return fmt::format("{}:{:02} h", s / 3600, s % 3600 / 60);
}

std::string Progress::line(const std::string& phase, int done, int steps,
                           std::optional<Duration> left, bool with_bar) {
    const std::string count = fmt::format("{} of {}", done, steps);
    if (!with_bar)
        return fmt::format("{}: {}{}", phase, count,
                           left ? fmt::format(", {} left", duration_text(*left)) : "");
    const int full = static_cast<int>(static_cast<long long>(bar_columns) * done / steps);
    const std::string bar = std::string(static_cast<std::size_t>(full), '#') +
                            std::string(static_cast<std::size_t>(bar_columns - full), '.');
    return fmt::format("{:<12.12} [{}] {:>14.14}{}", phase, bar, count,
                       left ? fmt::format("  {:>9} left", duration_text(*left)) : "");
}

void Progress::begin(const std::string& phase, int steps, std::optional<Duration> expected) {
    end();
    phase_ = phase;
    steps_ = std::max(steps, 1);
    done_ = 0;
    expected_ = expected;
    start_ = clock_.now();
    show();
}

void Progress::step() {
    if (phase_.empty() || done_ == steps_)
        return;
    ++done_;
    const bool passed_a_tenth = done_ * 10 / steps_ != (done_ - 1) * 10 / steps_;
    if (is_terminal_ || passed_a_tenth)
        show();
}

void Progress::end() {
    if (is_terminal_ && !phase_.empty())
        write("\n");
    phase_.clear();
}

void Progress::note(const std::string& text) {
    if (is_terminal_ && !phase_.empty())
        write(fmt::format("\r{:79}\r", ""));
    write(fmt::format("{}\n", text));
    if (is_terminal_ && !phase_.empty())
        show();
}

// Whoever watches may go away; that must not end a run.
void Progress::write(const std::string& text) {
    std::fputs(text.c_str(), out_);
    std::fflush(out_);
}

std::optional<Duration> Progress::time_left() const {
    const int rest = steps_ - done_;
    if (done_ < trusted_steps)
        return expected_ ? std::optional<Duration>(*expected_ * rest / steps_) : std::nullopt;
    return (clock_.now() - start_) * rest / done_;
}

void Progress::show() {
    const std::string text = line(phase_, done_, steps_, time_left(), is_terminal_);
    if (is_terminal_)
        write(fmt::format("\r{:<79}", text));
    else
        write(fmt::format("{}\n", text));
}

}  // namespace etalon
