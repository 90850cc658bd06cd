// Chunks and PTP over GigE Vision on loopback: what a frame says of itself against what was asked,
// and what becomes of frames whose chunks cannot be true.

#include "mocks/camera/gige_description.h"
#include "tests/loopback/gige_rig.h"

namespace etalon {
namespace {

constexpr int width = 68, height = 41;

GigeCameraOptions sensor(std::uint16_t payload_type) {
    return {.width = width, .height = height, .chunk_payload_type = payload_type};
}

using Payload = std::vector<std::uint8_t>;
using Values = GigeChunkValues;

class GenicamChunks : public testing::Test {
protected:
    void start(std::uint16_t payload_type = image_with_chunks) {
        camera_.reset();
        rig_.reset();  // its port is taken until then
        rig_ = std::make_unique<GigeRig>(sensor(payload_type));
        camera_ = rig_->open();
        wanted_.exposure = 7000us;
        wanted_.gain_db = 5.0;
        camera_->configure(wanted_);
        camera_->arm();
    }
    Frame frame() { return camera_->frame_after(rig_->clock_.now(), 0, {}); }

    void expect_whole(const Frame& frame) {
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_TRUE(same(frame.image.pixels, rig_->shown().pixels));
    }
    // A frame whose chunks say what `alter` makes of them is refused for the reason, and only it.
    void expect_refused(const std::function<void(Values&)>& alter, const std::string& reason) {
        expect_whole(frame());
        rig_->device_->alter_chunk_values(alter);
        expect_next_corrupt(reason);
        rig_->device_->alter_chunk_values(nullptr);
        expect_whole(frame());
    }
    void expect_corrupt(const std::function<void(Payload&)>& alter, const std::string& reason) {
        rig_->device_->alter_payload(alter);
        expect_next_corrupt(reason);
        rig_->device_->alter_payload(nullptr);
        expect_whole(frame());
    }
    void expect_next_corrupt(const std::string& reason) {
        const Frame refused = frame();
        EXPECT_EQ(refused.status, FrameStatus::corrupt) << reason;
        EXPECT_THAT(refused.status_detail, HasSubstr(reason));
        EXPECT_TRUE(refused.image.pixels.empty());
    }

    std::unique_ptr<GigeRig> rig_;
    std::unique_ptr<Camera> camera_;
    CaptureSettings wanted_;
};

TEST_F(GenicamChunks, AreTakenOffEveryKindOfPayload) {
    for (const std::uint16_t type : {image_with_chunks, chunks_only, extended_chunk_payload}) {
        start(type);
        for (int i = 0; i < 10; ++i) {
            rig_->show(picture(width, height, 8, i));
            const Frame taken = frame();
            expect_whole(taken);
            EXPECT_EQ(taken.settings.exposure, 7000us);
        }
        EXPECT_EQ(camera_->statistics().skipped, 0) << type;
    }
}

// 84 bytes of chunks in packets of 1364: everywhere at a packet's border.
TEST_F(GenicamChunks, AreTakenOffEveryFormatBitForBit) {
    rig_ = std::make_unique<GigeRig>(sensor(image_with_chunks));
    camera_ = rig_->open();
    for (const auto& [format, bits] : std::vector<std::pair<std::string, int>>{
             {"Mono8", 8}, {"Mono12", 12}, {"Mono12p", 12}, {"Mono10Packed", 10}, {"Mono16", 16}})
        for (const int lines : {20, 30, 41}) {
            wanted_.format = format;
            wanted_.bits = bits;
            wanted_.height = lines;
            camera_->configure(wanted_);
            camera_->arm();
            rig_->show(picture(width, height, bits, lines));
            const Frame taken = frame();
            ASSERT_EQ(taken.status, FrameStatus::complete) << format << taken.status_detail;
            EXPECT_TRUE(same(taken.image.pixels, rig_->shown().pixels.rowRange(0, lines)));
            camera_->disarm();
        }
}

TEST_F(GenicamChunks, RefuseAFrameThatWasTakenWithAnotherExposure) {
    start();
    expect_refused([](Values& values) { values.exposure_us = 7008.0; },
                   "an exposure of 7008 us, not 7000 us");
    expect_refused([](Values& values) { values.exposure_us = NAN; }, "exposure of nan");
    rig_->device_->alter_chunk_values([](Values& values) { values.exposure_us = 7006.5; });
    expect_whole(frame());  // less than a thousandth
}

TEST_F(GenicamChunks, RefuseAFrameThatWasTakenWithAnotherGain) {
    start();
    expect_refused([](Values& values) { values.gain_db = 5.1; }, "a gain of 5.1 dB, not 5 dB");
}

TEST_F(GenicamChunks, RefuseAFrameWhoseTimeStampsDisagree) {
    start();
    const std::uint64_t allowed = 8'000'000;  // the exposure and 1 ms
    expect_refused([&](Values& values) { values.timestamp_ns -= allowed + 1; },
                   "lies -8000001 ns from the other");
    expect_refused([&](Values& values) { values.timestamp_ns += allowed + 1; },
                   "lies 8000001 ns from the other");
    rig_->device_->alter_chunk_values([&](Values& values) { values.timestamp_ns -= allowed; });
    expect_whole(frame());
}

// Frames of before: the number stays, or advances less than the stream's.
TEST_F(GenicamChunks, RefuseAFrameWithTheChunksOfAnother) {
    for (const std::uint64_t behind : {1, 70}) {
        start();
        expect_refused([&](Values& values) { values.frame_id -= behind; }, "of another frame");
        // The frame after it, counted from its number.
        EXPECT_EQ(camera_->statistics().skipped, long(behind));
    }
}

TEST_F(GenicamChunks, RefuseAFrameWithAnImpossibleNumber) {
    start();
    expect_whole(frame());
    rig_->device_->alter_chunk_values([](Values& values) { values.frame_id = ~0ull / 2; });
    EXPECT_THAT(frame().status_detail, HasSubstr("of another frame"));
    rig_->device_->alter_chunk_values(nullptr);
    EXPECT_EQ(frame().status, FrameStatus::corrupt);  // since it comes after the impossible one
    expect_whole(frame());
    EXPECT_EQ(camera_->statistics().skipped, 0);
}

TEST_F(GenicamChunks, CountExposuresThatWereNeverSent) {
    start();
    expect_whole(frame());
    rig_->device_->alter_chunk_values([](Values& values) { values.frame_id += 3; });
    expect_whole(frame());
    EXPECT_EQ(camera_->statistics().skipped, 3);
}

TEST_F(GenicamChunks, TryAgainUntilAFrameIsAsAsked) {
    start();
    int wrong = 3;
    rig_->device_->alter_chunk_values([&](Values& values) {
        if (wrong-- > 0)
            values.exposure_us = 9000.0;
    });
    const Frame taken = camera_->frame_after(rig_->clock_.now(), 5, {});
    expect_whole(taken);
    EXPECT_EQ(camera_->statistics().rejected, 3);
}

// The last chunk is the frame's number, whose length is in the last four bytes.
TEST_F(GenicamChunks, OfAnImpossibleLayoutMakeAFrameCorrupt) {
    for (const std::uint16_t type : {image_with_chunks, chunks_only, extended_chunk_payload}) {
        start(type);
        expect_corrupt([](Payload& bytes) { bytes[bytes.size() - 4] = 0xff; }, "has a length of");
        expect_corrupt([](Payload& bytes) { bytes[bytes.size() - 1] += 1; }, "");
        expect_corrupt([](Payload& bytes) { bytes.resize(bytes.size() - 3); }, "");
        expect_corrupt([](Payload& bytes) { bytes.assign(bytes.size(), 0); }, "more than 256");
        expect_corrupt([](Payload& bytes) { bytes.resize(7); }, "");
    }
}

TEST_F(GenicamChunks, ThatAreMissingOrTooShortMakeAFrameCorrupt) {
    start();
    expect_corrupt([](Payload& bytes) { bytes.resize(bytes.size() - 16); },
                   "ChunkFrameID: the chunk 0x1004 is missing");
    expect_corrupt([](Payload& bytes) { bytes[bytes.size() - 8] ^= 1; }, "is missing");
    expect_corrupt([](Payload& bytes) { bytes.resize(width * height); }, "is missing");
    expect_corrupt(
        [](Payload& bytes) {
            bytes.resize(bytes.size() - 16);
            append_chunk(bytes, frame_id_chunk.id, std::vector<std::uint8_t>(7));
        },
        "the chunk 0x1004 has 7 bytes, 8 are needed");
}

TEST_F(GenicamChunks, WithAnImageThatIsTooSmallMakeAFrameShort) {
    start(chunks_only);
    rig_->device_->alter_payload([](Payload& bytes) {
        Payload shorter;
        append_chunk(shorter, image_chunk_id, std::span(bytes).first(width * height - 1));
        bytes.erase(bytes.begin(), bytes.begin() + width * height + 8);
        shorter.insert(shorter.end(), bytes.begin(), bytes.end());
        bytes = shorter;
    });
    EXPECT_EQ(frame().status, FrameStatus::short_frame);
}

// Whatever comes: never a crash, never another picture than the one that was shown.
TEST_F(GenicamChunks, OfRandomDamageNeverGetThrough) {
    start();
    RandomStream random(7, 5);
    const std::size_t image = width * height;
    int refused = 0;
    for (int i = 0; i < 300; ++i) {
        rig_->device_->alter_payload([&](Payload& bytes) {
            for (int times = i % 5; times >= 0; --times)
                bytes[image + random.bits() % (bytes.size() - image)] ^= 1u << random.bits() % 8;
        });
        const Frame taken = frame();
        if (taken.status == FrameStatus::complete)
            EXPECT_TRUE(same(taken.image.pixels, rig_->shown().pixels));
        else
            ++refused;
    }
    EXPECT_GT(refused, 200);
}

TEST_F(GenicamChunks, CanBeSwitchedOffByName) {
    start();
    camera_->disarm();
    wanted_.controls["ChunkModeActive"] = 0.0;
    camera_->configure(wanted_);
    camera_->arm();
    rig_->device_->alter_chunk_values([](Values& values) { values.exposure_us = 1.0; });
    expect_whole(frame());
}

TEST_F(GenicamChunks, OfAnUnreadableKindAreSaidToBe) {
    start(extended_chunk_payload);
    rig_->device_->alter_chunk_values([](Values& values) { values.exposure_us = 1.0; });
    const Frame taken = frame();
    if (taken.status == FrameStatus::complete)  // what Aravis 0.8.26 makes of it
        EXPECT_THAT(camera_->remarks(), Contains(HasSubstr("cannot read the camera's chunks")));
    else
        EXPECT_THAT(taken.status_detail, HasSubstr("exposure of 1 us"));
}

// ---- PTP -------------------------------------------------------------------------------------

class GenicamPtp : public testing::Test {
protected:
    void start(const std::string& trigger, bool enabled = true) {
        camera_.reset();
        rig_.reset();
        rig_ = std::make_unique<GigeRig>(
            GigeCameraOptions{.width = width, .height = height, .latches = true, .ptp = true});
        camera_ = rig_->open();
        wanted_.exposure = 2000us;
        wanted_.trigger = trigger;
        if (trigger == "none")
            wanted_.controls["AcquisitionFrameRate"] = 50.0;
        if (enabled)
            wanted_.controls["PtpEnable"] = 1.0;
    }
    Frame frame() {
        camera_->configure(wanted_);
        camera_->arm();
        return again();
    }
    // On a busy machine the mock may latch its clock too late for a frame.
    TimeSource soon(Frame first) {
        for (int i = 0; i < 10 && first.time_source != TimeSource::device_clock; ++i)
            first = again();
        return first.time_source;
    }
    Frame again() {
        const Instant t = rig_->clock_.now();
        const Frame frame = camera_->frame_after(t, 3, {});
        EXPECT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, t);
        EXPECT_LT(frame.exposure_start, rig_->clock_.now());
        return frame;
    }

    std::unique_ptr<GigeRig> rig_;
    std::unique_ptr<Camera> camera_;
    CaptureSettings wanted_;
};

TEST_F(GenicamPtp, IsInTheRemarksWithTheOffsetOfASlave) {
    start("Software");
    rig_->device_->set_ptp("Slave", -350ns);
    EXPECT_EQ(soon(frame()), TimeSource::device_clock);
    EXPECT_THAT(camera_->remarks(),
                Contains("PTP: the camera's clock is Slave, -350 ns from its master's"));
}

TEST_F(GenicamPtp, LeavesTheClockOfAMasterAsGoodAsAnyOther) {
    start("none");
    rig_->device_->set_ptp("Master", 0ns);
    EXPECT_EQ(soon(frame()), TimeSource::device_clock);
    EXPECT_THAT(camera_->remarks(), Contains("PTP: the camera's clock is Master"));
}

TEST_F(GenicamPtp, DatesNoFrameByAClockThatIsAboutToBeSet) {
    for (const char* trigger : {"Software", "none"}) {
        start(trigger);
        rig_->device_->set_ptp("Uncalibrated", 0ns);
        EXPECT_EQ(frame().time_source, TimeSource::request) << trigger;
        EXPECT_THAT(camera_->remarks(), Contains(HasSubstr("no frame is dated by it")));
    }
}

// A run in which the master is lost and another one sets the clock.
TEST_F(GenicamPtp, FollowsTheStateDuringARun) {
    start("none");
    rig_->device_->set_ptp("Slave", 70ns);
    EXPECT_EQ(soon(frame()), TimeSource::device_clock);
    rig_->device_->set_ptp("Listening", 0ns);
    EXPECT_EQ(again().time_source, TimeSource::request);
    rig_->device_->jump_clock(-37s);  // TAI to UTC
    rig_->device_->set_ptp("Slave", 50ns);
    EXPECT_EQ(soon(again()), TimeSource::device_clock);
    EXPECT_THAT(camera_->remarks(), Contains(HasSubstr("Listening")));
}

TEST_F(GenicamPtp, IsLeftAsItIs) {
    start("Software", false);
    rig_->device_->set_ptp("Listening", 0ns);
    EXPECT_EQ(soon(frame()), TimeSource::device_clock);
    EXPECT_THAT(camera_->remarks(), Not(Contains(HasSubstr("PTP"))));
}

}  // namespace
}  // namespace etalon
