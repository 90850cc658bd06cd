#include "study/study_summary.h"

#include <gtest/gtest.h>

namespace etalon {
namespace {

struct Sightings {
    DetectorErrors errors;
    std::vector<double> sizes_px;
    std::vector<std::optional<double>> corner_rms_px;

    void add(double size_px, bool detected, std::optional<double> corner_px) {
        errors.push_back(detected ? std::optional(DetectedError{}) : std::nullopt);
        sizes_px.push_back(size_px);
        corner_rms_px.push_back(corner_px);
    }
    std::vector<SizeClass> classes() const { return size_classes(errors, sizes_px, corner_rms_px); }
};

TEST(SizeClasses, HoldEveryPoseOnceAndBoundsBelongToTheUpperOne) {
    Sightings seen;
    for (const double size : {0.0, 24.999, 25.0, 39.0, 40.0, 60.0, 99.0, 100.0, 400.0})
        seen.add(size, true, 0.1);
    std::vector<std::size_t> poses;
    std::vector<std::string> words;
    for (const SizeClass& one : seen.classes()) {
        poses.push_back(one.poses);
        words.push_back(size_words(one));
    }
    EXPECT_EQ(words, (std::vector<std::string>{"below 25", "25 to 40", "40 to 60", "60 to 100",
                                               "from 100", "from 60", "all"}));
    EXPECT_EQ(poses, (std::vector<std::size_t>{2, 2, 1, 2, 2, 4, 9}));
}

// Corner errors 0.01, 0.02 ... 0.40 of markers of 30 px, in a mixed order: the median is the mean
// of the 20th and the 21st, 38 of 40 do not exceed the 38th.
TEST(SizeClasses, HaveTheMedianAndTheQuantileOfTheirOwnPoses) {
    Sightings seen;
    for (int i = 0; i < 40; ++i)
        seen.add(30.0, true, 0.01 * (1 + 27 * i % 40));
    for (int i = 0; i < 10; ++i)
        seen.add(30.0, false, std::nullopt);
    seen.add(80.0, true, 7.0);
    const SizeClass one = seen.classes()[1];
    EXPECT_EQ(one.poses, 50u);
    EXPECT_EQ(one.detected->count, 40u);
    EXPECT_DOUBLE_EQ(one.median_corner_px->value, 0.205);
    EXPECT_DOUBLE_EQ(*one.corner_quantile_px, 0.38);
    // Fewer than 14 of 40 lie below the median with 1.9 %, fewer than 15 with 4.0 %.
    EXPECT_DOUBLE_EQ(one.median_corner_px->interval->low, 0.14);
    EXPECT_DOUBLE_EQ(one.median_corner_px->interval->high, 0.27);
}

TEST(SizeClasses, SayNothingOfWhatTheyDoNotKnow) {
    Sightings seen;
    for (int i = 0; i < 19; ++i)
        seen.add(30.0, true, 0.3);
    seen.add(50.0, true, std::nullopt);
    seen.add(70.0, false, std::nullopt);
    const auto classes = seen.classes();
    EXPECT_FALSE(classes[0].detected) << "no pose";
    EXPECT_FALSE(classes[0].median_corner_px);
    EXPECT_TRUE(classes[1].median_corner_px);
    EXPECT_FALSE(classes[1].corner_quantile_px) << "of 19 it is the largest";
    EXPECT_EQ(classes[2].detected->value, 1.0);
    EXPECT_FALSE(classes[2].median_corner_px) << "a pose without corners";
    EXPECT_EQ(classes[3].detected->value, 0.0);
    seen.sizes_px.pop_back();
    EXPECT_THROW(seen.classes(), NumericalError);
}

}  // namespace
}  // namespace etalon
