// Independent: OpenCV's own codecs, which read and write the same formats.
#include "core/image/picture_codec.h"

#include <zlib.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/image/image.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Bytes = std::vector<unsigned char>;

// A smooth picture with noise, wider than high, of any type of one or three channels.
cv::Mat picture(int type, int rows = 41, int cols = 67) {
    cv::Mat noise(rows, cols, type), smooth;
    cv::RNG random(7);
    random.fill(noise, cv::RNG::UNIFORM, 0.0,
                noise.depth() == CV_8U    ? 256.0
                : noise.depth() == CV_16U ? 65536.0
                                          : 1.0);
    cv::GaussianBlur(noise, smooth, {}, 2.0);
    return smooth;
}

Bytes by_opencv(const std::string& extension, const cv::Mat& image,
                const std::vector<int>& parameters = {}) {
    Bytes bytes;
    EXPECT_TRUE(cv::imencode(extension, image, bytes, parameters)) << extension;
    return bytes;
}

constexpr int as_the_sensor_has_it =
    cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION;

void expect_same(const cv::Mat& a, const cv::Mat& b, const std::string& what) {
    ASSERT_EQ(a.type(), b.type()) << what;
    ASSERT_EQ(a.size(), b.size()) << what;
    EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0.0) << what;
}

std::string cause_of(const Bytes& bytes) {
    return text_of_error<Error>([&] { decode_picture(bytes); });
}

TEST(PictureCodec, WritesTheBytesThatOpenCvWrites) {
    for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4})
        EXPECT_EQ(encode_png(picture(type)), by_opencv(".png", picture(type))) << type;
    for (const int type : {CV_8UC1, CV_8UC3})
        for (const int quality : {1, 60, 95, 100})
            EXPECT_EQ(encode_jpeg(picture(type), quality),
                      by_opencv(".jpg", picture(type), {cv::IMWRITE_JPEG_QUALITY, quality}))
                << type << ' ' << quality;
}

TEST(PictureCodec, ReadsThePixelsThatOpenCvReads) {
    for (const auto& [extension, types] : std::map<std::string, std::vector<int>>{
             {".png", {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3}},
             {".jpg", {CV_8UC1, CV_8UC3}},
             {".tiff", {CV_8UC1, CV_16UC1, CV_32FC1, CV_8UC3, CV_16UC3}},
             {".bmp", {CV_8UC1, CV_8UC3}}})
        for (const int type : types) {
            const Bytes bytes = by_opencv(extension, picture(type));
            expect_same(decode_picture(bytes), cv::imdecode(bytes, as_the_sensor_has_it),
                        extension + ' ' + std::to_string(type));
        }
}

TEST(PictureCodec, ReadsJpegsOfEveryLayoutAsOpenCvDoes) {
    const cv::Mat colours = picture(CV_8UC3);
    for (const std::vector<int>& layout :
         {std::vector<int>{cv::IMWRITE_JPEG_PROGRESSIVE, 1},
          std::vector<int>{cv::IMWRITE_JPEG_OPTIMIZE, 1, cv::IMWRITE_JPEG_RST_INTERVAL, 3}}) {
        const Bytes bytes = by_opencv(".jpg", colours, layout);
        expect_same(decode_picture(bytes), cv::imdecode(bytes, as_the_sensor_has_it), "colours");
        expect_same(decode_jpeg_luma(bytes), cv::imdecode(bytes, cv::IMREAD_GRAYSCALE), "luma");
    }
}

// PNG 1.2, 11: a chunk of a length, a name, data and their CRC.
void append_chunk(Bytes& png, const std::string& name, const Bytes& data) {
    Bytes named(name.begin(), name.end());
    named.insert(named.end(), data.begin(), data.end());
    const auto append_word = [&png](unsigned long word) {
        for (const int shift : {24, 16, 8, 0})
            png.push_back(static_cast<unsigned char>(word >> shift));
    };
    append_word(data.size());
    png.insert(png.end(), named.begin(), named.end());
    append_word(crc32(0, named.data(), static_cast<unsigned>(named.size())));
}

// A PNG of 19 x 7 px with this depth and type of colour, in which every bit of a row is used.
Bytes small_png(int bits, int colour_type, int samples, const Bytes& transparent = {},
                int width = 19, int height = 7) {
    const int row = (19 * samples * bits + 7) / 8;
    Bytes raw;
    for (int i = 0; i < 7 * (row + 1); ++i)
        raw.push_back(i % (row + 1) == 0 ? 0 : static_cast<unsigned char>(37 * i + i / 5));
    Bytes packed(compressBound(raw.size()));
    unsigned long size = packed.size();
    compress(packed.data(), &size, raw.data(), raw.size());
    packed.resize(size);
    const auto byte = [](int value) { return static_cast<unsigned char>(value); };
    Bytes png{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    append_chunk(png, "IHDR",
                 {byte(width >> 24), byte(width >> 16), byte(width >> 8), byte(width),
                  byte(height >> 24), byte(height >> 16), byte(height >> 8), byte(height),
                  byte(bits), byte(colour_type), 0, 0, 0});
    if (colour_type == 3) {
        Bytes palette;
        for (int i = 0; i < 3 << bits; ++i)
            palette.push_back(byte(91 * i + 13));
        append_chunk(png, "PLTE", palette);
    }
    if (!transparent.empty())
        append_chunk(png, "tRNS", transparent);
    append_chunk(png, "IDAT", packed);
    append_chunk(png, "IEND", {});
    return png;
}

// Gray 0, RGB 2, palette 3, gray with alpha 4, RGB with alpha 6: with their bits and samples. What
// is read in colour has equal channels where OpenCV makes three of gray and alpha.
TEST(PictureCodec, ReadsPngsOfEveryDepthAndColourAsOpenCvDoes) {
    struct Kind {
        int bits, colour_type, samples;
        Bytes transparent;
    };
    for (const Kind& kind :
         {Kind{1, 0, 1, {}}, Kind{2, 0, 1, {}}, Kind{4, 0, 1, {}}, Kind{8, 0, 1, {}},
          Kind{16, 0, 1, {}}, Kind{8, 0, 1, {0, 5}}, Kind{16, 0, 1, {1, 5}}, Kind{8, 2, 3, {}},
          Kind{16, 2, 3, {}}, Kind{8, 2, 3, {0, 1, 0, 2, 0, 3}}, Kind{1, 3, 1, {}},
          Kind{2, 3, 1, {}}, Kind{4, 3, 1, {7, 99}}, Kind{8, 3, 1, {}}, Kind{8, 4, 2, {}},
          Kind{16, 4, 2, {}}, Kind{8, 6, 4, {}}, Kind{16, 6, 4, {}}}) {
        const Bytes png = small_png(kind.bits, kind.colour_type, kind.samples, kind.transparent);
        cv::Mat theirs = cv::imdecode(png, as_the_sensor_has_it);
        if (kind.colour_type == 4)
            cv::extractChannel(theirs, theirs, 1);
        expect_same(decode_picture(png), theirs,
                    std::to_string(kind.bits) + " bits, type " + std::to_string(kind.colour_type));
    }
}

TEST(PictureCodec, WritesAndReadsTiffToTheLastBit) {
    for (const int type : {CV_8UC1, CV_16UC1, CV_32FC1}) {
        const Bytes bytes = encode_picture(".TIF", picture(type, 300, 211));
        expect_same(decode_picture(bytes), picture(type, 300, 211), std::to_string(type));
        expect_same(cv::imdecode(bytes, as_the_sensor_has_it), picture(type, 300, 211),
                    std::to_string(type));
    }
}

// Its three parts of a picture are read one by one.
TEST(PictureCodec, ReadsPartsOfAPictureThatIsAView) {
    const cv::Mat whole = picture(CV_8UC1, 50, 60), part = whole(cv::Rect(11, 5, 23, 31));
    expect_same(decode_picture(encode_png(part)), part, "PNG");
    expect_same(decode_picture(encode_picture(".tiff", part)), part, "TIFF");
}

// 74 bytes that ask for 8 GB, and a few bytes that claim what they cannot hold.
TEST(PictureCodec, RefusesASizeBeforeItTakesMemory) {
    EXPECT_THAT(cause_of(small_png(16, 2, 3, {}, 65000, 20000)),
                HasSubstr("268435456 px are the most"));
    EXPECT_THAT(cause_of(small_png(8, 0, 1, {}, 9000, 9000)), HasSubstr("do not fit its"));
    Bytes jpeg = by_opencv(".jpg", picture(CV_8UC1));
    const Bytes frame{0xff, 0xc0, 0, 11, 8};
    const auto size = std::search(jpeg.begin(), jpeg.end(), frame.begin(), frame.end()) + 5;
    ASSERT_LT(size - jpeg.begin(), static_cast<long>(jpeg.size()));
    std::fill_n(size, 4, 0xf0);
    EXPECT_THAT(cause_of(jpeg), HasSubstr("61680 x 61680 px"));
}

TEST(PictureCodec, SaysWhatIsDamaged) {
    for (const std::string extension : {".png", ".tiff", ".bmp"}) {
        Bytes bytes = by_opencv(extension, picture(CV_16UC1));
        if (extension == ".bmp")
            bytes = by_opencv(extension, picture(CV_8UC3));
        bytes.resize(bytes.size() / 2);
        EXPECT_NE(cause_of(bytes), "no error") << extension;
    }
    EXPECT_EQ(cause_of({}), "is not an image that can be read");
    EXPECT_THROW(encode_picture(".nosuchformat", picture(CV_8UC1)), Error);
    EXPECT_THROW(encode_picture(".png", {}), Error);
}

// ---- image

std::filesystem::path temporary(const std::string& name) {
    static const TemporaryFolder folder;
    return folder / name;
}

TEST(Image, SixteenBitCodesSurvivePngAndTiff) {
    cv::Mat pixels(5, 7, CV_16UC1);
    for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 7; ++x)
            pixels.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(9001 * (x + 1) + 7 * y);
    for (const char* extension : {"codes.png", "codes.tiff"}) {
        write_image(temporary(extension), {pixels, 16});
        const CodeImage back = read_image(temporary(extension));
        EXPECT_EQ(back.bits, 16);
        EXPECT_EQ(cv::norm(back.pixels, pixels, cv::NORM_INF), 0.0) << extension;
    }
}

TEST(Image, RadianceSurvivesTiffToTheLastBit) {
    cv::Mat radiance(3, 4, CV_32FC1);
    cv::randu(radiance, 0.0f, 1.0f);
    write_radiance(temporary("radiance.tiff"), radiance);
    EXPECT_EQ(cv::norm(read_radiance(temporary("radiance.tiff")), radiance, cv::NORM_INF), 0.0);
}

TEST(Image, RefusesWhatIsNoImageAndNamesTheFile) {
    const auto path = temporary("text.png");
    std::ofstream(path) << "not a picture";
    EXPECT_TRUE(has(config_error_of([&] { read_image(path); }), "text.png"));
    EXPECT_THROW(read_image(temporary("missing.png")), ConfigError);
}

// An APP1 segment with an Exif structure of one tag, Orientation (CIPA DC-008, 4.6.2), either way
// round.
Bytes marked_jpeg(unsigned char orientation, bool low_first) {
    const Bytes low = {0xff, 0xe1, 0, 34, 'E',         'x', 'i', 'f', 0,    0, 'I', 'I',
                       '*',  0,    8, 0,  0,           0,   1,   0,   0x12, 1, 3,   0,
                       1,    0,    0, 0,  orientation, 0,   0,   0,   0,    0, 0,   0};
    const Bytes high = {0xff, 0xe1, 0, 34, 'E', 'x',         'i', 'f', 0, 0,    'M', 'M',
                        0,    '*',  0, 0,  0,   8,           0,   1,   1, 0x12, 0,   3,
                        0,    0,    0, 1,  0,   orientation, 0,   0,   0, 0,    0,   0};
    Bytes bytes = by_opencv(".jpg", picture(CV_8UC1));
    const Bytes& segment = low_first ? low : high;
    bytes.insert(bytes.begin() + 2, segment.begin(), segment.end());
    return bytes;
}

TEST(Image, TellsWhatViewersShowRotatedAndReadsItAsTheSensorHasIt) {
    const TemporaryFolder folder;
    const auto put = [&](const Bytes& bytes) {
        write_text(folder / "a.jpg", {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
        return folder / "a.jpg";
    };
    const Bytes plain = by_opencv(".jpg", picture(CV_8UC1));
    const CodeImage image = read_image(put(plain));
    EXPECT_FALSE(is_marked_rotated(put(plain)));
    for (const bool low_first : {true, false})
        for (const int orientation : {0, 1, 2, 3, 6, 8, 9}) {
            const auto file = put(marked_jpeg(static_cast<unsigned char>(orientation), low_first));
            EXPECT_EQ(is_marked_rotated(file), orientation > 1 && orientation < 9) << orientation;
            expect_same(read_image(file).pixels, image.pixels, "rotated");
        }
    Bytes cut = marked_jpeg(6, true);
    cut.resize(2 + 24);  // within the structure
    EXPECT_FALSE(is_marked_rotated(put(cut)));
    EXPECT_FALSE(is_marked_rotated(folder / "none.jpg"));
}

// What follows is no element of DICOM: its reader would end the program.
TEST(Image, RefusesDicom) {
    const auto path = temporary("scan.png");
    std::ofstream(path) << std::string(128, '\0') << "DICM" << std::string(40, '\xff');
    EXPECT_TRUE(has(config_error_of([&] { read_image(path); }), "is DICOM"));
}

// OpenCV decodes one as far as it goes, gray below. The thumbnail in front has an end of its own,
// and what cameras write behind the picture is no part of it.
TEST(Image, RefusesAJpegThatEndsEarly) {
    cv::Mat pixels(64, 48, CV_8UC1);
    cv::randu(pixels, 0, 255);
    write_image(temporary("whole.jpg"), {pixels, 8});
    const std::string whole = read_bytes(temporary("whole.jpg"));
    const std::string thumbnail("\xff\xe1\x00\x06\xff\xd8\xff\xd9", 8);
    const std::string photo = whole.substr(0, 2) + thumbnail + whole.substr(2);
    const auto read = [](const std::string& bytes) {
        std::ofstream(temporary("photo.jpg"), std::ios::binary) << bytes;
        return read_image(temporary("photo.jpg")).pixels;
    };
    EXPECT_EQ(cv::norm(read(photo + "trailer"), read(whole), cv::NORM_INF), 0.0);
    for (const std::size_t cut : {std::size_t{2}, photo.size() / 2, photo.size() - 40})
        EXPECT_THROW(read(photo.substr(0, photo.size() - cut)), ConfigError) << cut;
}

TEST(Image, LeavesNothingBehindWhenItCannotWrite) {
    const auto folder = temporary("folder");
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    EXPECT_THROW(write_image(folder / "image.nosuchformat", {cv::Mat::zeros(2, 3, CV_8UC1), 8}),
                 ConfigError);
    EXPECT_TRUE(std::filesystem::is_empty(folder));
}

}  // namespace
}  // namespace etalon
