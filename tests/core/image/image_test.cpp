#include "core/image/image.h"

#include "tests/test.h"

namespace etalon {
namespace {

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
