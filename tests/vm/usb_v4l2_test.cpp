// The USB camera through the kernel's own driver (uvcvideo) and V4L2. Runs in the guest.
#include "tests/vm/usb_backend_tests.h"

namespace etalon {
namespace {

const UsbBackend backend{.name = "v4l2", .sets_exposure = true};
const UsbBackendCase grey{backend, UsbPixels::grey, "GREY", 8};
const UsbBackendCase y16{backend, UsbPixels::y16, "Y16", 16};
const UsbBackendCase yuyv{backend, UsbPixels::yuyv, "YUYV", 8};

INSTANTIATE_TEST_SUITE_P(V4l2, CameraContract, testing::Values(y16.maker()), rig_name);
INSTANTIATE_TEST_SUITE_P(V4l2, UsbBackendFormats, testing::Values(grey, y16, yuyv), case_name);
INSTANTIATE_TEST_SUITE_P(V4l2, UsbBackendTest, testing::Values(grey), case_name);

}  // namespace
}  // namespace etalon
