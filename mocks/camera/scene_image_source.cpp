#include "mocks/camera/scene_image_source.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace etalon {
namespace {

// A picture cannot tell 10 nm or 10 urad; a stage that drifts is never in the same place twice.
bool same_place(const std::vector<double>& a, const std::vector<double>& b) {
    return std::ranges::equal(a, b, [](double p, double q) { return std::abs(p - q) <= 1e-5; });
}

}  // namespace

SceneImageSource::SceneImageSource(Render render, std::vector<double> positions)
    : render_(std::move(render)),
      shown_positions_(std::move(positions)),
      shown_(render_(shown_positions_)),
      thread_([this](std::stop_token stop) { work(std::move(stop)); }) {}

SceneImageSource::~SceneImageSource() = default;

bool SceneImageSource::shows(const std::vector<double>& positions) {
    const std::lock_guard lock(mutex_);
    if (same_place(positions, shown_positions_))
        return true;
    wish_ = positions;
    wished_.notify_one();
    return false;
}

Radiance SceneImageSource::picture() const {
    const std::lock_guard lock(mutex_);
    return shown_;
}

void SceneImageSource::work(std::stop_token stop) {
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

}  // namespace etalon
