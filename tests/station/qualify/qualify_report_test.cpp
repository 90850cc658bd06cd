#include "station/qualify/run_analysis.h"

#include "compare/qualification/judged_quantities.h"
#include "tests/pages.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

JudgedQuantity judged(const char* name, double value, double u, double limit, Outcome outcome,
                      const std::string& reason = "") {
    JudgedQuantity quantity{name, quantity_kind(name).unit, true, value, u};
    quantity.limit = limit;
    quantity.outcome = outcome;
    quantity.reason = reason;
    quantity.measured = outcome != Outcome::skipped;
    return quantity;
}

// A run without poses whose analysis is what a test makes it.
class QualifyReport : public testing::Test {
protected:
    QualifyReport() {
        result.station = read_station(write_station(folder_, station_text));
        result.outcome = RunOutcome::fail;
        result.analysis.emplace();
    }
    std::string page() {
        write_qualify_report(result, folder_ / "report.html");
        return read_text(folder_ / "report.html");
    }
    // Up to the heading behind the judged quantities.
    std::string judged_section() {
        const std::string all = page();
        const auto begin = all.find("Judged on the hold-out poses");
        return all.substr(begin, all.find("<h2>", begin) - begin);
    }
    Qualification& analysis() { return *result.analysis; }

    QualifyResult result;

private:
    TemporaryFolder folder_;
};

TEST_F(QualifyReport, LeadsWithVerdictThenCauseThenWhatToDo) {
    analysis().quantities = {judged(quantity::position_rms, 0.021, 0.037, 0.16, Outcome::pass),
                             judged(quantity::position_max, 0.71, 0.09, 0.45, Outcome::fail)};
    analysis().reasons = {"b3_position_field_max_mm is too large", "the stage <b>moved"};
    analysis().causes.emplace();
    analysis().causes->ranked = {
        {{{{"k1", "k4"}, -0.0301, 0.00065, "", {"calibrate the camera again: k1", "again: k4"}}},
         0.97}};
    const std::string text = page();
    std::size_t at = 0;
    for (const char* part :
         {"verdict bad\"", "<strong>FAIL</strong>",
          "Position bias, largest value of the field in the volume: 0.71 mm, U = 0.09 mm (k = 2.00)"
          "; the limit is 0.45 mm.",
          "Most probable cause", "k1 ~ k4: -0.03010 ± 0.00065 (U, k = 2). Probability 97 %.",
          "What to do", "Calibrate the camera again: k1, or again: k4.", "Why it is not PASS",
          "The stage &lt;b&gt;moved.", "Judged on the hold-out poses"}) {
        const std::size_t found = text.find(part, at);
        ASSERT_NE(found, std::string::npos) << part;
        at = found;
    }
    EXPECT_THAT(text, Not(HasSubstr("b3_position_field_max_mm is")));
    test::expect_readable_page(text);
}

TEST_F(QualifyReport, SaysOnceWhatToDoForAllErrorsOfAKind) {
    analysis().causes.emplace();
    Cause cause{{{{"k3", "k6"},
                  0.0413,
                  0.0046,
                  "",
                  {"calibrate the camera again: k3", "calibrate the camera again: k6"}},
                 {{"p1"}, 6e-4, 2e-5, "", {"calibrate the camera again: p1"}},
                 {{"blur"}, 0.1, 0.02, "px^2", {"look for vibration"}}},
                0.97};
    for (const char* name : {"s1", "s2", "s3", "s4"})
        cause.instead.push_back({name, "half pixel", "blur"});
    analysis().causes->ranked = {cause};
    EXPECT_THAT(
        page(),
        AllOf(HasSubstr("<li>Or in place of these: s1 and half pixel and blur; s2 and half pixel "
                        "and blur; one of 2 other sets. Probability 97 %.</li>"),
              HasSubstr("<li>Calibrate the camera again: k3 or k6, p1.</li>"
                        "<li>Look for vibration.</li>")));
}

TEST_F(QualifyReport, SetsTheOutcomeBesideTheNameAndNotesBelowTheTable) {
    analysis().quantities = {
        judged(quantity::position_max, 0.3, 0.2, 0.45, Outcome::inconclusive, "U is too large"),
        judged(quantity::lack_of_fit_rms, 0.0, 0.0, 0.1, Outcome::skipped, "no repeats")};
    const std::string section = judged_section();
    EXPECT_THAT(
        section,
        HasSubstr("<td data-label=\"quantity\">Position bias, largest value of the field in "
                  "the volume</td><td class=\"tone unsure\" "
                  "data-label=\"outcome\">INCONCLUSIVE</td>"));
    const auto end = section.find("</table>");
    for (const char* note : {"U is too large.", "no repeats."}) {
        EXPECT_GT(section.find(note), end) << note;
        EXPECT_NE(section.find(note), std::string::npos) << note;
    }
}

TEST_F(QualifyReport, SaysThatAFieldLostInNoiseIsBelowItsUncertainty) {
    result.outcome = RunOutcome::pass;
    analysis().quantities = {judged(quantity::position_rms, 0.0, 0.037, 0.16, Outcome::pass)};
    EXPECT_THAT(page(), AllOf(HasSubstr("over the volume: below 0.037 mm; the limit is 0.16 mm."),
                              HasSubstr("data-label=\"value\">below 0.037</td>")));
}

TEST_F(QualifyReport, ExplainsTheBiasesWhereTheyAreFirstUsed) {
    const std::string text = page();
    for (const char* bias : {"B1", "B2", "B3", "B4"}) {
        const std::regex explained(std::string("<dt>") + bias + "[^<]*</dt><dd>[A-Z][^<]+\\.</dd>");
        EXPECT_TRUE(std::regex_search(text, explained)) << bias;
        EXPECT_EQ(text.find(bias), text.find(std::string("<dt>") + bias) + 4) << bias;
    }
}

TEST_F(QualifyReport, SaysOnTopWhyNothingCouldBeJudged) {
    result.outcome = RunOutcome::inconclusive;
    analysis().reasons = {"white is at the end of the scale"};
    analysis().causes.emplace();
    analysis().causes->ranked = {{{{{"overexposed"}, 0.0, 0.0, "", {"expose less"}}}, 1.0}};
    analysis().quantities = {
        judged(quantity::position_rms, 0.0, 0.0, 0.16, Outcome::skipped, "overexposed")};
    const std::string text = page();
    EXPECT_THAT(text, HasSubstr("<p>overexposed. Probability 100 %.</p>"));
    EXPECT_LT(text.find("White is at the end of the scale."), text.find("<table"));
    result.analysis.reset();
    result.reason = "stage: alarm 12";
    result.outcome = RunOutcome::error;
    EXPECT_THAT(page(), HasSubstr("<strong>ERROR</strong><p>stage: alarm 12</p>"));
}

}  // namespace
}  // namespace etalon
