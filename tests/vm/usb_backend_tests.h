// What each backend must do with the USB camera beyond the contract: see usb_backend_tests.cpp.
#pragma once

#include <ostream>

#include "tests/vm/usb_rig.h"

namespace etalon {

struct UsbBackendCase {
    UsbBackend backend;
    UsbPixels pixels;
    std::string format;
    int bits;

    std::unique_ptr<UsbRig> rig() const {
        return std::make_unique<UsbRig>(backend, pixels, format, bits);
    }
    CameraRigMaker maker() const {
        return {format, [*this] { return rig(); }};
    }
};

class UsbBackendTest : public testing::TestWithParam<UsbBackendCase> {
protected:
    void SetUp() override;

    const std::unique_ptr<UsbRig> rig_ = GetParam().rig();
    std::unique_ptr<Camera> camera_;
};

// For each format, while UsbBackendTest is for one.
class UsbBackendFormats : public UsbBackendTest {};

// For messages.
inline void PrintTo(const UsbBackendCase& which, std::ostream* out) {
    *out << which.backend.name << " " << which.format;
}

std::string case_name(const testing::TestParamInfo<UsbBackendCase>& info);

}  // namespace etalon
