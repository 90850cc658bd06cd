#include "station/devices/commands.h"

#include <gtest/gtest.h>

namespace etalon {
namespace {

FrameSizes size(int width, int height) {
    return {{width, height}, {width, height}};
}

// A webcam with more to tell than fits into a line.
ListedBackend webcam() {
    ListedCamera camera;
    camera.identity = {R"(v4l2:usb-0000:00:14.0-3)", "uvcvideo", "HD Pro Webcam with a long name",
                       ""};
    CameraFormat plain{"GREY", "8-bit Greyscale", 8, {size(640, 480)}};
    for (int i = 1; i <= 7; ++i)
        plain.sizes.push_back(size(160 * i, 90 * i));
    camera.abilities.formats = {plain,
                                {"Y10", "10-bit Greyscale", 10, {{{16, 16}, {640, 480}, {8, 8}}}},
                                {"H264", "H.264", 0, {size(640, 480)}},
                                {"NM12", "two planes", 0, {size(640, 480)}}};
    CameraControl exposure{"Exposure Time, Absolute", "157", "", 1, 1e7, 1, {}, false};
    CameraControl white{"White Balance Temperature", "4600", "K", 2800, 6500, 5, {}, true};
    CameraControl gain{"Gain", "0.5", "dB", 0.25, 1.0, std::nullopt, {}, false};
    CameraControl mode{
        "Auto Exposure",
        "Aperture Priority Mode",
        "",
        {},
        {},
        {},
        {"Auto Mode", "Manual Mode", "Shutter Priority Mode", "Aperture Priority Mode"},
        false};
    camera.abilities.controls = {exposure, white, gain, mode};
    return {{"v4l2", true, "Linux video drivers", {}}, {camera}};
}

TEST(DevicesTable, FitsATerminalAndKeepsItsColumns) {
    EXPECT_EQ(devices_table({webcam()}, {"generic", "leadshine-icl-rs"}), R"(cameras
  v4l2              yes  Linux video drivers
      v4l2:usb-0000:00:14.0-3
        uvcvideo HD Pro Webcam with a long name, serial unknown
        formats
          GREY  8 bits   640x480, 160x90, 320x180, 480x270, 640x360, 800x450,
                         960x540, 1120x630
          Y10   10 bits  16x16 to 640x480
          cannot be unpacked: H264, NM12
        controls
          Exposure Time, Absolute    157                     1 to 10000000
          White Balance Temperature  4600 K                  2800 to 6500, steps 5,
                                                             read only
          Gain                       0.5 dB                  0.25 to 1
          Auto Exposure              Aperture Priority Mode  Auto Mode,
                                                             Manual Mode,
                                                             Shutter Priority Mode,
                                                             Aperture Priority Mode
stages
  generic           yes  Modbus TCP
  leadshine-icl-rs  yes  Modbus TCP
)");
}

TEST(DevicesTable, SaysWhyABackendIsLeftOutAndACameraTellsNothing) {
    ListedCamera taken;
    taken.identity = {"genicam:Maker-7", "Maker", "M1", "SN-7"};
    taken.fault =
        "camera genicam:Maker-7: open: it is controlled by another program, which somebody "
        "has to end";
    const ListedBackend genicam{{"genicam", true, "Aravis 0.8.26", {}}, {taken}};
    const ListedBackend none{{"v4l2", true, "Linux video drivers", {}}, {}};
    const ListedBackend left_out{
        {"libcamera",
         false,
         "left out: libcamera was not found when this program was configured and built",
         {}},
        {}};
    EXPECT_EQ(devices_table({genicam, none, left_out}, {}), R"(cameras
  genicam    yes  Aravis 0.8.26
      genicam:Maker-7  Maker M1, serial SN-7
        camera genicam:Maker-7: open: it is controlled by another program,
        which somebody has to end
  v4l2       yes  Linux video drivers
      no camera answers
  libcamera  no   left out: libcamera was not found when this program was
                  configured and built
stages
)");
}

}  // namespace
}  // namespace etalon
