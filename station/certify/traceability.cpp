#include "station/certify/traceability.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/time/clock.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

using Missing = std::vector<std::string>;

void add_of_run(Missing& missing, const QualifyResult& run) {
    if (run.outcome == RunOutcome::error || run.outcome == RunOutcome::aborted)
        missing.push_back(fmt::format("a verdict: the run ended with {}, {}", name(run.outcome),
                                      run.reason.empty() ? "no reason said" : run.reason));
    else if (!run.analysis ||
             std::ranges::none_of(run.analysis->quantities, &JudgedQuantity::measured))
        missing.emplace_back("a measured value: nothing was measured");
    if (run.camera.serial.empty())
        missing.emplace_back("the camera's serial number: the device tells none");
    for (const RunSession& session : run.sessions)
        if (session.operator_name.empty())
            missing.push_back(
                fmt::format("the operator of the session of {} (--operator)", session.started_utc));
}

void add_reference(Missing& missing, const QualifyResult& run, const std::string& reference,
                   const std::string& key) {
    const TracedReference* found = reference_named(run.station.references, reference);
    if (!found) {
        missing.push_back(
            fmt::format("references.{} in station.yaml: {} is not traced", key, reference));
        return;
    }
    const RunDays days = days_of(run);
    for (const std::string& day : {days.first, days.last})
        if (!found->in_force_on(day)) {
            missing.push_back(fmt::format(
                "a valid certificate of {}: {} is of {} and was due {}, the run is of {}",
                reference, found->certificate, found->date, found->due, day));
            return;
        }
}

void add_references(Missing& missing, const QualifyResult& run) {
    for (const Axis& axis : run.station.stage.axes)
        add_reference(missing, run, "stage scale " + axis.name, "stage_scale." + axis.name);
    add_reference(missing, run, "marker print size", "marker_size");
    add_reference(missing, run, "marker flatness", "marker_flatness");
    add_reference(missing, run, "thermometer", "thermometer");
}

void add_environment(Missing& missing, const QualifyResult& run) {
    if (!run.station.environment)
        missing.emplace_back("environment in station.yaml: the temperature was not measured");
    else if (!run.environment.lost.empty())
        missing.push_back("the temperature during the whole run: " + run.environment.lost);
    else if (!room_temperature(run.station, run.environment))
        missing.emplace_back("the temperature: fewer than two readings of the room's sensor");
}

void add_budget(Missing& missing, const QualifyResult& run) {
    if (!run.analysis)
        return;
    for (const BudgetRow& row : run.analysis->budget)
        if (row.counted && !row.standard_uncertainty)
            missing.push_back(fmt::format("the uncertainty of {}: it is unknown", row.source));
}

}  // namespace

RunDays days_of(const QualifyResult& run) {
    constexpr double day_s = 86400.0;
    const double start_s = utc_seconds(run.started_utc).value_or(0.0);
    const auto day = [](double seconds) {
        return date_of_days(static_cast<long>(std::floor(seconds / day_s)));
    };
    return {day(start_s), day(start_s + run.duration_s)};
}

std::vector<std::string> missing_for_certificate(const QualifyResult& run,
                                                 const CertificateForm& form) {
    Missing missing;
    add_of_run(missing, run);
    add_references(missing, run);
    add_environment(missing, run);
    add_budget(missing, run);
    for (const std::string& key : missing_keys(form))
        missing.push_back(fmt::format("{} in the certificate's file", key));
    return missing;
}

}  // namespace etalon
