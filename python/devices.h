// Devices that several of Python's threads may hold and close. One thread at a time has the device.
// Needs the GIL, and gives it free while it waits.
#pragma once

#include "python/interruptible.h"
#include "station/setup/station_file.h"

namespace etalon {

template <class Device>
class SharedDevice {
public:
    // What `question` makes of the device. Throws Error when it is closed.
    template <class Question>
    auto ask(Question&& question) {
        return without_gil([&] {
            const std::lock_guard turn(mutex_);
            return question(open());
        });
    }

    void close() {
        without_gil([&] {
            const std::lock_guard turn(mutex_);
            device_.reset();
        });
    }

protected:
    Device& open() {
        if (!device_)
            throw Error("this device is closed");
        return *device_;
    }

    SteadyClock clock_;
    std::mutex mutex_;
    std::unique_ptr<Device> device_;
};

class SharedCamera : public SharedDevice<Camera> {
public:
    // Waits for a camera that another program seems to hold.
    SharedCamera(const std::string& uri, const CameraLink& link);

    Frame frame(int retries);
};

// Within the rules of its station; there is no other way from Python to an axis.
class SharedStage : public SharedDevice<Stage> {
public:
    // `homed`: the operator's word, Stage::take_for_homed().
    SharedStage(const StationStage& stage, bool homed);

    // What takes long: until Ctrl-C, or stop() on another thread.
    void run(const std::function<void(Stage&, std::stop_token)>& work);
    // Ends every run() that goes on or waits, then stops the axes.
    bool stop();
    void close();
    const std::vector<Axis>& axes() const { return axes_; }

private:
    std::stop_token halt_token();
    void halt();

    std::vector<Axis> axes_;
    std::mutex halt_mutex_;
    std::stop_source halt_;
};

// Configures and arms; what is in force.
CaptureSettings configured(SharedCamera& camera, const CaptureSettings& wanted);

// Dicts of name, kind, unit, low, high and speed.
pybind11::list axes_list(const std::vector<Axis>& axes);

}  // namespace etalon
