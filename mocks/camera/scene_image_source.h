// Renders the pictures that the twin's camera shows, on a thread of its own: the stage's and the
// camera's threads answer their protocols meanwhile and only ever look at finished pictures.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <vector>

#include "core/image/image.h"

namespace etalon {

class SceneImageSource {
public:
    // The picture at the given axis positions. Called on a thread of its own; must not throw.
    using Render = std::function<Radiance(const std::vector<double>& positions)>;

    // Renders the first picture before it returns.
    SceneImageSource(Render render, std::vector<double> positions);
    ~SceneImageSource();  // waits for the picture in work

    // Whether the picture on show is the one of these positions, within 10 nm or 10 urad; if not,
    // it will be the next one (a newer wish replaces one that is not in work yet). Returns at once.
    // Safe from every thread.
    bool shows(const std::vector<double>& positions);

    // The last finished picture; its pixels are shared and must not be written. Safe from every
    // thread.
    Radiance picture() const;

private:
    void work(std::stop_token stop);

    Render render_;
    mutable std::mutex mutex_;
    std::condition_variable_any wished_;
    std::optional<std::vector<double>> wish_;
    std::vector<double> shown_positions_;
    Radiance shown_;
    std::jthread thread_;  // last: it uses all the others
};

}  // namespace etalon
