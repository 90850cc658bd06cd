// Freshness where it matters: a stage that is moved over Modbus, and a GigE Vision camera that runs
// freely meanwhile. Every picture is stamped with where the carriage truly was, and whether it
// moved, when its exposure began, so the test knows what the station must not be shown.

#include <cstring>

#include "capture/frame/camera.h"
#include "mocks/camera/gige_camera.h"
#include "tests/loopback/stage_rig.h"

namespace etalon {
namespace {

struct Stamp {
    double position_mm = 0.0;
    double moving = 0.0;
};

class FreshnessRig {
public:
    explicit FreshnessRig(bool latches)
        : device_(options(latches), [this](const CaptureSettings&) {
              Stamp stamp{stage_.simulation.true_positions()[0],
                          stage_.simulation.is_moving() ? 1.0 : 0.0};
              CodeImage picture{cv::Mat::zeros(24, 68, CV_8UC1), 8};
              std::memcpy(picture.pixels.data, &stamp, sizeof stamp);
              return picture;
          }) {}

    // Frames that show another place than the one where the stage had settled, of `moves`.
    int stale_frames_of(int moves) {
        auto stage = stage_.connect_and_home();
        auto camera = open_camera("genicam:127.0.0.1", {}, stage_.clock);
        camera->configure(
            {.exposure = 2000us, .trigger = "none", .controls = {{"AcquisitionFrameRate", 100.0}}});
        camera->arm();
        int stale = 0;
        for (int i = 0; i < moves; ++i) {
            const double target = i % 2 ? 1.0 + 0.01 * i : 4.0 + 0.01 * i;
            stage->move(std::vector<double>{target, 0.0}, {});
            const Instant settled = stage_.clock.now();
            const Frame frame = camera->frame_after(settled, 10, {});
            EXPECT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
            EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, settled);
            stale += shows_another_place(frame, target) ? 1 : 0;
        }
        return stale;
    }

private:
    static GigeCameraOptions options(bool latches) {
        return {.width = 68, .height = 24, .latches = latches};
    }
    static bool shows_another_place(const Frame& frame, double target) {
        Stamp stamp{-1.0, 1.0};
        if (!frame.image.pixels.empty())
            std::memcpy(&stamp, frame.image.pixels.data, sizeof stamp);
        return stamp.moving != 0.0 || std::abs(stamp.position_mm - target) > 1e-3;
    }

    StageRig stage_;
    GigeCamera device_;  // last: its thread looks at the stage
};

TEST(Freshness, ShowsNoFrameFromBeforeTheStageSettledIn200MovesOfAFreeRunningCamera) {
    EXPECT_EQ(FreshnessRig(true).stale_frames_of(200), 0);
}

TEST(Freshness, ShowsNoneEitherWhereTheDevicesClockCannotBeRead) {
    EXPECT_EQ(FreshnessRig(false).stale_frames_of(30), 0);
}

}  // namespace
}  // namespace etalon
