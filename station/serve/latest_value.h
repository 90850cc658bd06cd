// The newest of something that changes while many look on: whoever is slow misses what lay between
// and holds nobody up. One value is kept, however many readers there are.
#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>

namespace etalon {

template <class Value>
class LatestValue {
public:
    struct Seen {
        long number = 0;  // counts the values, from 1
        std::shared_ptr<const Value> value;
    };

    void put(Value value) {
        auto shared = std::make_shared<const Value>(std::move(value));
        {
            const std::lock_guard lock(mutex_);
            newest_ = {newest_.number + 1, std::move(shared)};
        }
        changed_.notify_all();
    }

    // The first value after number `seen` or a later one, waited for so long.
    std::optional<Seen> after(long seen, std::chrono::milliseconds at_most) const {
        std::unique_lock lock(mutex_);
        if (!changed_.wait_for(lock, at_most, [&] { return newest_.number > seen; }))
            return std::nullopt;
        return newest_;
    }

private:
    mutable std::mutex mutex_;
    mutable std::condition_variable changed_;
    Seen newest_;
};

}  // namespace etalon
