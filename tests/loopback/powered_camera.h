// A GigE Vision camera on 127.0.0.1 that can be cut off from its power: it is a program of its own
// (gige_camera_main.cpp), which loses everything that it was told when it is killed.
#pragma once

#include "tests/loopback/gige_rig.h"
#include "tests/loopback/program.h"

namespace etalon {

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
