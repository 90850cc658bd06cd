// Hands values from a library's own thread to the thread that owns a camera. push() and end() may
// be called from any thread, the others from the owner's alone.
#pragma once

#include <deque>

#include "core/program/errors.h"
#include "core/time/clock.h"

namespace etalon {

template <typename Value>
class HandoverQueue {
public:
    void push(Value value) {
        {
            const std::lock_guard lock(mutex_);
            values_.push_back(std::move(value));
        }
        arrived_.notify_one();
    }

    // Nothing more will come: whoever waits need not wait longer.
    void end() {
        {
            const std::lock_guard lock(mutex_);
            ended_ = true;
        }
        arrived_.notify_one();
    }

    // The oldest value, waited for at most so long; nothing if none came or none will come. Throws
    // Interrupted as soon as a stop is requested.
    std::optional<Value> pop(Duration at_most, const std::stop_token& stop) {
        std::unique_lock lock(mutex_);
        arrived_.wait_for(lock, stop, at_most, [&] { return ended_ || !values_.empty(); });
        throw_if_stopped(stop);
        if (values_.empty())
            return std::nullopt;
        Value oldest = std::move(values_.front());
        values_.pop_front();
        return oldest;
    }

    void clear() {
        const std::lock_guard lock(mutex_);
        values_.clear();
    }

private:
    std::mutex mutex_;
    std::condition_variable_any arrived_;
    std::deque<Value> values_;
    bool ended_ = false;
};

}  // namespace etalon
