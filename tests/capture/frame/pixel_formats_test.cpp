// Truth here is a second unpacker, which looks up every single bit of a pixel where the format's
// document places it.
#include "capture/frame/pixel_formats.h"

#include <opencv2/imgcodecs.hpp>
#include <random>

#include "tests/test.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes random_bytes(std::size_t count, unsigned seed) {
    std::mt19937 generator(seed);
    Bytes bytes(count);
    for (std::uint8_t& byte : bytes)
        byte = static_cast<std::uint8_t>(generator() >> 11);
    return bytes;
}

struct BitPlace {
    std::size_t byte;
    std::size_t bit;  // 0 is the least significant
};

// Where bit `b` of the pixel with index `x` of a line (or of a run-on image) lies.
BitPlace place_of_bit(const PixelFormat& f, std::size_t x, std::size_t b) {
    const std::size_t bits = static_cast<std::size_t>(f.bits), low = bits - 8;
    switch (f.packing) {
        case PixelPacking::bytes:
            return {x, b};
        case PixelPacking::words_low:
            return {2 * x + (f.big_endian ? 1 - b / 8 : b / 8), b % 8};
        case PixelPacking::words_high:
            return {2 * x + (b + 16 - bits) / 8, (b + 16 - bits) % 8};
        case PixelPacking::bit_stream:
            return {(x * bits + b) / 8, (x * bits + b) % 8};
        case PixelPacking::gige_pairs:  // the second byte: low bits of the first from bit 0, of the
            if (b >= low)               // second from bit 4
                return {x / 2 * 3 + (x % 2) * 2, b - low};
            return {x / 2 * 3 + 1, (x % 2) * 4 + b};
        case PixelPacking::mipi_csi2: {
            const std::size_t group = bits == 10 ? 4 : 2;
            if (b >= low)
                return {x / group * (group + 1) + x % group, b - low};
            return {x / group * (group + 1) + group, x % group * low + b};
        }
        case PixelPacking::luma_first:
            return {2 * x, b};
        case PixelPacking::luma_second:
            return {2 * x + 1, b};
        case PixelPacking::jpeg:
            break;
    }
    ADD_FAILURE();
    return {0, 0};
}

int code_at(const PixelFormat& f, const std::uint8_t* line, std::size_t x) {
    // The unused bits of a word in whose low bits the code lies are kept: they are to be 0.
    const int bits = f.packing == PixelPacking::words_low ? 16 : f.bits;
    int code = 0;
    for (int b = 0; b < bits; ++b) {
        const BitPlace place = place_of_bit(f, x, static_cast<std::size_t>(b));
        code |= (line[place.byte] >> place.bit & 1) << b;
    }
    return code;
}

int code_of(const CodeImage& image, int x, int y) {
    return image.pixels.depth() == CV_8U ? image.pixels.at<std::uint8_t>(y, x)
                                         : image.pixels.at<std::uint16_t>(y, x);
}

void expect_codes(const PixelFormat& f, const RawImage& raw, const CodeImage& image) {
    ASSERT_EQ(image.pixels.size(), cv::Size(raw.width, raw.height));
    ASSERT_EQ(image.bits, f.bits);
    ASSERT_EQ(image.pixels.type(), f.bits <= 8 ? CV_8UC1 : CV_16UC1);
    const bool packed =
        f.packing == PixelPacking::bit_stream || f.packing == PixelPacking::gige_pairs;
    const bool run_on = raw.bytes_per_line == 0 && packed;
    const std::size_t distance = raw.bytes_per_line ? raw.bytes_per_line : line_bytes(f, raw.width);
    const std::size_t width = static_cast<std::size_t>(raw.width);
    for (int y = 0; y < raw.height; ++y)
        for (int x = 0; x < raw.width; ++x) {
            const std::size_t line = static_cast<std::size_t>(y),
                              column = static_cast<std::size_t>(x);
            const int truth = run_on ? code_at(f, raw.data.data(), line * width + column)
                                     : code_at(f, raw.data.data() + line * distance, column);
            ASSERT_EQ(code_of(image, x, y), truth) << "pixel " << x << "," << y;
        }
}

class EveryFormat : public testing::TestWithParam<PixelFormat> {};

TEST_P(EveryFormat, UnpacksRandomDataAsItsDocumentSays) {
    const PixelFormat& format = GetParam();
    for (const int width : {1, 2, 3, 4, 5, 6, 7, 13, 67}) {
        const std::size_t line = line_bytes(format, width);
        for (const std::size_t bytes_per_line : {std::size_t{0}, line, line + 1, line + 7}) {
            const std::size_t size = image_bytes(format, width, 5, bytes_per_line);
            const Bytes data = random_bytes(size, static_cast<unsigned>(width) * 71u);
            const RawImage raw{data, width, 5, bytes_per_line};
            CodeImage image;
            SCOPED_TRACE(testing::Message() << width << " px, line of " << bytes_per_line);
            ASSERT_EQ(unpack(format, raw, image), "");
            expect_codes(format, raw, image);
        }
    }
}

TEST_P(EveryFormat, RefusesDataThatAreShort) {
    const PixelFormat& format = GetParam();
    for (const std::size_t padding : {std::size_t{0}, std::size_t{3}}) {
        const std::size_t bytes_per_line = padding ? line_bytes(format, 7) + padding : 0;
        const std::size_t needed = image_bytes(format, 7, 5, bytes_per_line);
        for (std::size_t size = 0; size < needed; ++size) {
            const Bytes data = random_bytes(size, 5);
            CodeImage image{cv::Mat(5, 7, CV_8UC1), 8};
            const std::string fault = unpack(format, {data, 7, 5, bytes_per_line}, image);
            EXPECT_NE(fault.find(std::to_string(needed)), std::string::npos) << fault;
            EXPECT_TRUE(image.pixels.empty());
        }
    }
}

TEST_P(EveryFormat, RefusesLinesShorterThanTheirPixels) {
    const PixelFormat& format = GetParam();
    const Bytes data = random_bytes(1000, 5);
    CodeImage image;
    EXPECT_NE(unpack(format, {data, 7, 5, line_bytes(format, 7) - 1}, image), "");
}

std::vector<PixelFormat> uncompressed_formats() {
    std::vector<PixelFormat> formats;
    for (const PixelFormat& format : pixel_formats())
        if (!format.lossy())
            formats.push_back(format);
    PixelFormat high = *find_pfnc_format("Mono16");  // a camera that departs from the table
    high.packing = PixelPacking::words_high;
    high.bits = 10;
    formats.push_back(high);
    return formats;
}

std::string test_name(const testing::TestParamInfo<PixelFormat>& info) {
    std::string name;
    for (const char c : std::to_string(info.index) + "_" + std::string(info.param.name()))
        name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
    return name;
}

INSTANTIATE_TEST_SUITE_P(PixelFormats, EveryFormat, testing::ValuesIn(uncompressed_formats()),
                         test_name);

// By hand, so that the second unpacker has a witness too: codes 0xABC and 0x123.
TEST(PixelFormats, TellTheThreeTwelveBitPackingsApart) {
    const auto unpacked = [](const PixelFormat* format, const Bytes& data) {
        CodeImage image;
        EXPECT_EQ(unpack(*format, {data, 2, 1, 0}, image), "");
        return std::pair(code_of(image, 0, 0), code_of(image, 1, 0));
    };
    const std::pair codes(0xABC, 0x123);
    EXPECT_EQ(unpacked(find_pfnc_format("Mono12p"), {0xBC, 0x3A, 0x12}), codes);
    EXPECT_EQ(unpacked(find_pfnc_format("Mono12Packed"), {0xAB, 0x3C, 0x12}), codes);
    EXPECT_EQ(unpacked(find_v4l2_format("Y12P"), {0xAB, 0x12, 0x3C}), codes);
    EXPECT_EQ(unpacked(find_v4l2_format("Y012"), {0xC0, 0xAB, 0x30, 0x12}), codes);
}

TEST(PixelFormats, TellTheThreeTenBitPackingsApart) {
    const Bytes p{0xCD, 0x8E, 0x04, 0x41, 0xC0};  // 0x2CD 0x123 0x010 0x301
    const Bytes mipi{0xB3, 0x48, 0x04, 0xC0, 0b01'00'11'01};
    const Bytes packed{0xB3, 0b00'11'00'01, 0x48, 0x04, 0b00'01'00'00, 0xC0};
    for (const auto& [format, data] :
         {std::pair(find_pfnc_format("Mono10p"), p), std::pair(find_v4l2_format("Y10P"), mipi),
          std::pair(find_pfnc_format("Mono10Packed"), packed)}) {
        CodeImage image;
        ASSERT_EQ(unpack(*format, {data, 4, 1, 0}, image), "");
        EXPECT_EQ(code_of(image, 0, 0), 0x2CD) << format->name();
        EXPECT_EQ(code_of(image, 1, 0), 0x123) << format->name();
        EXPECT_EQ(code_of(image, 2, 0), 0x010) << format->name();
        EXPECT_EQ(code_of(image, 3, 0), 0x301) << format->name();
    }
}

TEST(PixelFormats, AreFoundByEachOfTheirNames) {
    ASSERT_TRUE(find_v4l2_format("Y12"));
    EXPECT_EQ(find_v4l2_format("Y12"), find_pfnc_format("Mono12"));
    EXPECT_EQ(find_v4l2_format("Y12"), find_libcamera_format("R12"));
    EXPECT_EQ(find_v4l2_format("Y12"), find_pfnc_format(0x01100005));
    ASSERT_TRUE(find_v4l2_format("BA10"));
    EXPECT_EQ(find_v4l2_format("BA10")->mosaic, Mosaic::grbg);
    EXPECT_TRUE(find_v4l2_format("Y16 -BE")->big_endian);
    EXPECT_TRUE(find_v4l2_format("MJPG")->lossy());
    EXPECT_FALSE(find_pfnc_format(""));
    EXPECT_FALSE(find_pfnc_format(0u));
    EXPECT_FALSE(find_v4l2_format("RGB3"));
    EXPECT_FALSE(find_libcamera_format(""));
}

TEST(PixelFormats, HaveNoNameTwice) {
    std::set<std::string_view> pfnc, v4l2, libcamera;
    std::set<std::uint32_t> codes;
    for (const PixelFormat& format : pixel_formats()) {
        EXPECT_FALSE(format.name().empty());
        EXPECT_TRUE(format.pfnc.empty() || pfnc.insert(format.pfnc).second) << format.pfnc;
        EXPECT_TRUE(!format.pfnc_code || codes.insert(format.pfnc_code).second) << format.pfnc;
        EXPECT_TRUE(format.v4l2.empty() || v4l2.insert(format.v4l2).second) << format.v4l2;
        EXPECT_TRUE(format.libcamera.empty() || libcamera.insert(format.libcamera).second)
            << format.libcamera;
    }
}

// Of the PFNC code, bits 16 to 23 are the bits that a pixel takes in memory.
TEST(PixelFormats, TakeTheSpaceThatTheirPfncCodesSay) {
    for (const PixelFormat& format : pixel_formats()) {
        if (format.pfnc_code == 0)
            continue;
        EXPECT_EQ(line_bytes(format, 16), (format.pfnc_code >> 16 & 0xFF) * 2) << format.pfnc;
    }
}

TEST(PixelFormats, RefuseMeasuresThatAreNone) {
    const Bytes data = random_bytes(100, 5);
    const PixelFormat* format = find_pfnc_format("Mono8");
    CodeImage image;
    EXPECT_NE(unpack(*format, {data, 0, 5, 0}, image), "");
    EXPECT_NE(unpack(*format, {data, 7, -5, 0}, image), "");
    PixelFormat wrong = *format;
    wrong.bits = 12;
    EXPECT_NE(unpack(wrong, {data, 7, 5, 0}, image), "");
}

TEST(PixelFormats, UseTheMemoryOfAnImageAgainButNotAPartOfAnother) {
    const Bytes data = random_bytes(35, 5);
    const PixelFormat* format = find_pfnc_format("Mono8");
    CodeImage image;
    ASSERT_EQ(unpack(*format, {data, 7, 5, 0}, image), "");
    const std::uint8_t* memory = image.pixels.data;
    ASSERT_EQ(unpack(*format, {data, 7, 5, 0}, image), "");
    EXPECT_EQ(image.pixels.data, memory);
    cv::Mat large(50, 50, CV_8UC1, cv::Scalar(3));
    image.pixels = large(cv::Rect(11, 13, 7, 5));
    ASSERT_EQ(unpack(*format, {data, 7, 5, 0}, image), "");
    EXPECT_EQ(cv::countNonZero(large != 3), 0);
}

// ---- JPEG: lossy, so the picture is smooth and compared within 4 codes ------------------------

cv::Mat smooth_picture() {
    cv::Mat picture(40, 56, CV_8UC1);
    for (int y = 0; y < picture.rows; ++y)
        for (int x = 0; x < picture.cols; ++x)
            picture.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(20 + 3 * x + y);
    return picture;
}

Bytes as_jpeg(const cv::Mat& picture) {
    Bytes data;
    cv::imencode(".jpg", picture, data, {cv::IMWRITE_JPEG_QUALITY, 95});
    return data;
}

TEST(Jpeg, IsDecodedToItsLuma) {
    Bytes data = as_jpeg(smooth_picture());
    data.resize(data.size() + 9, 0);  // as cameras pad
    CodeImage image;
    ASSERT_EQ(unpack(*find_v4l2_format("MJPG"), {data, 56, 40, 0}, image), "");
    EXPECT_EQ(image.bits, 8);
    EXPECT_LE(cv::norm(image.pixels, smooth_picture(), cv::NORM_INF), 4.0);
}

TEST(Jpeg, IsRefusedWhenCutOffAnywhere) {
    const Bytes whole = as_jpeg(smooth_picture());
    for (std::size_t size = 0; size < whole.size(); size += 7) {
        const Bytes part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
        CodeImage image;
        EXPECT_NE(unpack(*find_v4l2_format("MJPG"), {part, 56, 40, 0}, image), "") << size;
        EXPECT_TRUE(image.pixels.empty());
    }
}

// Found by random payloads: OpenCV takes it for DICOM, whose reader ends the program.
TEST(Jpeg, IsRefusedWhenItBeginsLikeOneOnly) {
    Bytes data(168, 0xFF);
    std::ranges::copy(std::array{0xFF, 0xD8, 0x00}, data.begin());
    std::ranges::copy(std::string_view("DICM"), data.begin() + 128);
    data.back() = 0xD9;
    CodeImage image;
    EXPECT_EQ(unpack(*find_v4l2_format("MJPG"), {data, 56, 40, 0}, image),
              "168 bytes are no whole JPEG image");
}

TEST(Jpeg, OfAnotherSizeIsRefused) {
    const Bytes data = as_jpeg(smooth_picture());
    CodeImage image;
    EXPECT_EQ(unpack(*find_v4l2_format("MJPG"), {data, 40, 56, 0}, image),
              "a JPEG image of 56x40, expected 40x56");
}

}  // namespace
}  // namespace etalon
