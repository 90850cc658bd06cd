#include "mocks/darkroom.h"

#include <utility>

namespace etalon {

Darkroom::Darkroom(Develop develop, std::vector<double> positions)
    : develop_(std::move(develop)),
      shown_positions_(std::move(positions)),
      shown_(develop_(shown_positions_)),
      thread_([this](std::stop_token stop) { work(std::move(stop)); }) {}

Darkroom::~Darkroom() = default;

bool Darkroom::shows(const std::vector<double>& positions) {
    const std::lock_guard lock(mutex_);
    if (positions == shown_positions_)
        return true;
    wish_ = positions;
    wished_.notify_one();
    return false;
}

Radiance Darkroom::picture() const {
    const std::lock_guard lock(mutex_);
    return shown_;
}

void Darkroom::work(std::stop_token stop) {
    std::unique_lock lock(mutex_);
    while (wished_.wait(lock, stop, [this] { return wish_.has_value(); })) {
        const std::vector<double> positions = std::move(*wish_);
        wish_.reset();
        if (positions == shown_positions_)
            continue;  // wished for again while it was in work
        lock.unlock();
        Radiance picture = develop_(positions);
        lock.lock();
        shown_ = std::move(picture);
        shown_positions_ = positions;
    }
}

}  // namespace etalon
