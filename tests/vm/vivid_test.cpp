// The kernel's virtual video driver (vivid) through the V4L2 backend: a second driver beside
// uvcvideo, with every pixel format, the multi-planar interface and faults on request. Runs in the
// guest. Device 0 is single-planar, device 1 multi-planar.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "capture/v4l2/v4l2_camera.h"
#include "tests/capture/frame/camera_contract.h"

namespace etalon {
namespace {

constexpr int width = 320, height = 180;

// A node beside the backend's own, to play tricks on the driver.
class Node {
public:
    explicit Node(const std::string& path) : file_(open(path.c_str(), O_RDWR)) {}
    ~Node() { close(file_); }
    Node(const Node&) = delete;
    Node& operator=(const Node&) = delete;

    // By the driver's own name; true if it was accepted.
    bool set(const std::string& control, int value) {
        v4l2_queryctrl found{};
        found.id = V4L2_CTRL_FLAG_NEXT_CTRL;
        while (ioctl(file_, VIDIOC_QUERYCTRL, &found) == 0) {
            if (reinterpret_cast<const char*>(found.name) == control) {
                v4l2_control request{found.id, value};
                return ioctl(file_, VIDIOC_S_CTRL, &request) == 0;
            }
            found.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
        }
        return false;
    }

private:
    int file_;
};

std::string place_of(int device) {
    return "platform:vivid-00" + std::to_string(device);
}

// Empty where there is none.
std::string path_of(int device) {
    for (const CameraIdentity& camera : list_v4l2_cameras())
        if (camera.model == "vivid at " + place_of(device))
            return camera.uri.substr(camera.uri.find('/'));
    return "";
}

class VividRig final : public CameraRig {
public:
    VividRig(int device, std::string format, int bits)
        : device_(device), format_(std::move(format)), bits_(bits) {
        Node node(path_of(device));
        node.set("OSD Text Mode", 2);  // none: it would change with time
        node.set("Test Pattern", 4);   // squares of all colours
    }

    std::string missing() const override {
        return path_of(device_).empty() ? "there is no vivid device" : "";
    }
    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override {
        return open_v4l2_camera(place_of(device_), {}, clock_);
    }
    CaptureSettings settings() const override {
        return {.width = width,
                .height = height,
                .bits = bits_,
                .format = format_,
                .controls = {{"frame_rate", 30}}};
    }
    std::vector<Refusal> refusals() const override {
        return {{"322", [](CaptureSettings& s) { s.width = 322; }},
                {"15 bits", [](CaptureSettings& s) { s.bits = 15; }},
                {"7000 us", [](CaptureSettings& s) { s.exposure = 7ms; }},
                {"Line1", [](CaptureSettings& s) { s.trigger = "Line1"; }},
                {"1001", [](CaptureSettings& s) { s.controls["frame_rate"] = 1001; }}};
    }

private:
    int device_;
    std::string format_;
    int bits_;
    SteadyClock clock_;
};

CameraRigMaker rig(int device, const std::string& format, int bits) {
    return {format + "OfDevice" + std::to_string(device),
            [=] { return std::make_unique<VividRig>(device, format, bits); }};
}

INSTANTIATE_TEST_SUITE_P(Vivid, CameraContract, testing::Values(rig(1, "Y12", 12)), rig_name);

// ---- formats ---------------------------------------------------------------------------------

cv::Mat picture(int device, const std::string& format, int bits) {
    VividRig rig(device, format, bits);
    const auto camera = rig.open();
    camera->configure(rig.settings());
    camera->arm();
    const Frame frame = camera->frame_after(rig.clock().now(), 3, {});
    EXPECT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    cv::Mat codes;
    frame.image.pixels.convertTo(codes, CV_32S);
    return codes;
}

class VividFormats : public testing::TestWithParam<int> {};

// The driver makes 8 bits of a colour and widens them, by zeros, or in a mosaic by repeating their
// last bits, so that one format proves another.
TEST_P(VividFormats, ShowTheSamePictureInEveryDepth) {
    const cv::Mat grey = picture(GetParam(), "GREY", 8);
    double low = 0, high = 0;
    cv::minMaxLoc(grey, &low, &high);
    ASSERT_GT(high - low, 200.0);
    const auto differs = [](const cv::Mat& a, const cv::Mat& b) {
        return cv::norm(a, b, cv::NORM_INF);
    };
    EXPECT_EQ(differs(picture(GetParam(), "Y10", 10), grey * 4), 0.0);
    EXPECT_EQ(differs(picture(GetParam(), "Y12", 12), grey * 16), 0.0);
    EXPECT_EQ(differs(picture(GetParam(), "Y16", 16), grey * 256), 0.0);
    EXPECT_EQ(differs(picture(GetParam(), "Y16 -BE", 16), grey * 256), 0.0);
    const cv::Mat luma = picture(GetParam(), "YUYV", 8);
    EXPECT_EQ(differs(picture(GetParam(), "UYVY", 8), luma), 0.0);
    EXPECT_EQ(differs(picture(GetParam(), "NV12", 8), luma), 0.0);
    if (GetParam() == 1) {
        EXPECT_EQ(differs(picture(GetParam(), "NM12", 8), luma), 0.0);
    }
    for (const std::string mosaic : {"RG", "BG", "GB"}) {
        const std::string eight = mosaic == "RG" ? "RGGB" : mosaic == "BG" ? "BA81" : "GBRG";
        const cv::Mat raw = picture(GetParam(), eight, 8);
        cv::Mat last2, last4;
        cv::bitwise_and(raw, cv::Scalar(3), last2);
        cv::bitwise_and(raw, cv::Scalar(15), last4);
        EXPECT_EQ(differs(picture(GetParam(), mosaic + "10", 10), raw * 4 + last2), 0.0) << mosaic;
        EXPECT_EQ(differs(picture(GetParam(), mosaic + "12", 12), raw * 16 + last4), 0.0) << mosaic;
    }
}

INSTANTIATE_TEST_SUITE_P(, VividFormats, testing::Values(0, 1));

// ---- faults ----------------------------------------------------------------------------------

class Vivid : public testing::Test {
protected:
    Vivid() {
        camera_ = rig_.open();
        camera_->configure(rig_.settings());
    }

    // The next frame, whenever it was exposed.
    Frame next() { return camera_->frame_after(rig_.clock().now() - 2s, 0, {}); }

    VividRig rig_{0, "GREY", 8};
    std::unique_ptr<Camera> camera_;
    Node node_{path_of(0)};
};

TEST_F(Vivid, MarksAFrameThatTheDriverFlags) {
    camera_->arm();
    next();
    bool flagged = false;
    for (int i = 0; i < 20 && !flagged; ++i) {
        ASSERT_TRUE(node_.set("Inject V4L2_BUF_FLAG_ERROR", 1));
        flagged = next().status == FrameStatus::corrupt;
    }
    EXPECT_TRUE(flagged);
    EXPECT_EQ(camera_->frame_after(rig_.clock().now(), 5, {}).status, FrameStatus::complete);
}

TEST_F(Vivid, CountsTheFramesThatTheDriverDrops) {
    ASSERT_TRUE(node_.set("Percentage of Dropped Buffers", 50));
    camera_->arm();
    for (int i = 0; i < 12; ++i)
        next();
    node_.set("Percentage of Dropped Buffers", 0);
    EXPECT_GT(camera_->statistics().skipped, 0);
}

TEST_F(Vivid, CountsOnWhenTheDriversCounterWraps) {
    ASSERT_TRUE(node_.set("Wrap Sequence Number", 1));
    camera_->arm();
    std::uint64_t last = next().id;
    EXPECT_GT(last, 0xFFFFFF00u);
    EXPECT_LT(last, 0xFFFFFFFFu);
    for (int i = 0; i < 200 && last <= 0xFFFFFFFFu; ++i) {
        const Frame frame = next();
        ASSERT_GT(frame.id, last);
        last = frame.id;
    }
    node_.set("Wrap Sequence Number", 0);
    EXPECT_GT(last, 0xFFFFFFFFu);
}

// Stamps that wrap lie in a far future first: such frames are no good, and after them all is well.
TEST_F(Vivid, MarksFramesWhoseStampsWrap) {
    for (const int bits : {1, 2}) {  // 64 and 32 bits
        ASSERT_TRUE(node_.set("Wrap Timestamp", bits));
        camera_->arm();
        for (int i = 0; i < 3; ++i) {
            const Frame frame = next();
            EXPECT_EQ(frame.status, FrameStatus::corrupt);
            EXPECT_THAT(frame.status_detail, HasSubstr("time stamp"));
        }
        camera_->disarm();
    }
    ASSERT_TRUE(node_.set("Wrap Timestamp", 0));
    camera_->arm();
    EXPECT_EQ(next().status, FrameStatus::complete);
}

// The driver cannot come back without its module being loaded again, so this is the last test.
TEST_F(Vivid, ZIsGoneWhenTheDriverDisconnects) {
    camera_->arm();
    next();
    ASSERT_TRUE(node_.set("Disconnect", 1));
    const Instant begin = rig_.clock().now();
    EXPECT_THROW(next(), DeviceError);
    EXPECT_LT(rig_.clock().now() - begin, 1s);
    EXPECT_THROW(camera_->reconnect(rig_.clock().now() + 500ms, {}), DeviceError);
}

}  // namespace
}  // namespace etalon
