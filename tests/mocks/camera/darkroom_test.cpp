#include "mocks/camera/darkroom.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>

namespace etalon {
namespace {

Radiance flat(double value) {
    return Radiance(2, 3, CV_32FC1, cv::Scalar(value));
}

double value(const Darkroom& darkroom) {
    return static_cast<double>(darkroom.picture().at<float>(1, 2));
}

// Polls as the stage's server does, until the picture is there.
void wait_for(Darkroom& darkroom, const std::vector<double>& positions) {
    while (!darkroom.shows(positions))
        std::this_thread::yield();
}

TEST(Darkroom, HasAPictureFromTheBeginning) {
    Darkroom darkroom([](const std::vector<double>& q) { return flat(q[0]); }, {7.0});
    EXPECT_EQ(value(darkroom), 7.0);
    EXPECT_TRUE(darkroom.shows({7.0}));
}

// As while a warm stage drifts: every 10 nm a new one.
TEST(Darkroom, APictureServesPlacesThatItCannotTellApart) {
    Darkroom darkroom([](const std::vector<double>& q) { return flat(q[0]); }, {7.0, 5.0});
    EXPECT_TRUE(darkroom.shows({7.0 + 9e-6, 5.0 - 9e-6}));
    EXPECT_FALSE(darkroom.shows({7.0, 5.0 + 11e-6}));
    EXPECT_FALSE(darkroom.shows({7.0}));
}

TEST(Darkroom, ShowsWhatWasWishedOnceItSaysSo) {
    Darkroom darkroom([](const std::vector<double>& q) { return flat(q[0] + 10 * q[1]); }, {0, 0});
    for (int i = 1; i <= 100; ++i) {
        const double x = i, y = 3.0 * i;
        wait_for(darkroom, {x, y});
        EXPECT_EQ(value(darkroom), x + 10 * y);
    }
}

TEST(Darkroom, KeepsTheLastPictureUntilTheNextIsFinished) {
    std::promise<void> finish;
    std::shared_future<void> finished(finish.get_future());
    Darkroom darkroom(
        [finished](const std::vector<double>& q) {
            if (q[0] == 5.0)
                finished.wait();
            return flat(q[0]);
        },
        {7.0});
    EXPECT_FALSE(darkroom.shows({5.0}));
    EXPECT_FALSE(darkroom.shows({5.0}));
    EXPECT_EQ(value(darkroom), 7.0);
    finish.set_value();
    wait_for(darkroom, {5.0});
    EXPECT_EQ(value(darkroom), 5.0);
}

TEST(Darkroom, SkipsWishesThatANewerOneReplaced) {
    std::promise<void> finish, begun;
    std::shared_future<void> finished(finish.get_future());
    std::atomic<int> developed = 0;
    Darkroom darkroom(
        [&, finished](const std::vector<double>& q) {
            if (++developed == 2) {
                begun.set_value();
                finished.wait();
            }
            return flat(q[0]);
        },
        {0.0});
    darkroom.shows({1.0});
    begun.get_future().wait();  // 1 is in work
    for (const double wish : {2.0, 3.0, 4.0})
        EXPECT_FALSE(darkroom.shows({wish}));
    finish.set_value();
    wait_for(darkroom, {4.0});
    EXPECT_EQ(value(darkroom), 4.0);
    EXPECT_EQ(developed, 3);  // the first, 1 and 4
}

}  // namespace
}  // namespace etalon
