#include "mocks/camera/darkroom.h"

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

Darkroom::Darkroom(Develop develop, std::vector<double> positions)
    : develop_(std::move(develop)),
      shown_positions_(std::move(positions)),
      shown_(develop_(shown_positions_)),
      thread_([this](std::stop_token stop) { work(std::move(stop)); }) {}

Darkroom::~Darkroom() = default;

bool Darkroom::shows(const std::vector<double>& positions) {
    const std::lock_guard lock(mutex_);
    if (same_place(positions, shown_positions_))
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
        if (same_place(positions, shown_positions_))
            continue;  // wished for again while it was in work
        lock.unlock();
        Radiance picture = develop_(positions);
        lock.lock();
        shown_ = std::move(picture);
        shown_positions_ = positions;
    }
}

}  // namespace etalon
