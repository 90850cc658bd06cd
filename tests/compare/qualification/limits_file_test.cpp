#include "compare/qualification/limits_file.h"

#include "compare/qualification/judged_quantities.h"
#include "core/config/strict_reader.h"
#include "tests/test.h"

namespace etalon {
namespace {

const std::string good =
    "etalon: limits/1\n"
    "id: demo-7\n"
    "b3_position_field_rms_mm: {limit: 0.07, unit: mm}\n"
    "b3_position_field_max_mm: {limit: 0.25, unit: mm}\n";

std::filesystem::path file_with(const std::string& text) {
    static const TemporaryFolder folder;
    const std::filesystem::path path = folder / "limits.yaml";
    write_text(path, text);
    return path;
}

std::string refusal(const std::string& text) {
    return config_error_of([&] { read_limits(file_with(text)); });
}

TEST(LimitsFile, ReadsWhatIsRequired) {
    const Limits limits = read_limits(file_with(good));
    EXPECT_EQ(limits.id, "demo-7");
    EXPECT_EQ(limits.b3_position_field_rms_mm, 0.07);
    EXPECT_EQ(limits.b3_position_field_max_mm, 0.25);
    EXPECT_FALSE(limits.pixels_must_match);
}

TEST(LimitsFile, ReadsEveryOtherLimitWhenItIsThere) {
    std::string text = good;
    double limit = 0.11;
    for (const QuantityKind& kind : quantity_kinds().subspan(2)) {
        EXPECT_FALSE(read_limits(file_with(text)).*kind.limit) << kind.name;
        text +=
            fmt::format("{}: {{limit: {}, unit: \"{}\"}}\n", kind.name, limit += 0.25, kind.unit);
        EXPECT_EQ(read_limits(file_with(text)).*kind.limit, limit) << kind.name;
    }
    EXPECT_EQ(read_limits(file_with(text)).b3_rotation_field_rms_mrad, 0.36);
}

TEST(LimitsFile, SaysWhereAndWhatIsWrong) {
    const std::string head = "etalon: limits/1\nid: a\n";
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0.07, unit: mm}\n"),
                HasSubstr("b3_position_field_max_mm"));
    EXPECT_THAT(refusal(good + "b3_positoin: {limit: 1, unit: mm}\n"),
                AllOf(HasSubstr(":5:"), HasSubstr("b3_positoin")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0.07, unit: um}\n"),
                AllOf(HasSubstr(":3:"), HasSubstr("unit")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0, unit: mm}\n"),
                AllOf(HasSubstr(":3:"), HasSubstr("limit")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: .nan, unit: mm}\n"),
                HasSubstr(":3:"));
}

TEST(LimitsFile, ReadsWhetherPixelsMustMatch) {
    EXPECT_TRUE(read_limits(file_with(good + "pixels: must_match\n")).pixels_must_match);
    EXPECT_THAT(refusal(good + "pixels: maybe\n"), HasSubstr("limits.yaml:5"));
}

TEST(LimitsFile, KnowsTheRangeOfEveryQuantity) {
    for (const QuantityKind& kind : quantity_kinds())
        EXPECT_TRUE(std::ranges::any_of(units::all, [&](const Unit& unit) {
            return std::string(unit.name) == kind.unit;
        })) << kind.name;
}

TEST(LimitsFile, ReadsTheDecisionRule) {
    const auto factor = [](const std::string& rule) {
        return read_limits(file_with(good + rule)).rule.guard_factor;
    };
    EXPECT_EQ(factor(""), 1.0);
    EXPECT_EQ(factor("decision_rule: guarded\n"), 1.0);
    EXPECT_EQ(factor("decision_rule: simple\n"), 0.0);
    EXPECT_EQ(factor("decision_rule: {guard_band: 0.83}\n"), 0.83);
    EXPECT_THAT(refusal(good + "decision_rule: lenient\n"), HasSubstr("decision_rule"));
    EXPECT_THAT(refusal(good + "decision_rule: {guard_band: 3.1}\n"),
                HasSubstr("decision_rule.guard_band"));
    EXPECT_THAT(refusal(good + "decision_rule: {guard_band: 1, factor: 2}\n"),
                HasSubstr("decision_rule.factor"));
}

TEST(LimitsFile, ReadsWhatMayBeUnchecked) {
    EXPECT_FALSE(read_limits(file_with(good)).lets_pass_unchecked("repeatability"));
    const Limits limits = read_limits(
        file_with(good + "may_be_unchecked: [repeatability, residuals against noise]\n"));
    EXPECT_TRUE(limits.lets_pass_unchecked("repeatability"));
    EXPECT_TRUE(limits.lets_pass_unchecked("residuals against noise"));
    EXPECT_FALSE(limits.lets_pass_unchecked("drift over the run"));
    EXPECT_THAT(refusal(good + "may_be_unchecked: [declared inputs]\n"),
                AllOf(HasSubstr(":5:"), HasSubstr("may_be_unchecked")));
}

TEST(LimitsFile, ReadsWhenACameraIsDueAndHowItsFleetScatters) {
    const std::string prior = "unit: mm, prior: {mean: 0.03, deviation: 0.01}}";
    std::string text = good + "due_after_days: 180\n";
    text.replace(text.find("unit: mm}"), 9, prior);
    const Limits limits = read_limits(file_with(text));
    EXPECT_EQ(limits.due_after_days, 180);
    ASSERT_EQ(limits.priors.size(), 1u);
    EXPECT_EQ(limits.priors.at("b3_position_field_rms_mm").mean, 0.03);
    EXPECT_EQ(limits.priors.at("b3_position_field_rms_mm").deviation, 0.01);
    EXPECT_FALSE(read_limits(file_with(good)).due_after_days);
    EXPECT_THAT(refusal(good + "due_after_days: 0\n"), HasSubstr("due_after_days"));
}

}  // namespace
}  // namespace etalon
