// The USB camera through libcamera. Runs in the guest, with libetalon_firmware_node.so preloaded.
// libcamera 0.0.3 knows no 16-bit grey, and reads no exposure of a USB camera back.
#include "tests/vm/usb_backend_tests.h"

namespace etalon {
namespace {

const UsbBackend libcamera{.name = "libcamera", .sets_exposure = false};
const UsbBackendCase grey{libcamera, UsbPixels::grey, "R8", 8};
const UsbBackendCase yuyv{libcamera, UsbPixels::yuyv, "YUYV", 8};

INSTANTIATE_TEST_SUITE_P(Libcamera, CameraContract, testing::Values(yuyv.maker()), rig_name);
INSTANTIATE_TEST_SUITE_P(Libcamera, UsbBackendFormats, testing::Values(grey, yuyv), case_name);
INSTANTIATE_TEST_SUITE_P(Libcamera, UsbBackendTest, testing::Values(grey), case_name);

}  // namespace
}  // namespace etalon
