#include "station/record/qualify_result.h"

#include <fmt/format.h>

#include "core/errors.h"
#include "core/exit_codes.h"

namespace etalon {

const char* name(RunOutcome outcome) {
    switch (outcome) {
        case RunOutcome::pass:
            return "PASS";
        case RunOutcome::fail:
            return "FAIL";
        case RunOutcome::inconclusive:
            return "INCONCLUSIVE";
        case RunOutcome::error:
            return "ERROR";
        case RunOutcome::aborted:
            return "ABORTED";
    }
    return "ERROR";
}

int exit_code(RunOutcome outcome) {
    switch (outcome) {
        case RunOutcome::pass:
            return ExitCode::pass;
        case RunOutcome::fail:
            return ExitCode::fail;
        case RunOutcome::inconclusive:
            return ExitCode::inconclusive;
        case RunOutcome::error:
            return ExitCode::run_error;
        case RunOutcome::aborted:
            return ExitCode::interrupted;
    }
    return ExitCode::run_error;
}

CaptureStatistics total_counters(const std::vector<RunSession>& sessions) {
    CaptureStatistics total;
    for (const RunSession& session : sessions) {
        total.delivered += session.counters.delivered;
        total.rejected += session.counters.rejected;
        total.missing_packets += session.counters.missing_packets;
        total.resent_packets += session.counters.resent_packets;
        total.underruns += session.counters.underruns;
        total.skipped += session.counters.skipped;
        total.reconnects += session.counters.reconnects;
    }
    return total;
}

std::optional<double> mean_residual_gray(const QualifyResult& result) {
    double sum = 0.0;
    int count = 0;
    for (const PoseRecord& pose : result.poses) {
        if (!pose.residual)
            continue;
        sum += pose.residual->scored.rms_gray;
        ++count;
    }
    if (count == 0)
        return std::nullopt;
    return sum / count;
}

CodeImage recorded_photo(const QualifyResult& result, const PoseRecord& pose) {
    const auto whole = std::find_if(pose.frames.begin(), pose.frames.end(),
                                    [](const FrameRecord& frame) { return !frame.file.empty(); });
    if (whole == pose.frames.end())
        throw ConfigError({result.folder.string()},
                          fmt::format("pose {} has no whole photograph", pose.index));
    CodeImage photo = read_image(result.folder / whole->file);
    photo.bits = result.settings.bits;
    return photo;
}

}  // namespace etalon
