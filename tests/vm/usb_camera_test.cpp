// The USB camera without a kernel: what its test pattern tells, and how it answers its host.

#include "tests/test.h"
#include "tests/vm/test_pattern.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;
using usb::camera_terminal, usb::control_interface, usb::stream_interface;

// Requests to the camera's entities and to its stream, as uvcvideo makes them.
constexpr int get_current = 0x81, set_current = 0x01, get_information = 0x86;
constexpr int exposure_mode = 0x02, exposure_time = 0x04;
constexpr int probe = 1, commit = 2;

UsbSetup read_control(int request, int selector) {
    return {0xA1, request, selector << 8, camera_terminal << 8 | control_interface, 34};
}
UsbSetup write_control(int selector) {
    return {0x21, set_current, selector << 8, camera_terminal << 8 | control_interface, 34};
}
UsbSetup read_stream(int selector) {
    return {0xA1, get_current, selector << 8, stream_interface, 34};
}
UsbSetup write_stream(int selector) {
    return {0x21, set_current, selector << 8, stream_interface, 34};
}

TEST(TestPattern, CarriesItsNumberAndTimeAndEveryWrongByteShows) {
    for (const UsbPixels pixels :
         {UsbPixels::grey, UsbPixels::y12, UsbPixels::y16, UsbPixels::yuyv}) {
        const StreamMode mode{pixels, {17, 5}};
        const PatternStamp stamp{70000, Instant(std::chrono::nanoseconds(123456789012345))};
        Bytes frame = pattern_frame(mode, stamp);
        EXPECT_EQ(read_stamp(frame, bytes_per_pixel(pixels)).frame, stamp.frame);
        EXPECT_EQ(read_stamp(frame, bytes_per_pixel(pixels)).start, stamp.start);
        EXPECT_TRUE(is_pattern(frame, mode));
        const std::size_t stamped = PatternStamp::pixels * 2;
        for (std::size_t i = stamped; i < frame.size(); ++i) {
            frame[i] ^= 1;
            EXPECT_FALSE(is_pattern(frame, mode)) << "byte " << i;
            frame[i] ^= 1;
        }
        frame.pop_back();
        EXPECT_FALSE(is_pattern(frame, mode));
    }
}

TEST(TestPattern, IsAnotherInEachFrameAndKeepsTo12Bits) {
    const StreamMode mode{UsbPixels::y12, {17, 5}};
    const Bytes frame = pattern_frame(mode, {6, {}}), next = pattern_frame(mode, {7, {}});
    EXPECT_NE(Bytes(frame.begin() + 24, frame.end()), Bytes(next.begin() + 24, next.end()));
    for (std::size_t i = 1; i < frame.size(); i += 2)
        EXPECT_LT(frame[i], 16);
}

TEST(UsbVideoDevice, DescribesItselfInPartsThatAddUp) {
    const Bytes all = usb::configuration_descriptor({.sizes = {{640, 480}, {320, 200}, {70, 50}}});
    EXPECT_EQ(all[2] | all[3] << 8, static_cast<int>(all.size()));
    std::size_t at = 0;
    int frames = 0;
    for (; at < all.size() && all[at] >= 2; at += all[at])
        frames += all[at + 1] == 0x24 && all[at + 2] == 5 && all[at] == 30;
    EXPECT_EQ(at, all.size());
    EXPECT_EQ(frames, 4 * 3);
}

TEST(UsbVideoDevice, NegotiatesASizeAndStartsWhenItIsCommitted) {
    UsbVideoDevice device({.sizes = {{640, 480}, {320, 200}}});
    Bytes wish(34, 0);
    wish[2] = 3;  // y16, of the default formats
    wish[3] = 2;
    EXPECT_TRUE(device.write(write_stream(probe), wish));
    EXPECT_FALSE(device.stream());
    const Bytes offer = *device.read(read_stream(probe));
    ASSERT_EQ(offer.size(), 34u);
    EXPECT_EQ(offer[18] | offer[19] << 8 | offer[20] << 16, 320 * 200 * 2);
    EXPECT_TRUE(device.write(write_stream(commit), offer));
    ASSERT_TRUE(device.stream());
    EXPECT_EQ(device.stream()->pixels, UsbPixels::y16);
    EXPECT_EQ(device.stream()->size, cv::Size(320, 200));
}

TEST(UsbVideoDevice, RefusesAnExposureTimeWhileItChoosesItsOwn) {
    UsbVideoDevice device({});
    const Bytes time{70, 0, 0, 0};
    EXPECT_FALSE(device.write(write_control(exposure_time), time));
    EXPECT_EQ(*device.read(read_control(get_information, exposure_time)), Bytes{1 | 2 | 4});
    EXPECT_TRUE(device.write(write_control(exposure_mode), Bytes{1}));
    EXPECT_TRUE(device.write(write_control(exposure_time), time));
    EXPECT_EQ(*device.read(read_control(get_current, exposure_time)), time);
    EXPECT_EQ(device.controls().exposure(), std::chrono::milliseconds(7));
    EXPECT_FALSE(device.write(write_control(exposure_time), Bytes{0x89, 0x13, 0, 0})) << "5001";
    EXPECT_FALSE(device.read(read_control(get_current, 0x7)));
}

}  // namespace
}  // namespace etalon
