// The contract of Camera (capture/frame/camera.h) as one suite for every backend. A backend's tests
// write a CameraRig, which is whatever makes a camera happen there (a mock, a driver in a virtual
// machine, a folder), and run the suite with
//
//     INSTANTIATE_TEST_SUITE_P(Genicam, CameraContract, testing::Values(
//         CameraRigMaker{"Mono8", [] { return std::make_unique<GenicamRig>(8); }}), rig_name);
//
// and camera_contract.cpp among the sources of their test program. What a rig cannot do (make a
// driver lose a frame, say) is skipped and says so.
#pragma once

#include "capture/frame/camera.h"
#include "tests/test.h"

namespace etalon {

enum class FrameFault { cut_short, damaged, lost, late };

class CameraRig {
public:
    virtual ~CameraRig() = default;

    // Why nothing can be tested here; empty: it can.
    virtual std::string missing() const { return ""; }

    virtual Clock& clock() = 0;
    virtual std::unique_ptr<Camera> open() = 0;

    // What the camera accepts: size, bits and all that it should read back. Bad frames by chance
    // are retried this often.
    virtual CaptureSettings settings() const = 0;
    virtual int retries() const { return 5; }

    // What it must refuse: a part of the message that names it, and what makes it of settings().
    struct Refusal {
        std::string named;
        std::function<void(CaptureSettings&)> change;
    };
    virtual std::vector<Refusal> refusals() const = 0;

    // Exposures that begin when this has returned show `scene` (of the settings' size and bits).
    // False where the pixels are not the test's to choose.
    virtual bool show(const CodeImage& scene) {
        (void)scene;
        return false;
    }

    // The next `frames` frames have this fault. Returns the status that they must come back with;
    // nothing where it cannot be brought about.
    virtual std::optional<FrameStatus> spoil(FrameFault fault, int frames) {
        (void)fault, (void)frames;
        return std::nullopt;
    }

    // Takes the device away and brings it back; false where that is impossible.
    virtual bool unplug() { return false; }
    virtual bool plug_in() { return false; }
};

struct CameraRigMaker {
    std::string name;
    std::function<std::unique_ptr<CameraRig>()> make;
};

inline void PrintTo(const CameraRigMaker& maker, std::ostream* out) {
    *out << maker.name;
}

std::string rig_name(const testing::TestParamInfo<CameraRigMaker>& info);

class CameraContract : public testing::TestWithParam<CameraRigMaker> {
protected:
    void SetUp() override;

    std::unique_ptr<Camera> armed();
    // A random scene that no other number has.
    CodeImage scene(int number) const;
    // Seconds of real time that the call took.
    static double seconds(const std::function<void()>& call);

    std::unique_ptr<CameraRig> rig_;
};

}  // namespace etalon
