// What a study can switch to tell where an error comes from: each takes one thing out of the way
// from the scene to the pose that the error may be made of. Switched off where the camera has it,
// on where it has not.
//
//     tone          the sensor's curve: Rec. 709 instead of linear, and linear instead of any curve
//     half-pixel    corners as the library counts pixels, half a pixel off for those whose pixel
//                   centres are at 0.5 (AprilTag's), as if nobody had converted them
//     noise         shot and read noise of the sensor section
//     blur          defocus and diffraction of the lens section: a sharp pinhole
//     undistortion  poses estimated as if the camera did not distort
#pragma once

#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "core/program/errors.h"

namespace etalon {

enum class StudySwitch { tone, half_pixel, noise, blur, undistortion };

// Which are switched; by default none.
class StudySwitches {
public:
    bool has(StudySwitch one) const { return (bits_ & bit(one)) != 0; }
    void toggle(StudySwitch one) { bits_ ^= bit(one); }
    friend bool operator==(const StudySwitches&, const StudySwitches&) = default;

private:
    static unsigned bit(StudySwitch one) { return 1u << static_cast<unsigned>(one); }
    unsigned bits_ = 0;
};

const std::vector<std::string>& study_switch_names();
std::string name_of(StudySwitch one);

// Throws ConfigError at `place` for another name.
StudySwitch parse_study_switch(const std::string& name, const SourcePlace& place);

// The camera that takes the images. Throws ConfigError at `place` for noise and blur that the
// camera does not state: nothing is invented to be switched on.
CameraModel imaging_camera(const CameraModel& camera, const StudySwitches& switches,
                           const SourcePlace& place);

// The camera that poses are estimated with.
CameraModel estimation_camera(const CameraModel& camera, const StudySwitches& switches);

}  // namespace etalon
