#include "mocks/camera/scene_image_source.h"

#include <atomic>
#include <future>

#include "tests/test.h"

namespace etalon {
namespace {

Radiance flat(double value) {
    return Radiance(2, 3, CV_32FC1, cv::Scalar(value));
}

double value(const SceneImageSource& source) {
    return static_cast<double>(source.picture().at<float>(1, 2));
}

// Polls as the stage's server does, until the picture is there.
void wait_for(SceneImageSource& source, const std::vector<double>& positions) {
    while (!source.shows(positions))
        std::this_thread::yield();
}

TEST(SceneImageSource, HasAPictureFromTheBeginning) {
    SceneImageSource source([](const std::vector<double>& q) { return flat(q[0]); }, {7.0});
    EXPECT_EQ(value(source), 7.0);
    EXPECT_TRUE(source.shows({7.0}));
}

// As while a warm stage drifts: every 10 nm a new one.
TEST(SceneImageSource, APictureServesPlacesThatItCannotTellApart) {
    SceneImageSource source([](const std::vector<double>& q) { return flat(q[0]); }, {7.0, 5.0});
    EXPECT_TRUE(source.shows({7.0 + 9e-6, 5.0 - 9e-6}));
    EXPECT_FALSE(source.shows({7.0, 5.0 + 11e-6}));
    EXPECT_FALSE(source.shows({7.0}));
}

TEST(SceneImageSource, ShowsWhatWasWishedOnceItSaysSo) {
    SceneImageSource source([](const std::vector<double>& q) { return flat(q[0] + 10 * q[1]); },
                            {0, 0});
    for (int i = 1; i <= 100; ++i) {
        const double x = i, y = 3.0 * i;
        wait_for(source, {x, y});
        EXPECT_EQ(value(source), x + 10 * y);
    }
}

TEST(SceneImageSource, KeepsTheLastPictureUntilTheNextIsFinished) {
    std::promise<void> finish;
    std::shared_future<void> finished(finish.get_future());
    SceneImageSource source(
        [finished](const std::vector<double>& q) {
            if (q[0] == 5.0)
                finished.wait();
            return flat(q[0]);
        },
        {7.0});
    EXPECT_FALSE(source.shows({5.0}));
    EXPECT_FALSE(source.shows({5.0}));
    EXPECT_EQ(value(source), 7.0);
    finish.set_value();
    wait_for(source, {5.0});
    EXPECT_EQ(value(source), 5.0);
}

TEST(SceneImageSource, SkipsWishesThatANewerOneReplaced) {
    std::promise<void> finish, begun;
    std::shared_future<void> finished(finish.get_future());
    std::atomic<int> developed = 0;
    SceneImageSource source(
        [&, finished](const std::vector<double>& q) {
            if (++developed == 2) {
                begun.set_value();
                finished.wait();
            }
            return flat(q[0]);
        },
        {0.0});
    source.shows({1.0});
    begun.get_future().wait();  // 1 is in work
    for (const double wish : {2.0, 3.0, 4.0})
        EXPECT_FALSE(source.shows({wish}));
    finish.set_value();
    wait_for(source, {4.0});
    EXPECT_EQ(value(source), 4.0);
    EXPECT_EQ(developed, 3);  // the first, 1 and 4
}

}  // namespace
}  // namespace etalon
