#include "station/qualify/decision_table.h"

#include "compare/qualification/judged_quantities.h"
#include "report/number_text.h"

namespace etalon {
namespace {

std::vector<std::string> row_of(const JudgedQuantity& each, const DecisionRisk& risk) {
    return {quantity_kind(each.name).words,
            name(each.outcome),
            probability_text(risk.conformance),
            probability_text(risk.consumer),
            probability_text(risk.producer),
            significant(risk.passes_95, 3),
            significant(risk.passes_50, 3),
            significant(risk.passes_5, 3),
            each.unit};
}

}  // namespace

void add_decision(HtmlPage& page, const Qualification& analysis) {
    TableRows rows;
    for (const JudgedQuantity& each : analysis.quantities)
        if (each.risk)
            rows.push_back(row_of(each, *each.risk));
    if (rows.empty())
        return;
    page.add_heading("Decision rule: " + analysis.rule.name());
    page.add_table({"quantity", "outcome", "within its limit", "consumer's risk", "producer's risk",
                    "PASS in 95 %", "in 50 %", "in 5 %", "unit"},
                   rows);
    page.add_notes(
        {"Within its limit: how probable that is of the true value, from this measurement alone.",
         "Risks of the rule (JCGM 106): consumer's, that a value above its limit gets PASS; "
         "producer's, that one within it gets FAIL. With the prior of the limits file where it has "
         "one, otherwise the most that they can be.",
         "Operating characteristic: true values that get PASS in 95, 50 and 5 % of runs; a dash "
         "where no value does."});
}

}  // namespace etalon
