// A GigE Vision camera on 127.0.0.1 that shows given pictures: Aravis' fake camera, which speaks
// the real protocols over UDP, with our pixels, our GenICam description (gige_description.h) and
// our sender of frames with chunks.
//
// The client can set Width, Height, OffsetX, OffsetY, PixelFormat, ExposureTime (us), Gain (dB),
// BlackLevel and AcquisitionFrameRate. It runs freely, or is triggered by software or on Line1.
// Only one can exist on a machine (UDP port 3956); a dead client's control is free after 3 s.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/image/image.h"

namespace etalon {

// Payload types of a frame with chunks.
inline constexpr std::uint16_t image_with_chunks = 0x4001;       // GigE Vision 2
inline constexpr std::uint16_t chunks_only = 0x0004;             // its leader describes no image
inline constexpr std::uint16_t extended_chunk_payload = 0x0005;  // until GigE Vision 1.2

struct GigeCameraOptions {
    int width = 512, height = 384;  // px, of the sensor
    int bits = 8;                   // <= 8: starts with Mono8, more: with Mono16
    std::string serial = "TWIN";    // 1..15 characters
    double packet_loss = 0.0;       // part of the stream's packets that are dropped, 0..1
    // By their names in PFNC. Packed ones need a number of pixels that fills whole bytes.
    std::vector<std::string> formats = {"Mono8",    "Mono10",   "Mono12",       "Mono16",
                                        "Mono10p",  "Mono12p",  "Mono12Packed", "Mono10Packed",
                                        "BayerRG8", "BayerGB12"};
    bool latches = false;  // whether the client can read the device's clock
    // Of a frame in chunk mode, one of the above; 0: the camera has no chunks.
    std::uint16_t chunk_payload_type = 0;
    bool ptp = false;  // switched off until the client switches it on
};

// What a frame's chunks say of it.
struct GigeChunkValues {
    double exposure_us = 0.0, gain_db = 0.0;
    std::uint64_t timestamp_ns = 0, frame_id = 0;
};

// Appends `data` as a chunk: followed by its id and its length.
void append_chunk(std::vector<std::uint8_t>& payload, std::uint32_t id,
                  std::span<const std::uint8_t> data);

class GigeCamera {
public:
    // The whole sensor's picture with the settings in force. Called for every frame on the camera's
    // own thread, on which nothing else happens meanwhile: the client's requests wait, and give up
    // after 3 s. Must not throw. Another size than the options' leaves the missing part black.
    using Source = std::function<CodeImage(const CaptureSettings&)>;

    // Listens at once. Throws DeviceError when the port is taken, ConfigError for unusable options.
    GigeCamera(const GigeCameraOptions& options, Source source);
    ~GigeCamera();  // within 0.2 s; the client notices by missing answers

    // An edge on the input Line1. Exposes, if the client chose that.
    void pulse_line();

    // ---- faults, from any thread

    // From now on the frames have another size, unasked; at most the sensor's.
    void change_size_unasked(int width, int height);
    // Part of the packets that the next `frames` frames lose, in place of the options'.
    void lose_packets(double part, int frames);
    // The next `frames` frames are sent with their last line missing.
    void cut_short(int frames);
    // Neither frames nor answers from the next frame on, until thaw().
    void freeze();
    void thaw();
    // The device's clock goes on from another time.
    void jump_clock(std::chrono::nanoseconds by);
    // From now on the chunks say what this makes of the truth, and are sent as that makes of them.
    // Called on the camera's thread; null: nothing is changed.
    void alter_chunk_values(std::function<void(GigeChunkValues&)> alter);
    void alter_payload(std::function<void(std::vector<std::uint8_t>&)> alter);
    // The state of PTP, by its name in SFNC 2, and the offset from the master.
    void set_ptp(const std::string& status, std::chrono::nanoseconds offset);

private:
    struct Device;
    std::unique_ptr<Device> device_;
};

}  // namespace etalon
