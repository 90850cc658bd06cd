// A GigE Vision camera on 127.0.0.1 for the loopback tests, and pictures that can be told apart.
#pragma once

#include "capture/frame/camera.h"
#include "core/statistics/random.h"
#include "mocks/camera/gige_camera.h"
#include "tests/loopback/program.h"

namespace etalon {

// A picture whose every pixel can be told from its neighbours and from other `number`s.
inline CodeImage picture(int width, int height, int bits, int number) {
    CodeImage image{cv::Mat(height, width, bits <= 8 ? CV_8UC1 : CV_16UC1), bits};
    RandomStream random(7, static_cast<std::uint32_t>(number));
    const auto mask = static_cast<std::uint32_t>(image.full_scale());
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            if (bits <= 8)
                image.pixels.at<std::uint8_t>(y, x) =
                    static_cast<std::uint8_t>(random.bits() & mask);
            else
                image.pixels.at<std::uint16_t>(y, x) =
                    static_cast<std::uint16_t>(random.bits() & mask);
    return image;
}

inline bool same(const cv::Mat& a, const cv::Mat& b) {
    return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

// What the camera tells of this control; without a name where it lists none.
inline CameraControl control_of(const Camera& camera, const std::string& name) {
    for (const CameraControl& control : camera.abilities().controls)
        if (control.name == name)
            return control;
    return {};
}

// A camera on loopback that shows the picture that was put before it last.
struct GigeRig {
    explicit GigeRig(const GigeCameraOptions& options)
        : options_(options), shown_(picture(options.width, options.height, options.bits, 0)) {
        restart();
    }

    // As new: with its own settings, and showing the same.
    void restart() {
        device_ = std::make_unique<GigeCamera>(options_, [this](const CaptureSettings& settings) {
            const std::lock_guard lock(mutex_);
            asked_ = settings;
            return shown_;
        });
    }

    void show(const CodeImage& image) {
        const std::lock_guard lock(mutex_);
        shown_ = image;
    }
    CodeImage shown() {
        const std::lock_guard lock(mutex_);
        return shown_;
    }
    CaptureSettings asked() {
        const std::lock_guard lock(mutex_);
        return asked_;
    }

    std::unique_ptr<Camera> open(CameraLink link = {}) {
        return open_camera("genicam:127.0.0.1", link, clock_);
    }
    CaptureSettings settings() const {
        return {.width = options_.width, .height = options_.height, .bits = options_.bits};
    }
    std::unique_ptr<Camera> armed(CameraLink link = {}) {
        auto camera = open(link);
        camera->configure(settings());
        camera->arm();
        return camera;
    }

    SteadyClock clock_;
    GigeCameraOptions options_;
    std::mutex mutex_;
    CodeImage shown_;
    CaptureSettings asked_;
    std::unique_ptr<GigeCamera> device_;  // last: its thread uses the others
};

// ---- A GigE Vision camera on 127.0.0.1 that can be cut off from its power: it is a program of its
// own (gige_camera_main.cpp), which loses everything that it was told when it is killed.

class PoweredCamera {
public:
    static constexpr int width = 150, height = 80, bits = 12;

    static CodeImage shown(int number) { return picture(width, height, bits, number); }

    // Returns when the camera answers. It shows the picture of that number.
    void switch_on(int number) {
        program_ = start_program("tests/loopback/gige-camera",
                                 {fmt::to_string(width), fmt::to_string(height),
                                  fmt::to_string(bits), fmt::to_string(number)});
        EXPECT_EQ(program_->line(), "ready");
    }
    void cut_power() {
        program_->send(SIGKILL);
        program_->exit_code();
    }

    // What the camera itself says of the settings with which it exposed its first frame since it
    // was switched on: "Mono12p, 7000 us, 3 dB, black level 5". Waits for that frame.
    std::string exposed_with() { return program_->line(); }

private:
    std::unique_ptr<Program> program_;
};

}  // namespace etalon
