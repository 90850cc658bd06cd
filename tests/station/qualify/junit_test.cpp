#include "station/record/run_json.h"

#include <gmock/gmock.h>

#include "core/file/text.h"

namespace etalon {
namespace {

using testing::HasSubstr;

QualifyResult result_with(RunOutcome outcome, const std::vector<JudgedQuantity>& quantities) {
    QualifyResult result;
    result.station.id = "demo & co";
    result.camera.serial = "CAM-7";
    result.started_utc = "2026-03-07T14:05:09Z";
    result.outcome = outcome;
    result.analysis.emplace();
    result.analysis->quantities = quantities;
    result.analysis->reasons = {"one is <not> seen"};
    return result;
}

JudgedQuantity quantity(const std::string& name, Outcome outcome) {
    JudgedQuantity q;
    q.name = name;
    q.unit = "mm";
    q.value = 0.07;
    q.expanded_uncertainty = 0.02;
    q.limit = 0.3;
    q.outcome = outcome;
    return q;
}

TEST(Junit, HasATestCaseForEachQuantityAndOneForTheVerdict) {
    const std::string xml = junit_xml(
        result_with(RunOutcome::inconclusive,
                    {quantity("a", Outcome::pass), quantity("b", Outcome::fail),
                     quantity("c", Outcome::inconclusive), quantity("d", Outcome::not_observable),
                     quantity("e", Outcome::skipped)}));
    EXPECT_THAT(xml, HasSubstr("tests=\"6\" failures=\"1\" errors=\"2\" skipped=\"2\""));
    EXPECT_THAT(xml, HasSubstr("name=\"a\" time=\"0\"><system-out>0.07 mm with U = 0.02 mm"));
    EXPECT_THAT(xml, HasSubstr("<failure type=\"FAIL\""));
    EXPECT_THAT(xml, HasSubstr("<error type=\"INCONCLUSIVE\" message=\"0.07 mm"));
    EXPECT_THAT(xml, HasSubstr("<skipped message=\"NOT_OBSERVABLE: 0.07 mm"));
    EXPECT_THAT(xml, HasSubstr("name=\"verdict\" time=\"0\"><error type=\"INCONCLUSIVE\" "
                               "message=\"one is &lt;not&gt; seen\">"));
    EXPECT_THAT(xml, HasSubstr("classname=\"etalon.demo &amp; co\""));
}

// Green only where the verdict is PASS.
TEST(Junit, IsRedWhereTheVerdictIsNotPass) {
    for (const auto& [outcome, red] : std::vector<std::pair<RunOutcome, std::string>>{
             {RunOutcome::pass, "failures=\"0\" errors=\"0\""},
             {RunOutcome::fail, "failures=\"1\" errors=\"0\""},
             {RunOutcome::inconclusive, "failures=\"0\" errors=\"1\""},
             {RunOutcome::error, "failures=\"0\" errors=\"1\""},
             {RunOutcome::aborted, "failures=\"0\" errors=\"1\""}})
        EXPECT_THAT(junit_xml(result_with(outcome, {})), HasSubstr(red)) << name(outcome);
}

TEST(Junit, HoldsNothingThatXmlHasNoPlaceFor) {
    QualifyResult result = result_with(RunOutcome::error, {});
    result.analysis.reset();
    result.reason = "timed out \xff\x01\n</testsuite>";
    EXPECT_THAT(junit_xml(result), HasSubstr("message=\"timed out ?? &lt;/testsuite&gt;\""));
}

}  // namespace
}  // namespace etalon
