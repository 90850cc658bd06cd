#include "core/time/clock.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>

#include "core/file/text.h"

namespace etalon {

Duration duration_of(double seconds) {
    constexpr double most_s = 1e9;
    const double within = std::isnan(seconds) ? 0.0 : std::clamp(seconds, -most_s, most_s);
    return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(within));
}

Instant SteadyClock::now() const {
    return std::chrono::steady_clock::now();
}

bool SteadyClock::wait_until(Instant until, std::stop_token stop) {
    std::mutex mutex;
    std::condition_variable_any woken;
    std::unique_lock lock(mutex);
    woken.wait_until(lock, stop, until, [] { return false; });
    return now() >= until;
}

Instant VirtualClock::now() const {
    const std::scoped_lock lock(mutex_);
    return now_;
}

bool VirtualClock::wait_until(Instant until, std::stop_token stop) {
    if (stop.stop_requested())
        return false;
    const std::scoped_lock lock(mutex_);
    now_ = std::max(now_, until);
    return true;
}

void VirtualClock::advance(Duration duration) {
    const std::scoped_lock lock(mutex_);
    now_ += duration;
}

namespace {

// The number that digits make; nothing for a sign or a space among them.
std::optional<int> digits(std::string_view text) {
    if (text.find_first_not_of("0123456789") != std::string_view::npos)
        return std::nullopt;
    return static_cast<int>(parse_integer(text).value());
}

}  // namespace

std::optional<long> days_of_date(std::string_view date) {
    if (date.size() != 10 || date[4] != '-' || date[7] != '-')
        return std::nullopt;
    const auto year = digits(date.substr(0, 4)), month = digits(date.substr(5, 2)),
               day = digits(date.substr(8, 2));
    if (!year || !month || !day)
        return std::nullopt;
    const std::chrono::year_month_day found(std::chrono::year(*year),
                                            std::chrono::month(static_cast<unsigned>(*month)),
                                            std::chrono::day(static_cast<unsigned>(*day)));
    if (!found.ok())
        return std::nullopt;
    return std::chrono::sys_days(found).time_since_epoch().count();
}

std::string date_of_days(long days) {
    const std::chrono::year_month_day date(
        std::chrono::sys_days(std::chrono::days(static_cast<int>(days))));
    return fmt::format("{:04}-{:02}-{:02}", static_cast<int>(date.year()),
                       static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()));
}

namespace {

double clock_ms(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

}  // namespace

double thread_cpu_ms() {
    return clock_ms(CLOCK_THREAD_CPUTIME_ID);
}

double process_cpu_ms() {
    return clock_ms(CLOCK_PROCESS_CPUTIME_ID);
}

double peak_memory_mib() {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
        if (double kib = 0.0; word == "VmHWM:" && status >> kib)
            return kib / 1024.0;
    return 0.0;
}

}  // namespace etalon
