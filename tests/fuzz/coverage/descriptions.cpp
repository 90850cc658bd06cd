// Descriptions of GenICam devices, of which Aravis makes nodes: a device in this process that has
// such a one is opened, set up and asked what our cameras are asked. They are checked first: the
// library's XML parser keeps what an earlier text left, and may crash on one that is broken (Aravis
// 0.8.26); a process that opens one camera parses one text.
#include <arv.h>
#include <dlfcn.h>

#include "capture/genicam/genicam_device.h"
#include "capture/genicam/genicam_settings.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

void open(const std::filesystem::path& description) {
    arv_set_fake_camera_genicam_filename(description.c_str());
    const GenicamDevice device("Fake_1", {});
    const CaptureSettings wanted{.exposure = std::chrono::microseconds(2000), .gain_db = 1.0};
    const GenicamCapture capture = configure_genicam(device, wanted);
    require(capture.format != nullptr, "a capture without a format");
    require_all_finite(std::array{capture.exposure_step_us, capture.settings.gain_db});
    genicam_abilities(device);
    const SteadyClock clock;
    read_genicam_clock(device, clock);
    read_ptp(device);
}

}  // namespace
}  // namespace etalon::test

// The library's device copies beyond its buffer when it is read or written behind its memory, where
// it keeps the description (Aravis 0.8.26). A camera refuses what it does not have, and so does
// this one. Both take the place of the library's functions.
namespace {
bool is_there(guint32 address, guint32 size) {
    return guint64(address) + size <= ARV_FAKE_CAMERA_MEMORY_SIZE;
}
}  // namespace

extern "C" gboolean arv_fake_camera_read_memory(ArvFakeCamera* camera, guint32 address,
                                                guint32 size, void* buffer) {
    static const auto read = reinterpret_cast<decltype(&arv_fake_camera_read_memory)>(
        dlsym(RTLD_NEXT, "arv_fake_camera_read_memory"));
    return is_there(address, size) && read(camera, address, size, buffer);
}

extern "C" gboolean arv_fake_camera_write_memory(ArvFakeCamera* camera, guint32 address,
                                                 guint32 size, const void* buffer) {
    static const auto write = reinterpret_cast<decltype(&arv_fake_camera_write_memory)>(
        dlsym(RTLD_NEXT, "arv_fake_camera_write_memory"));
    return is_there(address, size) && write(camera, address, size, buffer);
}

extern "C" int LLVMFuzzerInitialize(int*, char***) {
    for (const char* network : {"GigEVision", "USB3Vision"})
        arv_disable_interface(network);
    arv_enable_interface("Fake");
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    const std::string description(text_of(data, size));
    read_or_refuse([&] {
        etalon::require_sound_description(description);
        open(write_input("description.xml", description));
    });
    return 0;
}
