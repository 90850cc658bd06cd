// How far a run is and how long it will take, for whoever watches.
#pragma once

#include <cstdio>
#include <optional>

#include "core/time/clock.h"

namespace etalon {

// On a terminal one line of at most 79 columns that is drawn again and again; otherwise a plain
// line at the beginning of a phase and after each tenth of it. Used from one thread.
class Progress {
public:
    Progress(std::FILE* out, bool is_terminal, const Clock& clock)
        : out_(out), is_terminal_(is_terminal), clock_(clock) {}
    ~Progress() { end(); }
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    // A phase of `steps` > 0 equal steps; ends the one before. `expected` is what it is known to
    // take: used until the first steps have shown it. Without it no time left is told before.
    void begin(const std::string& phase, int steps, std::optional<Duration> expected = {});
    void step();  // beyond the last one: nothing
    void end();

    // A line of its own, without disturbing the drawn one.
    void note(const std::string& text);

    // The text after `done` of `steps` steps; for tests too.
    static std::string line(const std::string& phase, int done, int steps,
                            std::optional<Duration> left, bool with_bar);

private:
    std::optional<Duration> time_left() const;
    void show();
    void write(const std::string& text);

    std::FILE* out_;
    bool is_terminal_;
    const Clock& clock_;
    std::string phase_;
    int done_ = 0, steps_ = 0;
    Instant start_{};
    std::optional<Duration> expected_;
};

// "42 s", "3:07 min", "1:02 h"
std::string duration_text(Duration duration);

}  // namespace etalon
