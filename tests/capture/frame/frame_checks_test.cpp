#include "capture/frame/frame_checks.h"

#include "tests/test.h"

namespace etalon {
namespace {

TEST(FrameId, AdvancesWhenItGrows) {
    EXPECT_TRUE(frame_id_advanced(7, 8));
    EXPECT_TRUE(frame_id_advanced(7, 12));  // frames between were lost: still later
    EXPECT_FALSE(frame_id_advanced(7, 7));
    EXPECT_FALSE(frame_id_advanced(12, 7));
}

TEST(FrameId, WrapsFrom65535To1BecauseZeroIsNoBlockId) {
    EXPECT_TRUE(frame_id_advanced(65535, 1));
    EXPECT_TRUE(frame_id_advanced(65530, 5));
    EXPECT_FALSE(frame_id_advanced(1, 65535));
    EXPECT_FALSE(frame_id_advanced(5, 65530));
}

TEST(FrameId, OfAnExtendedStreamNeverWraps) {
    EXPECT_TRUE(frame_id_advanced(65535, 65536));
    EXPECT_TRUE(frame_id_advanced(70'000, 5'000'000'000));
    EXPECT_FALSE(frame_id_advanced(70'000, 5));
}

TEST(BitDepth, FitsItsContainerOnly) {
    EXPECT_TRUE(bits_fit_depth(8, CV_8U));
    EXPECT_TRUE(bits_fit_depth(5, CV_8U));
    EXPECT_FALSE(bits_fit_depth(9, CV_8U));
    EXPECT_TRUE(bits_fit_depth(12, CV_16U));
    EXPECT_FALSE(bits_fit_depth(8, CV_16U));
    EXPECT_FALSE(bits_fit_depth(17, CV_16U));
    EXPECT_FALSE(bits_fit_depth(12, CV_32F));
}

TEST(FullScale, IsExceededByHighAlignedCodes) {
    CodeImage image{cv::Mat(3, 5, CV_16UC1, cv::Scalar(100)), 12};
    image.pixels.at<std::uint16_t>(2, 4) = 4095;
    EXPECT_FALSE(exceeds_full_scale(image));
    image.pixels.at<std::uint16_t>(2, 4) = 4095 << 4;
    EXPECT_TRUE(exceeds_full_scale(image));
}

TEST(FullScale, CannotBeExceededByPackedCodesOfAllTheirBits) {
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono8"), 8));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono8"), 7));
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono12p"), 12));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono12p"), 10));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono12"), 12));
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono16"), 16));
}

TEST(SettingDifference, IsFoundInSizeExposureAndGain) {
    const CaptureSettings wanted{.width = 67, .height = 41, .exposure = 7000us, .gain_db = 3.0};
    EXPECT_FALSE(first_difference(wanted, wanted, 0.5));
    CaptureSettings narrow = wanted, low = wanted, longer = wanted, loud = wanted, broken = wanted;
    narrow.width = 64;
    low.height = 40;
    longer.exposure += 5us;
    loud.gain_db = 3.1;
    broken.gain_db = std::nan("");
    for (const CaptureSettings& actual : {narrow, low, longer, loud, broken})
        EXPECT_TRUE(first_difference(wanted, actual, 0.5));
    EXPECT_EQ(first_difference(wanted, longer, 0.5)->request, "set exposure 7000 us");
    EXPECT_EQ(first_difference(wanted, longer, 0.5)->cause, "the device uses 7005 us");
    EXPECT_FALSE(first_difference(wanted, longer, 7.0)) << "within the device's own step";
}

TEST(SettingDifference, IsFoundInFormatBlackLevelTriggerAndControls) {
    const CaptureSettings wanted{.bits = 12,
                                 .format = "Mono12p",
                                 .black_level = 7.0,
                                 .trigger = "Line1",
                                 .controls = {{"Gamma", 0.7}, {"Sharpness", 0.0}}};
    EXPECT_FALSE(first_difference(wanted, wanted, 0.5));
    CaptureSettings shallow = wanted, packed = wanted, darker = wanted, unknown = wanted,
                    free = wanted, sharper = wanted, without = wanted;
    shallow.bits = 10;
    packed.format = "Mono12Packed";
    darker.black_level = 5.0;
    unknown.black_level.reset();
    free.trigger = "none";
    sharper.controls["Sharpness"] = 3.0;
    without.controls.erase("Gamma");
    for (const CaptureSettings& actual : {shallow, packed, darker, unknown, free, sharper, without})
        EXPECT_TRUE(first_difference(wanted, actual, 0.5));
    EXPECT_EQ(first_difference(wanted, unknown, 0.5)->cause, "the device has none");
    EXPECT_EQ(first_difference(wanted, sharper, 0.5)->cause, "the device uses 3");
}

TEST(SettingDifference, IgnoresWhatWasLeftToTheDevice) {
    const CaptureSettings actual{.width = 67,
                                 .height = 41,
                                 .format = "Mono8",
                                 .exposure = 7000us,
                                 .black_level = 7.0,
                                 .trigger = "Software"};
    EXPECT_FALSE(first_difference({}, actual, 0.5));
}

TEST(FrameChecks, SaysWhichCodesAreTooLargeForTheirBits) {
    const CodeImage image{cv::Mat(3, 5, CV_16UC1, cv::Scalar(4096)), 12};
    EXPECT_NE(code_fault(image, *find_pfnc_format("Mono12")).find("above 4095"), std::string::npos);
    EXPECT_EQ(code_fault({image.pixels, 13}, *find_pfnc_format("Mono16")), "");
    EXPECT_EQ(code_fault(image, *find_pfnc_format("Mono12p")), "");
}

// A camera whose frames break now and then also loses one without a trace: it is not gone.
TEST(FrameChecks, ReturnsTheLastFrameThatCameAtAll) {
    CaptureStatistics counts;
    std::vector<FrameStatus> script = {FrameStatus::timed_out, FrameStatus::short_frame,
                                       FrameStatus::corrupt, FrameStatus::timed_out};
    std::size_t taken = 0;
    const auto take = [&] {
        Frame frame;
        frame.status = script.at(taken++);
        return frame;
    };
    EXPECT_EQ(first_complete_frame(3, counts, take).status, FrameStatus::corrupt);
    EXPECT_EQ(counts.rejected, 4);
    script.assign(2, FrameStatus::timed_out);
    taken = 0;
    EXPECT_EQ(first_complete_frame(1, counts, take).status, FrameStatus::timed_out);
}

TEST(FrameChecks, TakesFramesUntilOneIsComplete) {
    CaptureStatistics counts;
    int taken = 0;
    const auto take = [&] {
        Frame frame;
        frame.status = ++taken == 3 ? FrameStatus::complete : FrameStatus::corrupt;
        return frame;
    };
    EXPECT_EQ(first_complete_frame(1, counts, take).status, FrameStatus::corrupt);
    EXPECT_EQ(first_complete_frame(4, counts, take).status, FrameStatus::complete);
    EXPECT_EQ(taken, 3);
    EXPECT_EQ(counts.rejected, 2);
    EXPECT_EQ(counts.delivered, 1);
}

}  // namespace
}  // namespace etalon
