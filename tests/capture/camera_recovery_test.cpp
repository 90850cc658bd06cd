// A camera that is not there at once.
#include "capture/camera_recovery.h"

#include "tests/fakes/fake_camera.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Another program's until `free_at`.
struct BusyCamera {
    std::unique_ptr<Camera> open() {
        ++openings;
        if (clock.now() < free_at)
            throw CameraBusy("camera genicam:7", 3000ms);
        return std::make_unique<FakeCamera>([](const CaptureSettings&) { return CodeImage{}; },
                                            clock);
    }
    std::unique_ptr<Camera> open_when_free() {
        return etalon::open_when_free([&] { return open(); }, clock, stop.get_token(),
                                      [&](const std::string& text) { told += text; });
    }

    VirtualClock clock;
    std::stop_source stop;
    Instant free_at = clock.now();
    int openings = 0;
    std::string told;
};

TEST(OpenWhenFree, SaysNothingOfACameraThatIsFree) {
    BusyCamera camera;
    EXPECT_TRUE(camera.open_when_free());
    EXPECT_EQ(camera.openings, 1);
    EXPECT_EQ(camera.told, "");
}

TEST(OpenWhenFree, WaitsForAProgramThatWasKilledAndSaysHowLong) {
    BusyCamera camera;
    camera.free_at += 2700ms;
    const Instant begin = camera.clock.now();
    EXPECT_TRUE(camera.open_when_free());
    EXPECT_LE(camera.clock.now() - begin, 3200ms);
    EXPECT_EQ(camera.told,
              "camera genicam:7 is controlled by another program. A camera lets go of a program "
              "that was killed after its heartbeat time-out of 3.0 s: waiting for that, up to "
              "4.0 s");
}

TEST(OpenWhenFree, LeavesACameraToAProgramThatLives) {
    BusyCamera camera;
    camera.free_at += 1h;
    const Instant begin = camera.clock.now();
    EXPECT_THROW(camera.open_when_free(), CameraBusy);
    EXPECT_GE(camera.clock.now() - begin, 4s);
    EXPECT_LE(camera.clock.now() - begin, 5s);
}

TEST(OpenWhenFree, StopsWaitingWhenAsked) {
    BusyCamera camera;
    camera.free_at += 1h;
    camera.stop.request_stop();
    EXPECT_THROW(camera.open_when_free(), Interrupted);
}

}  // namespace
}  // namespace etalon
