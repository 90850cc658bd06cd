#include "station/foresee/operating_characteristic.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

using Signatures = std::vector<ErrorSignature>;

// ------------------------------------------------------------------------------ the size of 1x

// The judged quantities of an analysis that got as far as judging them.
std::vector<JudgedQuantity> judged(const Qualification& result) {
    std::vector<JudgedQuantity> quantities;
    for (const JudgedQuantity& quantity : result.quantities)
        if (quantity.outcome != Outcome::skipped)
            quantities.push_back(quantity);
    return quantities;
}

// What all runs have in common.
struct Known {
    Signatures signatures;
    NoiseDraws draws;
};

// What has a limit, and nothing else: that is what takes no longer than it must.
Qualification judgement(QualificationInput input, const Known& known) {
    input.known_signatures = &known.signatures;
    input.known_draws = &known.draws;
    input.measure_reported = false;
    return qualify(input);
}

class LimitSearch {
public:
    LimitSearch(const RunSimulator& simulator, const Known& known, const InjectedError& error)
        : simulator_(simulator), known_(known), error_(error) {}

    // The size whose exact field has the value `limit`; values grow nearly in proportion to the
    // size. Nothing when that does not settle, or the field cannot be had at such a size.
    std::optional<double> size_at(const std::string& quantity, double limit, double start) const {
        constexpr int max_steps = 20;
        constexpr double close = 1e-3, max_step = 4.0;
        double size = start;
        for (int step = 0; step < max_steps; ++step) {
            const std::optional<double> value = value_at(quantity, size);
            if (!value || !(*value > 0.0))
                return std::nullopt;
            const double ratio = limit / *value;
            if (std::abs(ratio - 1.0) < close)
                return size;
            size *= std::clamp(ratio, 1.0 / max_step, max_step);
        }
        return std::nullopt;
    }

private:
    std::optional<double> value_at(const std::string& name, double size) const {
        RunTruth truth = simulator_.as_told();
        error_.apply(truth, size);
        // Nothing where the error is so large that the marker leaves the image, say.
        auto qualified =
            attempted([&] { return judged(judgement(simulator_.exact(truth), known_)); });
        if (qualified)
            for (const JudgedQuantity& quantity : *qualified)
                if (quantity.name == name)
                    return quantity.value;
        return std::nullopt;
    }

    const RunSimulator& simulator_;
    const Known& known_;
    const InjectedError& error_;
};

// ------------------------------------------------------------------------------------ one point

struct RunResult {
    bool refused = false;
    Outcome verdict = Outcome::inconclusive;
    std::vector<JudgedQuantity> quantities;
};

RunResult result_of(const Qualification& analysis, const std::vector<JudgedQuantity>& quantities) {
    RunResult result;
    result.verdict = analysis.verdict;
    for (const JudgedQuantity& wanted : quantities) {
        const auto found =
            std::ranges::find(analysis.quantities, wanted.name, &JudgedQuantity::name);
        result.quantities.push_back(found == analysis.quantities.end() ? JudgedQuantity{} : *found);
    }
    return result;
}

void count(Outcome outcome, OutcomeCounts& counts) {
    if (outcome == Outcome::pass)
        ++counts.pass;
    else if (outcome == Outcome::fail)
        ++counts.fail;
    else
        ++counts.other;
}

CharacteristicPoint summed(double size, const std::vector<RunResult>& results,
                           std::size_t quantities) {
    CharacteristicPoint point;
    point.size = size;
    point.quantities.resize(quantities);
    for (const RunResult& result : results) {
        point.refused += result.refused;
        count(result.verdict, point.verdict);
        for (std::size_t k = 0; k < quantities; ++k) {
            QuantityOutcomes& sum = point.quantities[k];
            const JudgedQuantity one = result.refused ? JudgedQuantity{} : result.quantities[k];
            count(one.outcome, sum.counts);
            sum.mean_value += one.value / static_cast<double>(results.size());
            sum.mean_uncertainty += one.expanded_uncertainty / static_cast<double>(results.size());
        }
    }
    return point;
}

class Study {
public:
    Study(const RunSimulator& simulator, const CharacteristicRequest& request)
        : simulator_(simulator), request_(request), known_{{}, NoiseDraws(request.seed)} {
        QualificationInput input = simulator.draw(simulator.as_told(), request.seed, 0);
        const Qualification told = qualify(input);
        known_.signatures = told.signatures;
        quantities_ = judged(told);
        if (quantities_.empty())
            throw NumericalError(
                fmt::format("operating characteristic: a run without any error is not judged: {}",
                            fmt::join(told.reasons, "; ")));
    }

    OperatingCharacteristic run() {
        OperatingCharacteristic result;
        result.quantities = quantities_;
        result.runs = request_.runs;
        result.seed = request_.seed;
        result.errors = errors();
        for (const ErrorCharacteristic& error : result.errors)
            all_ += static_cast<int>(error.points.size());
        result.without_error = at(simulator_.as_told(), 0.0);
        for (ErrorCharacteristic& error : result.errors)
            for (CharacteristicPoint& point : error.points)
                point = at(truth_with(error.name, point.size), point.size);
        return result;
    }

private:
    const ErrorSignature* signature_of(const std::string& name) const {
        const auto found = std::ranges::find(known_.signatures, name, &ErrorSignature::name);
        return found == known_.signatures.end() ? nullptr : &*found;
    }

    bool is_wanted(const std::string& name) const {
        return request_.errors.empty() ||
               std::ranges::find(request_.errors, name) != request_.errors.end();
    }

    // Those to be studied, with the sizes of their points.
    std::vector<ErrorCharacteristic> errors() const {
        std::vector<ErrorCharacteristic> chosen;
        for (const InjectedError& error : simulator_.errors()) {
            const ErrorSignature* signature = signature_of(error.name);
            if (!signature || !is_wanted(error.name))
                continue;
            const auto like = std::ranges::find_if(chosen, [&](const ErrorCharacteristic& other) {
                return std::ranges::find(signature->confounded_with, other.name) !=
                       signature->confounded_with.end();
            });
            if (like != chosen.end() && request_.errors.empty())
                like->alike.push_back(error.name);
            else
                chosen.push_back(planned(error, *signature));
        }
        require_all_found(chosen);
        return chosen;
    }

    void require_all_found(const std::vector<ErrorCharacteristic>& chosen) const {
        for (const std::string& name : request_.errors)
            if (std::ranges::find(chosen, name, &ErrorCharacteristic::name) == chosen.end())
                throw ConfigError({"--error"}, fmt::format("there is no '{}'; `etalon plan` lists "
                                                           "the errors of this station",
                                                           name));
    }

    ErrorCharacteristic planned(const InjectedError& error, const ErrorSignature& signature) const {
        ErrorCharacteristic result{error.name,       error.unit, {}, signature.observable,
                                   signature.reason, {},         {}};
        if (!signature.observable)
            return result;
        const LimitSearch search(simulator_, known_, error);
        std::vector<double> sizes;
        for (const JudgedQuantity& quantity : quantities_) {
            const double start = signature.size *
                                 *simulator_.station().limits.b3_position_field_rms_mm /
                                 signature.after_rms_mm;
            result.limit_size.push_back(search.size_at(quantity.name, quantity.limit, start));
            for (const double multiple : characteristic_multiples)
                if (result.limit_size.back())
                    sizes.push_back(multiple * *result.limit_size.back());
        }
        std::ranges::sort(sizes);
        for (const double size : sizes) {
            result.points.emplace_back();
            result.points.back().size = size;
        }
        return result;
    }

    RunTruth truth_with(const std::string& name, double size) const {
        const std::vector<InjectedError> errors = simulator_.errors();
        RunTruth truth = simulator_.as_told();
        std::ranges::find(errors, name, &InjectedError::name)->apply(truth, size);
        return truth;
    }

    CharacteristicPoint at(const RunTruth& truth, double size) {
        std::vector<RunResult> results(static_cast<std::size_t>(request_.runs));
        tbb::parallel_for(std::size_t{0}, results.size(), [&](std::size_t run) {
            const auto qualified = attempted([&] {
                results[run] = result_of(
                    judgement(simulator_.draw(truth, request_.seed, run), known_), quantities_);
            });
            results[run].refused = !qualified;
        });
        if (request_.progress)
            request_.progress(++done_, all_);
        return summed(size, results, quantities_.size());
    }

    const RunSimulator& simulator_;
    const CharacteristicRequest& request_;
    Known known_;
    std::vector<JudgedQuantity> quantities_;
    int done_ = 0, all_ = 1;
};

}  // namespace

Share run_share(int count, int runs) {
    if (runs <= 0 || count < 0)
        throw NumericalError(fmt::format("share of runs: {} of {}", count, runs));
    return wilson_share(static_cast<std::size_t>(count), static_cast<std::size_t>(runs));
}

OperatingCharacteristic operating_characteristic(const RunSimulator& simulator,
                                                 const CharacteristicRequest& request) {
    return Study(simulator, request).run();
}

const CharacteristicPoint* point_at(const ErrorCharacteristic& error, std::size_t quantity,
                                    double multiple) {
    if (quantity >= error.limit_size.size() || !error.limit_size[quantity])
        return nullptr;
    const double size = multiple * *error.limit_size[quantity];
    const auto found = std::ranges::find_if(error.points, [&](const CharacteristicPoint& point) {
        return std::abs(point.size - size) <= 1e-12 * std::abs(size);
    });
    return found == error.points.end() ? nullptr : &*found;
}

}  // namespace etalon
