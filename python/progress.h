// How far a run is, where its caller wants to see it.
#pragma once

#include <cstdio>
#include <memory>

#include "core/time/progress.h"

namespace etalon {

// To stderr, or to nobody.
class RunProgress {
public:
    explicit RunProgress(bool is_shown)
        : nobody_(is_shown ? nullptr : std::fopen("/dev/null", "w")),
          progress_(nobody_ ? nobody_.get() : stderr, false, clock_) {}

    Clock& clock() { return clock_; }
    Progress& progress() { return progress_; }

private:
    struct Close {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    SteadyClock clock_;
    std::unique_ptr<std::FILE, Close> nobody_;
    Progress progress_;
};

}  // namespace etalon
