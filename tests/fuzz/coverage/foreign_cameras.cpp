// Calibrations of other tools: the tool is found by the content, as for users.
#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "tests/fuzz/coverage/checked_camera.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon;
    using namespace etalon::test;
    const auto path = write_input("camera", text_of(data, size));
    read_or_refuse([&] { require_sound(read_any_camera(path)); });
    read_or_refuse([&] { require_sound(read_foreign_camera(path, "cam1")); });
    return 0;
}
