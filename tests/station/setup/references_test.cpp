#include "station/setup/station_file.h"

#include <gmock/gmock.h>

#include "tests/station/stations.h"

namespace etalon {
namespace {

using testing::HasSubstr;

StationFile read_with(const std::string& references) {
    const TemporaryFolder folder;
    return read_station(write_station(folder, station_text + references));
}

std::string refusal(const std::string& what, const std::string& by) {
    try {
        read_with(replaced(traced_text, what, by));
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "";
}

TEST(References, AreReadWithTheirUnits) {
    const auto references = read_with(traced_text).references;
    ASSERT_EQ(references.size(), 7u);
    const TracedReference* scale = reference_named(references, "stage scale y");
    ASSERT_TRUE(scale);
    EXPECT_EQ(scale->value, -7.0);
    EXPECT_EQ(scale->expanded_uncertainty, 24.0);
    EXPECT_EQ(scale->unit, "ppm");
    EXPECT_EQ(scale->certificate, "S-2");
    EXPECT_EQ(scale->laboratory, "Laboratory A");
    EXPECT_EQ(scale->date, "2026-01-12");
    EXPECT_EQ(scale->due, "2999-01-12");
    EXPECT_EQ(reference_named(references, "thermometer")->unit, "K");
    EXPECT_FALSE(reference_named(references, "stage scale w"));
}

// By hand: sqrt(7^2 + 12^2).
TEST(References, CountTheDeviationThatNothingCorrectsFor) {
    const auto references = read_with(traced_text).references;
    EXPECT_NEAR(reference_named(references, "stage scale y")->standard_uncertainty(), 13.8924,
                1e-4);
}

TEST(References, AreInForceFromTheirDateToTheDayTheyAreDue) {
    TracedReference reference;
    reference.date = "2026-01-12";
    reference.due = "2027-01-12";
    EXPECT_TRUE(reference.in_force_on("2026-01-12"));
    EXPECT_TRUE(reference.in_force_on("2027-01-12"));
    EXPECT_FALSE(reference.in_force_on("2026-01-11"));
    EXPECT_FALSE(reference.in_force_on("2027-01-13"));
}

TEST(References, AreRefusedWithTheKeyThatIsWrong) {
    const std::string y = "y: {value_ppm: -7, U_ppm: 24, certificate: S-2";
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, certificate: S-2"), HasSubstr("stage_scale.y"));
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, U_um: 24, certificate: S-2"), HasSubstr("U_ppm"));
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, U_ppm: 0, certificate: S-2"), HasSubstr("U_ppm"));
    EXPECT_THAT(refusal("certificate: S-2", "certificate: \" \""), HasSubstr("must not be empty"));
    EXPECT_THAT(refusal("    y: {", "    w: {"), HasSubstr("stage_scale.w"));
    EXPECT_THAT(refusal("date: 2026-01-12", "date: 2026-02-30"), HasSubstr("no day"));
    EXPECT_THAT(refusal("due: 2999-01-12", "due: 2026-01-12"), HasSubstr("must be after"));
    EXPECT_THAT(refusal("  marker_size:", "  marker_sizes:"), HasSubstr("marker_sizes"));
}

// The budget must not claim less than the certificates leave.
TEST(References, ThatLeaveMoreThanTheStationDeclaresAreRefused) {
    EXPECT_THAT(refusal("value_ppm: -7, U_ppm: 24", "value_ppm: -28, U_ppm: 24"),
                HasSubstr("leaves a standard uncertainty of 30.46 ppm"));
    EXPECT_THAT(refusal("U_um: 6", "U_um: 9"), HasSubstr("marker_flatness_um"));
    EXPECT_THROW(
        read_station(write_station(
            TemporaryFolder(),
            replaced(station_text, "marker_size_uncertainty_ppm: 50\n", "") + traced_text)),
        ConfigError);
}

}  // namespace
}  // namespace etalon
