// Renders the pictures that the twin's camera shows, on a thread of its own: the stage's and the
// camera's threads answer their protocols meanwhile and only ever look at finished pictures.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <thread>
#include <vector>

#include "core/image/image.h"

namespace etalon {

class SceneImageSource {
public:
    // The picture at the given axis positions. Called on a thread of its own; must not throw.
    using Render = std::function<Radiance(const std::vector<double>& positions)>;

    // Renders the first picture before it returns. The end waits for the picture in work.
    SceneImageSource(Render render, std::vector<double> positions)
        : render_(std::move(render)),
          shown_positions_(std::move(positions)),
          shown_(render_(shown_positions_)),
          thread_([this](std::stop_token stop) { work(std::move(stop)); }) {}

    // Whether the picture on show is of these positions, within 10 nm or 10 urad. If not, it will
    // be the next one; a newer wish replaces one that is not in work yet. At once; every thread.
    bool shows(const std::vector<double>& positions) {
        const std::lock_guard lock(mutex_);
        if (same_place(positions, shown_positions_))
            return true;
        wish_ = positions;
        wished_.notify_one();
        return false;
    }

    // The last finished picture. Its pixels are shared: do not write them. Every thread.
    Radiance picture() const {
        const std::lock_guard lock(mutex_);
        return shown_;
    }

private:
    // A picture cannot tell 10 nm or 10 urad; a stage that drifts is never in the same place twice.
    static bool same_place(const std::vector<double>& a, const std::vector<double>& b) {
        return std::ranges::equal(a, b, [](double p, double q) { return std::abs(p - q) <= 1e-5; });
    }

    void work(std::stop_token stop) {
        std::unique_lock lock(mutex_);
        while (wished_.wait(lock, stop, [this] { return wish_.has_value(); })) {
            const std::vector<double> positions = std::move(*wish_);
            wish_.reset();
            if (same_place(positions, shown_positions_))
                continue;  // wished for again while it was in work
            lock.unlock();
            Radiance picture = render_(positions);
            lock.lock();
            shown_ = std::move(picture);
            shown_positions_ = positions;
        }
    }

    Render render_;
    mutable std::mutex mutex_;
    std::condition_variable_any wished_;
    std::optional<std::vector<double>> wish_;
    std::vector<double> shown_positions_;
    Radiance shown_;
    std::jthread thread_;  // last: it uses all the others
};

}  // namespace etalon
