// Time as the station knows it: one monotonic clock, handed to whatever waits, so that tests run
// on virtual time and never sleep.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>

namespace etalon {

using Instant = std::chrono::steady_clock::time_point;
using Duration = std::chrono::steady_clock::duration;

// 32 years at most in either direction, so that sums of a few never overflow; NaN is 0.
Duration duration_of(double seconds);

class Clock {
public:
    virtual ~Clock() = default;

    virtual Instant now() const = 0;

    // Returns at `until`, or at once when a stop is requested. True if the time was reached.
    virtual bool wait_until(Instant until, std::stop_token stop) = 0;

    bool wait_for(Duration duration, std::stop_token stop) {
        return wait_until(now() + duration, std::move(stop));
    }
};

// The machine's monotonic clock. Safe from every thread.
class SteadyClock final : public Clock {
public:
    Instant now() const override;
    bool wait_until(Instant until, std::stop_token stop) override;
};

// Stands still at zero until somebody waits, or advance(). Every thread; meant for tests with one.
class VirtualClock final : public Clock {
public:
    Instant now() const override;
    bool wait_until(Instant until, std::stop_token stop) override;
    void advance(Duration duration);

private:
    mutable std::mutex mutex_;
    Instant now_{};
};

// Days of the calendar as files give them: "2026-03-07" (ISO 8601). As text they sort by time.

// Days since 1970-01-01; nothing for what is no day, as 2026-02-30.
std::optional<long> days_of_date(std::string_view date);

// The inverse, for days of the years 0 to 9999.
std::string date_of_days(long days);

// CPU time and memory of this process. Linux.

double thread_cpu_ms();   // of the calling thread
double process_cpu_ms();  // of all threads

// Largest resident memory so far, MiB (VmHWM).
double peak_memory_mib();

}  // namespace etalon
