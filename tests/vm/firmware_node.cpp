// Preloaded (LD_PRELOAD) for programs that use libcamera in the guest. libcamera names a USB camera
// after the place that the firmware gives its host controller; the virtual controller has none, and
// without one libcamera leaves the camera out. This takes the place of the one function that looks.
#include <string>

namespace libcamera::sysfs {

std::string firmwareNodePath(const std::string& device);  // of libcamera's internal interface

std::string firmwareNodePath(const std::string& device) {
    const std::string controller = "vhci_hcd.0";
    return device.ends_with(controller) ? "virtual" : std::string();
}

}  // namespace libcamera::sysfs
