#include "compare/qualification/limits_file.h"

#include <fmt/format.h>

#include "compare/qualification/judged_quantities.h"
#include "core/config/strict_reader.h"

namespace etalon {
namespace {

DecisionRule read_rule(const Value& value) {
    if (value.is_mapping())
        return {value.at("guard_band").number({0.0, 3.0})};
    return {value.one_of({"guarded", "simple"}) == "simple" ? 0.0 : 1.0};
}

// A maximum is never below its RMS: with a lower limit the RMS' own would say nothing.
void require_order(const Limits& limits, const Value& root) {
    constexpr std::pair<const char*, const char*> pairs[] = {
        {quantity::position_rms, quantity::position_max},
        {quantity::rotation_rms, quantity::rotation_max},
        {quantity::photometric_rms, quantity::photometric_max}};
    for (const auto& [rms, max] : pairs) {
        const auto of_rms = limits.by_quantity.find(rms), of_max = limits.by_quantity.find(max);
        if (of_rms != limits.by_quantity.end() && of_max != limits.by_quantity.end() &&
            of_max->second < of_rms->second)
            root.at(max).at("limit").fail(
                fmt::format("is {}, below the limit of {}, {}: no maximum is below its RMS",
                            of_max->second, rms, of_rms->second));
    }
}

}  // namespace

Limits read_limits(const std::filesystem::path& path) {
    const StrictFile file(path, "limits/1");
    const Value root = file.root();
    Limits limits;
    limits.id = root.at("id").text();
    if (limits.id.empty())
        root.at("id").fail("is empty");
    for (const QuantityKind& kind : quantity_kinds()) {
        const auto given = kind.is_required ? root.at(kind.name) : root.find(kind.name);
        if (!given)
            continue;
        const Unit& unit = unit_named(kind.unit);
        limits.by_quantity[kind.name] = given->at("limit").number(unit.positive());
        given->at("unit").one_of({kind.unit});
        if (const auto prior = given->find("prior"))
            limits.priors[kind.name] = {prior->at("mean").number(unit.non_negative()),
                                        prior->at("deviation").number(unit.positive())};
    }
    if (const auto pixels = root.find("pixels")) {
        pixels->one_of({"must_match"});
        limits.pixels_must_match = true;
    }
    if (const auto rule = root.find("decision_rule"))
        limits.rule = read_rule(*rule);
    if (const auto conditions = root.find("may_be_unchecked"))
        for (const Value& each : conditions->items())
            limits.may_be_unchecked.push_back(
                each.one_of({"residuals against noise", "camera alone", "edges alone",
                             "drift over the run", "repeatability"}));
    if (const auto days = root.find("due_after_days"))
        limits.due_after_days = days->integer(1, 36500);
    file.finish();
    require_order(limits, root);
    return limits;
}

void decide(JudgedQuantity& quantity, const Limits& limits) {
    quantity.outcome =
        decide(quantity.value, quantity.expanded_uncertainty, quantity.limit, limits.rule);
    const auto prior = limits.priors.find(quantity.name);
    quantity.risk.reset();
    if (quantity.expanded_uncertainty > 0.0)
        quantity.risk = decision_risk(
            quantity, limits.rule,
            prior == limits.priors.end() ? std::nullopt : std::optional(prior->second));
    if (quantity.outcome == Outcome::inconclusive)
        quantity.reason = limits.rule.guard_factor == 1.0
                              ? "the limit lies within the uncertainty of the value"
                              : "the limit lies within the guard band of the value";
}

}  // namespace etalon
