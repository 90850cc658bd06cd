#include "compare/decision/verdict.h"

#include <fmt/format.h>

#include <functional>

#include "compare/uncertainty/uncertainty_budget.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr double normal_enough = 5000.0;  // degrees of freedom

// P(T > t).
double upper_tail(double t, double degrees_of_freedom) {
    if (degrees_of_freedom > normal_enough)
        return normal_probability(-t);
    return student_t_probability(-t, static_cast<int>(std::floor(degrees_of_freedom)));
}

double quantile(double upper, double degrees_of_freedom) {
    if (degrees_of_freedom > normal_enough)
        return normal_quantile(upper);
    return student_t_quantile(upper, static_cast<int>(std::floor(degrees_of_freedom)));
}

// Simpson's rule on each piece between these places, which are put in order.
double integral(const std::function<double(double)>& of, std::vector<double> places) {
    constexpr int pieces = 200;  // even
    std::ranges::sort(places);
    double sum = 0.0;
    for (std::size_t i = 1; i < places.size(); ++i) {
        const double width = (places[i] - places[i - 1]) / pieces;
        for (int k = 0; width > 0.0 && k <= pieces; ++k) {
            const double weight = k == 0 || k == pieces ? 1.0 : k % 2 == 1 ? 4.0 : 2.0;
            sum += weight * width / 3.0 * of(places[i - 1] + k * width);
        }
    }
    return sum;
}

double standard_uncertainty(const JudgedQuantity& measured) {
    return measured.expanded_uncertainty / measured.coverage_factor;
}

double density(const ValuePrior& prior, double value) {
    const double z = (value - prior.mean) / prior.deviation;
    return std::exp(-0.5 * z * z) / (std::sqrt(2.0 * std::numbers::pi) * prior.deviation) /
           normal_probability(prior.mean / prior.deviation);
}

// From `low` to `high`, and where the integrand bends: about the limit and the prior's middle.
std::vector<double> places_between(double low, double high, const JudgedQuantity& measured,
                                   const ValuePrior& prior) {
    std::vector<double> places = {low, high};
    for (const double times : {-8.0, -2.0, 0.0, 2.0, 8.0}) {
        places.push_back(measured.limit + times * standard_uncertainty(measured));
        places.push_back(prior.mean + times * prior.deviation);
    }
    for (double& place : places)
        place = std::clamp(place, low, high);
    return places;
}

void add_global_risks(DecisionRisk& risk, const JudgedQuantity& m, double guard,
                      const ValuePrior& prior) {
    const double u = standard_uncertainty(m), nu = m.degrees_of_freedom;
    const auto passes = [&](double value) {
        return upper_tail((value - m.limit + guard) / u, nu) * density(prior, value);
    };
    const auto fails = [&](double value) {
        return upper_tail((m.limit + guard - value) / u, nu) * density(prior, value);
    };
    const double end = std::max(m.limit, prior.mean + 9.0 * prior.deviation);
    risk.consumer = integral(passes, places_between(m.limit, end, m, prior));
    risk.producer = integral(fails, places_between(0.0, m.limit, m, prior));
    risk.has_prior = true;
}

}  // namespace

std::string DecisionRule::name() const {
    if (guard_factor == 0.0)
        return "simple";
    return guard_factor == 1.0 ? "guarded" : fmt::format("guard band {:.4g} U", guard_factor);
}

std::string DecisionRule::sentence() const {
    if (guard_factor == 0.0)
        return "value <= limit is PASS, value > limit is FAIL, whatever U is";
    const std::string w = guard_factor == 1.0 ? "U" : fmt::format("{:.4g} U", guard_factor);
    return fmt::format(
        "value + {} <= limit is PASS, value - {} > limit is FAIL, anything between is INCONCLUSIVE",
        w, w);
}

DecisionRisk decision_risk(const JudgedQuantity& measured, const DecisionRule& rule,
                           const std::optional<ValuePrior>& prior) {
    const double u = standard_uncertainty(measured), nu = measured.degrees_of_freedom;
    const auto is_size = [](double value) { return std::isfinite(value) && value > 0.0; };
    if (!is_size(u) || !is_size(measured.limit) || !std::isfinite(measured.value) || !(nu >= 1.0))
        throw NumericalError(fmt::format("decision rule: no risks of value {}, u {}, limit {}",
                                         measured.value, u, measured.limit));
    const double guard = rule.guard_factor * measured.coverage_factor * u;
    DecisionRisk risk;
    risk.conformance = upper_tail((measured.value - measured.limit) / u, nu);
    const auto passes = [&](double distance) -> std::optional<double> {
        const double value = measured.limit - guard + distance * u;
        return value >= 0.0 ? std::optional(value) : std::nullopt;
    };
    const double wide = quantile(0.05, nu);
    risk.passes_95 = passes(-wide);
    risk.passes_50 = passes(0.0);
    risk.passes_5 = passes(wide);
    if (prior)
        add_global_risks(risk, measured, guard, *prior);
    else
        risk.consumer = risk.producer = risk_at_limit(rule, measured.coverage_factor, nu);
    return risk;
}

double risk_at_limit(const DecisionRule& rule, double coverage_factor, double degrees_of_freedom) {
    if (rule.guard_factor == 1.0 && coverage_factor == etalon::coverage_factor(degrees_of_freedom))
        return 1.0 - coverage_probability;  // by the factor's definition
    return upper_tail(rule.guard_factor * coverage_factor, degrees_of_freedom);
}

const char* name(Outcome outcome) {
    constexpr const char* names[] = {"PASS", "FAIL", "INCONCLUSIVE", "NOT_OBSERVABLE", "SKIPPED"};
    return names[static_cast<std::size_t>(outcome)];
}

Outcome decide(double value, double expanded_uncertainty, double limit, const DecisionRule& rule) {
    if (!std::isfinite(value) || !std::isfinite(expanded_uncertainty) || !std::isfinite(limit) ||
        expanded_uncertainty < 0.0 || limit <= 0.0)
        throw NumericalError(fmt::format("verdict: value {}, U {}, limit {} cannot be judged",
                                         value, expanded_uncertainty, limit));
    const double guard = rule.guard_factor * expanded_uncertainty;
    if (value + guard <= limit)
        return Outcome::pass;
    if (value - guard > limit)
        return Outcome::fail;
    return Outcome::inconclusive;
}

Outcome combine(std::span<const JudgedQuantity> quantities) {
    const auto count = [&](Outcome outcome) {
        return std::ranges::count(quantities, outcome, &JudgedQuantity::outcome);
    };
    if (count(Outcome::fail) > 0)
        return Outcome::fail;
    const bool all_pass = !quantities.empty() && count(Outcome::pass) == std::ssize(quantities);
    return all_pass ? Outcome::pass : Outcome::inconclusive;
}

FamilyWiseRisk family_wise_risk(std::span<const JudgedQuantity> quantities,
                                const DecisionRule& rule) {
    FamilyWiseRisk risk;
    risk.judged = static_cast<int>(quantities.size());
    if (rule.guard_factor == 1.0) {
        risk.each = 1.0 - coverage_probability;  // whatever the degrees of freedom; less for pixels
    } else {
        for (const JudgedQuantity& each : quantities)
            risk.each = std::max(
                risk.each, risk_at_limit(rule, each.coverage_factor, each.degrees_of_freedom));
    }
    risk.false_acceptance = risk.each;
    risk.false_rejection = std::min(1.0, risk.judged * risk.each);
    return risk;
}

}  // namespace etalon
