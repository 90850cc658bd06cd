// The controls of a video node: exposure, and everything that would make a picture differ from what
// the sensor saw. A control's name here is the driver's, written as v4l2-ctl does: lower case, with
// one underscore for whatever is neither letter nor digit ("exposure_time_absolute").
//
// Source: the kernel's "Extended Controls API" and "Camera Control Reference".
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "capture/v4l2/v4l2_device.h"

namespace etalon {

class V4l2Controls {
public:
    // Asks the device which it has. The device outlives this.
    explicit V4l2Controls(V4l2Device& device);

    // With their values now.
    std::vector<CameraControl> list();

    // Every automatic function off; whatever enhances, mirrors or replaces the image at rest:
    // sharpness, gain and backlight compensation lowest, tone and colour controls at the driver's
    // default. Returns a line for each that could not be brought there.
    std::vector<std::string> bring_to_rest();

    // Sets and reads back. Throws DeviceError when there is no such control, the value is out of
    // its range or no whole number, or the device uses another.
    void set(const std::string& name, double value);

    double get(const std::string& name);  // throws as above

    // Exposure time in the API's steps of 100 us; nothing where the device does not say it so.
    std::optional<std::chrono::microseconds> exposure();
    std::chrono::microseconds exposure_step() const;

    // To the nearest step. Throws DeviceError when there is no such control, it is refused, or
    // the automatic exposure cannot be switched off.
    void set_exposure(std::chrono::microseconds exposure);

private:
    struct Control {
        std::uint32_t id, type, flags;
        std::string name;
        std::int64_t low, high, step, normal;
    };

    const Control* find(std::uint32_t id) const;
    const Control& named(const std::string& name, const std::string& what) const;
    int transfer(unsigned long direction, const Control& control, std::int64_t& value);
    int read(const Control& control, std::int64_t& value);
    int write(const Control& control, std::int64_t value);
    void set_checked(const Control& control, std::int64_t value, const std::string& what);
    std::optional<std::string> bring_to(const Control& control, std::int64_t rest);
    std::vector<std::string> choices(const Control& control);
    CameraControl described(const Control& control);

    V4l2Device& device_;
    std::vector<Control> controls_;
};

}  // namespace etalon
