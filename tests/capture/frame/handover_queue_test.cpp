#include "capture/frame/handover_queue.h"

#include "tests/test.h"

namespace etalon {
namespace {

TEST(HandoverQueue, GivesValuesInTheirOrderAndNothingWhenThereIsNone) {
    HandoverQueue<int> queue;
    queue.push(7);
    queue.push(5);
    EXPECT_EQ(queue.pop(0ms, {}), 7);
    EXPECT_EQ(queue.pop(0ms, {}), 5);
    EXPECT_EQ(queue.pop(0ms, {}), std::nullopt);
}

TEST(HandoverQueue, WakesWhoWaitsForAValue) {
    HandoverQueue<int> queue;
    std::thread other([&] { queue.push(7); });
    EXPECT_EQ(queue.pop(1h, {}), 7);
    other.join();
}

TEST(HandoverQueue, WakesWhoWaitsForAValueThatWillNotCome) {
    HandoverQueue<int> queue;
    std::thread other([&] { queue.end(); });
    EXPECT_EQ(queue.pop(1h, {}), std::nullopt);
    other.join();
}

TEST(HandoverQueue, GivesWhatCameBeforeTheEnd) {
    HandoverQueue<int> queue;
    queue.push(7);
    queue.end();
    EXPECT_EQ(queue.pop(1h, {}), 7);
    EXPECT_EQ(queue.pop(1h, {}), std::nullopt);
}

TEST(HandoverQueue, StopsWaitingWhenAskedTo) {
    HandoverQueue<int> queue;
    std::stop_source stop;
    std::thread other([&] { stop.request_stop(); });
    EXPECT_THROW(queue.pop(1h, stop.get_token()), Interrupted);
    other.join();
}

}  // namespace
}  // namespace etalon
