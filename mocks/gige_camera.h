// A GigE Vision camera on 127.0.0.1 that shows the pictures it is given: Aravis' fake camera, which
// speaks the real control and stream protocols over UDP, with our pixels in place of its pattern.
//
// Settings: Width, Height, OffsetX, OffsetY, PixelFormat (Mono8, Mono16), ExposureTimeAbs (us) and
// GainRaw (here: dB) can be set by the client; triggers are by software. Only one can exist on a
// machine (GigE Vision's port is fixed: UDP 3956), and after a client that died its control is
// free again 3 s later.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "core/image.h"

namespace etalon {

struct GigeCameraOptions {
    int width = 512, height = 384;  // px, of the sensor
    int bits = 8;                   // <= 8: Mono8, more: Mono16
    std::string serial = "TWIN";    // 1..15 characters
    double packet_loss = 0.0;       // part of the stream's packets that are dropped, 0..1
};

class GigeCamera {
public:
    // The whole sensor's picture with the settings in force. Called for every frame on the camera's
    // own thread, on which nothing else happens meanwhile: the client's requests wait, and give up
    // after 3 s. Must not throw. Another size than the options' leaves the missing part black.
    using Source = std::function<CodeImage(const CaptureSettings&)>;

    // Listens at once. Throws DeviceError when the port is taken, ConfigError for unusable options.
    GigeCamera(const GigeCameraOptions& options, Source source);
    ~GigeCamera();  // within 0.2 s; the client notices by missing answers
    GigeCamera(const GigeCamera&) = delete;
    GigeCamera& operator=(const GigeCamera&) = delete;

    // Fault: from now on the frames have another size, as after a change that the client did not
    // ask for. At most the sensor's.
    void change_size_unasked(int width, int height);

private:
    struct Device;
    std::unique_ptr<Device> device_;
};

}  // namespace etalon
