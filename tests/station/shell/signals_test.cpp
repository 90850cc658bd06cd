#include "station/shell/signals.h"

#include <unistd.h>

#include <cerrno>
#include <future>

#include "tests/test.h"

namespace etalon {
namespace {

bool requests_stop(int signal) {
    std::stop_source source;
    std::promise<void> requested;
    const std::stop_callback callback(source.get_token(), [&] { requested.set_value(); });
    const StopOnSignals signals(source);
    kill(getpid(), signal);
    return requested.get_future().wait_for(std::chrono::seconds(10)) == std::future_status::ready;
}

TEST(StopOnSignals, RequestsAStopForWhateverWouldEndTheProgram) {
    EXPECT_TRUE(requests_stop(SIGINT));
    EXPECT_TRUE(requests_stop(SIGTERM));
    EXPECT_TRUE(requests_stop(SIGQUIT));
    EXPECT_TRUE(requests_stop(SIGHUP));
}

TEST(StopOnSignals, OutlivesTheReaderOfItsOutput) {
    const StopOnSignals signals({});
    std::array<int, 2> ends{};
    ASSERT_EQ(pipe(ends.data()), 0);
    close(ends[0]);
    EXPECT_EQ(write(ends[1], "x", 1), -1);
    EXPECT_EQ(errno, EPIPE);
    close(ends[1]);
}

}  // namespace
}  // namespace etalon
