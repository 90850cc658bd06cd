#include <tbb/global_control.h>

#include <nlohmann/json.hpp>

#include "core/file/sha256.h"
#include "core/image/image.h"
#include "station/render/commands.h"
#include "station/render/image_set.h"
#include "tests/test.h"

namespace etalon {
namespace {

// A sharp camera of one pixel per mm at 100 mm, its axis through the middle of the image.
constexpr const char* pinhole =
    "etalon: camera/1\n"
    "image: {width: 80, height: 60}\n"
    "intrinsics: {fx: 100, fy: 100, cx: 39.5, cy: 29.5}\n";
constexpr const char* noisy_12_bits =
    "sensor: {pixel_pitch_um: 5, bits: 12, gain_e_per_dn: 2, read_noise_e: 6}\n";

class RenderCommand : public testing::Test {
protected:
    void SetUp() override {
        cells_ = (cv::Mat_<std::uint8_t>(2, 3) << 0, 51, 255, 102, 153, 204);
        write_image(folder_ / "cells.png", {cells_, 8});
        write_text(folder_ / "camera.yml", pinhole);
        arguments_.camera = folder_ / "camera.yml";
        arguments_.markers = {"bitmap:" + (folder_ / "cells.png").string() + "@30x20mm"};
        arguments_.poses = {"0,0,0,7,-5,100"};
        arguments_.out = folder_ / "out.png";
    }

    CodeImage rendered() const {
        EXPECT_EQ(run_render(arguments_), 0);
        return read_image(arguments_.out);
    }
    std::string printed() const {
        testing::internal::CaptureStdout();
        EXPECT_EQ(run_render(arguments_), 0);
        return testing::internal::GetCapturedStdout();
    }
    virtual std::string complaint() const {
        const std::string words = config_error_of([&] { run_render(arguments_); });
        EXPECT_EQ(words.find('\n'), std::string::npos);
        EXPECT_FALSE(std::filesystem::exists(arguments_.out));
        return words;
    }
    using Arguments = RenderArguments;
    void expect_refusal(void (*change)(Arguments&), const char* words) {
        const Arguments good = arguments_;
        change(arguments_);
        EXPECT_THAT(complaint(), HasSubstr(words));
        arguments_ = good;
    }

    TemporaryFolder folder_;
    cv::Mat cells_;
    RenderArguments arguments_;
};

// 30 x 20 px around (39.5 + 7, 29.5 - 5): columns 32..61 and rows 15..34.
void expect_cells(const cv::Mat& image, const cv::Mat& cells, double factor, double tolerance) {
    cv::Mat values;
    image.convertTo(values, CV_64F);
    for (int y = 0; y < 60; ++y) {
        for (int x = 0; x < 80; ++x) {
            const bool inside = x >= 32 && x < 62 && y >= 15 && y < 35;
            const double expected =
                inside ? cells.at<std::uint8_t>((y - 15) / 10, (x - 32) / 10) : 255.0;
            ASSERT_NEAR(values.at<double>(y, x), expected * factor, tolerance)
                << "pixel " << x << ", " << y;
        }
    }
}

TEST_F(RenderCommand, ShowsEveryCellWhereASharpCameraSeesIt) {
    expect_cells(rendered().pixels, cells_, 1.0, 0.5);
}

TEST_F(RenderCommand, WritesSixteenBitsForASensorOfMoreThanEight) {
    write_text(arguments_.camera, std::string(pinhole) + noisy_12_bits);
    const CodeImage image = rendered();
    EXPECT_EQ(image.pixels.type(), CV_16UC1);
    expect_cells(image.pixels, cells_, 4095.0 / 255.0, 2.0);
}

TEST_F(RenderCommand, WritesLinearRadianceAsFloat) {
    arguments_.linear = true;
    arguments_.out = folder_ / "out.tiff";
    EXPECT_EQ(run_render(arguments_), 0);
    expect_cells(read_radiance(arguments_.out), cells_, 1.0 / 255.0, 5e-4);
}

TEST_F(RenderCommand, GivesTheSameImageByEveryMethod) {
    write_text(arguments_.camera,
               "etalon: camera/1\n"
               "image: {width: 22, height: 16}\n"
               "intrinsics: {fx: 100, fy: 100, cx: 11, cy: 7}\n"
               "lens: {f_number: 8, focus_distance_mm: 90, wavelength_nm: 600}\n"
               "sensor: {pixel_pitch_um: 50}\n");
    arguments_.markers = {"bitmap:" + (folder_ / "cells.png").string() + "@12x9mm"};
    arguments_.poses = {"0.3,0.1,-0.2,1,-1,110"};
    std::vector<cv::Mat> images;
    for (const char* method : {"auto", "E", "C", "reference"}) {
        arguments_.method = method;
        // The reference is slow, and C's bound for so sharp a camera does not reach 0.1 gray; 0.4
        // is near enough to compare images to one code.
        const bool coarse = method == std::string("reference") || method == std::string("C");
        arguments_.tolerance_gray = coarse ? 0.4 : 0.1;
        images.push_back(rendered().pixels);
    }
    for (const cv::Mat& image : images)
        EXPECT_LE(cv::norm(image, images.back(), cv::NORM_INF), 1.0);
}

TEST_F(RenderCommand, DrawsTheSameNoiseForTheSameSeed) {
    write_text(arguments_.camera, std::string(pinhole) + noisy_12_bits);
    const cv::Mat clean = rendered().pixels;
    arguments_.noise_seed = 7;
    const cv::Mat first = rendered().pixels, again = rendered().pixels;
    EXPECT_EQ(cv::norm(first, again, cv::NORM_INF), 0.0);
    EXPECT_GT(cv::norm(first, clean, cv::NORM_INF), 20.0);
    arguments_.noise_seed = 5;
    EXPECT_GT(cv::norm(first, rendered().pixels, cv::NORM_INF), 20.0);
}

TEST_F(RenderCommand, TakesAForeignCalibrationAsASharpCamera) {
    arguments_.camera = folder_ / "opencv.yml";
    write_text(arguments_.camera,
               "%YAML:1.0\n---\nimage_width: 80\nimage_height: 60\n"
               "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
               "   data: [100., 0., 39.5, 0., 100., 29.5, 0., 0., 1.]\n"
               "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
               "   data: [0., 0., 0., 0., 0.]\n");
    expect_cells(rendered().pixels, cells_, 1.0, 0.5);
}

TEST_F(RenderCommand, SaysInJsonWhatItDid) {
    arguments_.json = true;
    const auto json = nlohmann::json::parse(printed());
    EXPECT_EQ(json["etalon"], "render/1");
    ASSERT_EQ(json["markers"].size(), 1u);
    EXPECT_EQ(json["markers"][0]["camera_from_marker"],
              nlohmann::json({0.0, 0.0, 0.0, 7.0, -5.0, 100.0}));
    EXPECT_EQ(json["bits"], 8);
    EXPECT_EQ(json["pixels_without_ray"], 0);
    EXPECT_NE(json["plan"]["summary"], "");
    EXPECT_EQ(json["plan"]["tolerance_gray"], 0.1);
    ASSERT_GE(json["plan"]["tiles"].size(), 1u);
    EXPECT_GT(json["plan"]["tiles"][0]["tiles"], 0);
}

TEST_F(RenderCommand, PaintsTheBackgroundAsToldAndScalesTheRadianceByTheExposure) {
    arguments_.background = "0.6";
    EXPECT_EQ(rendered().pixels.at<std::uint8_t>(3, 70), 153);
    arguments_.exposure = 1.3;
    const cv::Mat image = rendered().pixels;
    EXPECT_EQ(image.at<std::uint8_t>(3, 70), 199);   // 0.6 * 255 * 1.3 = 198.9
    EXPECT_EQ(image.at<std::uint8_t>(20, 47), 66);   // 51 * 1.3 = 66.3
    EXPECT_EQ(image.at<std::uint8_t>(30, 57), 255);  // 204 * 1.3 saturates
}

TEST_F(RenderCommand, PutsTheMarkerBeforeAnImage) {
    write_text(arguments_.camera, std::string(pinhole) +
                                      "sensor: {pixel_pitch_um: 5, bits: 8, transfer: rec709, "
                                      "black: 9, illumination: {cos4: true}}\n");
    cv::Mat stripes(60, 80, CV_8UC1);
    for (int x = 0; x < 80; ++x)
        stripes.col(x).setTo(x % 7 < 3 ? 30 : 170);
    write_image(folder_ / "stripes.png", {stripes, 8});
    const cv::Mat uniform = rendered().pixels;
    arguments_.background = (folder_ / "stripes.png").string();
    const cv::Mat image = rendered().pixels;
    for (int y = 0; y < 60; ++y)
        for (int x = 0; x < 80; ++x) {
            const bool inside = x >= 32 && x < 62 && y >= 15 && y < 35;
            ASSERT_NEAR(image.at<std::uint8_t>(y, x), (inside ? uniform : stripes).at<uchar>(y, x),
                        inside ? 1.0 : 0.0)
                << "pixel " << x << ", " << y;
        }
}

TEST_F(RenderCommand, RefusesABackgroundThatIsNotTheCameras) {
    write_image(folder_ / "turned.png", {cv::Mat(80, 60, CV_8UC1, cv::Scalar(5)), 8});
    write_image(folder_ / "deep.png", {cv::Mat(60, 80, CV_16UC1, cv::Scalar(5)), 16});
    arguments_.background = (folder_ / "turned.png").string();
    EXPECT_THAT(complaint(), HasSubstr("has 60 x 80 px, the camera 80 x 60"));
    arguments_.background = (folder_ / "deep.png").string();
    EXPECT_THAT(complaint(), HasSubstr("--background: a 16-bit file does not hold codes of"));
    write_text(arguments_.camera, std::string(pinhole) + noisy_12_bits);
    write_image(folder_ / "deep.png", {cv::Mat(60, 80, CV_16UC1, cv::Scalar(4096)), 16});
    EXPECT_THAT(complaint(), HasSubstr("code 4096 is above the sensor's full scale 4095"));
    arguments_.background = (folder_ / "nowhere.png").string();
    EXPECT_THAT(complaint(), HasSubstr("--background: '"));
}

TEST_F(RenderCommand, ExplainsThePlanWithin80Columns) {
    arguments_.explain = true;
    arguments_.tolerance_gray = 0.07;
    const std::string text = printed();
    // A sharp pinhole without distortion: everything can be left out, and is.
    for (const char* words : {"at most 0.07 gray", "  blur radius   0 to 0 px", "k = 1", "uniform",
                              "  left out", "lens: ", "diffraction: ", "distortion: "})
        EXPECT_THAT(text, HasSubstr(words));
    expect_80_columns(text);
}

TEST_F(RenderCommand, PairsMarkersWithPosesAndRefusesOnesThatHideEachOther) {
    arguments_.markers.push_back("apriltag:36h11:5@8mm");
    EXPECT_THAT(complaint(), HasSubstr("--pose: 1 for 2 markers"));
    arguments_.poses.push_back("0,0,0,9,-6,90");
    EXPECT_THAT(complaint(), HasSubstr("markers 1 and 2 overlap"));
    arguments_.poses.back() = "0,0,0,-20,-6,90";
    EXPECT_EQ(run_render(arguments_), 0);
}

TEST_F(RenderCommand, RefusesAMarkerThatCannotBeSeen) {
    arguments_.poses = {"0,0,0,7,-5,-100"};
    EXPECT_THAT(complaint(), HasSubstr("--pose: 0,0,0,7,-5,-100: the marker is behind the camera"));
    arguments_.poses = {"0,1.5,0,0,0,5"};
    EXPECT_THAT(complaint(), HasSubstr("reaches behind the camera"));
    // Across 90 degrees from the axis: the same pose before a lens that looks there.
    arguments_.poses = {"0,1.5,0,100,0,5"};
    EXPECT_THAT(complaint(), HasSubstr("reaches behind the camera"));
    write_text(folder_ / "camera.yml",
               "etalon: camera/1\nimage: {width: 80, height: 60}\nprojection: equidistant\n"
               "intrinsics: {fx: 20, fy: 20, cx: 39.5, cy: 29.5}\n");
    EXPECT_EQ(run_render(arguments_), 0);
    std::filesystem::remove(arguments_.out);
    write_text(folder_ / "camera.yml", pinhole);
    arguments_.poses = {"0,3.1,0,7,-5,100"};
    EXPECT_THAT(complaint(), HasSubstr("from its back"));
}

TEST_F(RenderCommand, RefusesArgumentsByTheirName) {
    expect_refusal([](Arguments& a) { a.poses = {"0,0,0,nan,0,100"}; }, "--pose: 'nan'");
    expect_refusal([](Arguments& a) { a.poses = {"0,0,100"}; }, "--pose: expected 6 numbers");
    expect_refusal([](Arguments& a) { a.markers = {"aruco:4X4_51:7@5mm"}; },
                   "--marker: aruco:4X4_51:7@5mm");
    expect_refusal([](Arguments& a) { a.method = "D"; }, "--method: 'D'");
    expect_refusal([](Arguments& a) { a.background = "1.5"; }, "--background: 1.5");
    expect_refusal([](Arguments& a) { a.background = "nan"; }, "--background");
    expect_refusal([](Arguments& a) { a.tolerance_gray = 0.0; }, "--tolerance");
    expect_refusal([](Arguments& a) { a.exposure = -1.5; }, "--exposure");
    expect_refusal([](Arguments& a) { a.out.replace_extension(".jpg"); }, "--out");
    expect_refusal([](Arguments& a) { a.linear = true; }, "--out: linear radiance");
    expect_refusal([](Arguments& a) { a.noise_seed = 5; }, "--noise-seed");
    expect_refusal([](Arguments& a) { a.velocity = "0,0,0,40,0,0"; },
                   "--velocity: motion blur needs both");
    expect_refusal([](Arguments& a) { a.shutter_ms = 1.0, a.velocity = "0,0,0,40,0"; },
                   "--velocity");
    expect_refusal([](Arguments& a) { a.camera = "/nowhere.yml"; }, "/nowhere.yml");
    expect_refusal([](Arguments& a) { a.out = "/nowhere/out.png"; }, "/nowhere/out.png");
}

TEST_F(RenderCommand, BlursByTheMotionWhileTheShutterIsOpen) {
    // 40 mm/s for 100 ms at 100 mm is 4 px along x at one px a mm: the left edge becomes a ramp of
    // as many px around its place at half time.
    arguments_.method = "auto";
    arguments_.velocity = "0,0,0,40,0,0";
    arguments_.shutter_ms = 100.0;
    const CodeImage moved = rendered();
    arguments_.velocity.clear();
    arguments_.shutter_ms = 0.0;
    const CodeImage still = rendered();
    // 30 mm wide at x = 7: from px 31.5 on. Cell (0, 0) is black before white.
    const int row = 22;
    EXPECT_EQ(still.pixels.at<std::uint8_t>(row, 31), 255);
    EXPECT_EQ(still.pixels.at<std::uint8_t>(row, 32), 0);
    EXPECT_EQ(moved.pixels.at<std::uint8_t>(row, 29), 255);
    EXPECT_NEAR(moved.pixels.at<std::uint8_t>(row, 30), 255 * 7 / 8.0, 2.0);
    EXPECT_NEAR(moved.pixels.at<std::uint8_t>(row, 32), 255 * 3 / 8.0, 2.0);
    EXPECT_EQ(moved.pixels.at<std::uint8_t>(row, 34), 0);
}

std::filesystem::path temporary(const std::string& name) {
    static const TemporaryFolder folder;
    return folder / name;
}

std::string complaint(const MarkerArguments& arguments) {
    return config_error_of([&] { run_marker(arguments); });
}

TEST(MarkerCommand, WritesEachFormatByItsExtension) {
    for (const auto& [name, beginning] :
         {std::pair{"a.svg", "<?xml"}, {"a.pdf", "%PDF-1."}, {"a.png", "\x89PNG"}}) {
        EXPECT_EQ(run_marker({"apriltag:36h11:5@50mm", temporary(name), 10.0}), 0);
        EXPECT_THAT(read_bytes(temporary(name)), StartsWith(beginning));
    }
}

TEST(MarkerCommand, TellsInJsonWhatIsOnThePage) {
    testing::internal::CaptureStdout();
    run_marker({"aruco:4X4_50:7@30mm", temporary("b.svg"), 40.0, true});
    const auto json = nlohmann::json::parse(testing::internal::GetCapturedStdout());
    EXPECT_EQ(json["etalon"], "marker/1");
    EXPECT_EQ(json["page_mm"], nlohmann::json({210.0, 297.0}));
    EXPECT_EQ(json["cells"], nlohmann::json({8, 8}));  // 4 data, 2 black, 2 white
    EXPECT_EQ(json["cell_mm"], nlohmann::json({5.0, 5.0}));
    EXPECT_EQ(json["points_mm"][1], nlohmann::json({15.0, -15.0, 0.0}));
}

TEST(MarkerCommand, RefusesInOneLineAndWritesNothing) {
    const auto out = temporary("c.svg");
    EXPECT_THAT(complaint({"aruco:4X4_51:7@30mm", out}), HasSubstr("MARKER: aruco:4X4_51:7@30mm"));
    EXPECT_FALSE(std::filesystem::exists(out));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", temporary("c.gif")}), HasSubstr(".svg, .pdf"));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", "/nowhere/c.svg"}),
                HasSubstr("cannot be written"));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", temporary("c.png"), -1.0}),
                HasSubstr("not a resolution"));
}

// ---- sets of images

using nlohmann::json;

constexpr const char* noisy_8_bits =
    "sensor: {pixel_pitch_um: 5, bits: 8, gain_e_per_dn: 2, read_noise_e: 6}\n";
// The first and the last one are the same: their noise must not be.
constexpr const char* poses =
    "rx,ry,rz,tx,ty,tz\n"
    "0,0,0,7,-5,100\n"
    "0.3,-0.2,0.5,-3,4,120\n"
    "0,0,0,7,-5,100\n";

class RenderSet : public RenderCommand {
protected:
    void SetUp() override {
        RenderCommand::SetUp();
        write_text(folder_ / "camera.yml", std::string(pinhole) + noisy_8_bits);
        write_text(folder_ / "poses.csv", poses);
        arguments_.poses.clear();
        arguments_.pose_file = folder_ / "poses.csv";
        arguments_.noise_seed = 7;
        arguments_.out = folder_ / "set";
    }

    SetResult render(std::stop_token stop = {}) const {
        const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(std::tmpfile(), std::fclose);
        const VirtualClock clock;
        Progress progress(out.get(), false, clock);
        return render_set(arguments_, std::move(stop), progress);
    }
    std::string complaint() const override {
        return config_error_of([&] { render(); });
    }
    std::filesystem::path image(int i) const {
        return arguments_.out / fmt::format("pose-{:06}.png", i);
    }
    std::vector<json> manifest() const {
        std::vector<json> lines;
        for (const std::string& line : split(read_text(arguments_.out / "images.jsonl"), '\n'))
            if (!line.empty())
                lines.push_back(json::parse(line));
        return lines;
    }
};

TEST_F(RenderSet, HoldsWhatSingleImagesShow) {
    arguments_.noise_seed.reset();
    const SetResult result = render();
    EXPECT_EQ(result.rendered, 3u);
    EXPECT_TRUE(result.complete);
    RenderArguments single = arguments_;
    single.pose_file.clear();
    single.out = folder_ / "single.png";
    for (const auto& [i, pose] : {std::pair{1, "0.3,-0.2,0.5,-3,4,120"}, {2, "0,0,0,7,-5,100"}}) {
        single.poses = {pose};
        run_render(single);
        EXPECT_EQ(read_bytes(image(i)), read_bytes(single.out));
    }
}

TEST_F(RenderSet, SaysHowEveryImageWasMade) {
    render();
    EXPECT_EQ(read_text(arguments_.out / "poses.csv"), poses);
    const json set = json::parse(read_text(arguments_.out / "set.json"));
    EXPECT_EQ(set["etalon"], "image-set/1");
    EXPECT_EQ(set["settings"]["noise_seed"], 7);
    const std::vector<json> lines = manifest();
    ASSERT_EQ(lines.size(), 3u);
    for (int i = 0; i < 3; ++i) {
        const json& line = lines[static_cast<std::size_t>(i)];
        EXPECT_EQ(line["image"], i);
        EXPECT_EQ(line["file"], image(i).filename().string());
        EXPECT_EQ(line["sha256"], sha256_of_file(image(i)));
        EXPECT_TRUE(line.contains("plan"));
    }
    EXPECT_EQ(lines[0]["camera_from_scene"], json({0.0, 0.0, 0.0, 7.0, -5.0, 100.0}));
}

TEST_F(RenderSet, RendersAgainOnlyWhatIsMissing) {
    render();
    const std::string first = read_bytes(image(0)), second = read_bytes(image(1));
    const auto long_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(5);
    for (const int i : {0, 2})
        std::filesystem::last_write_time(image(i), long_ago);
    std::filesystem::remove(image(1));
    const SetResult result = render();
    EXPECT_EQ(result.rendered, 1u);
    EXPECT_EQ(result.already_there, 2u);
    for (const int i : {0, 2})
        EXPECT_EQ(std::filesystem::last_write_time(image(i)), long_ago);
    EXPECT_EQ(read_bytes(image(0)), first);
    EXPECT_EQ(read_bytes(image(1)), second);
    EXPECT_EQ(manifest().size(), 3u);
}

TEST_F(RenderSet, MakesAnewWhatABrokenRunLeftWithoutItsLine) {
    render();
    const std::string lines = read_text(arguments_.out / "images.jsonl");
    write_text(arguments_.out / "images.jsonl", lines.substr(0, lines.size() - 9));
    EXPECT_EQ(render().rendered, 1u);
    EXPECT_EQ(read_text(arguments_.out / "images.jsonl"), lines);
}

TEST_F(RenderSet, StopsOnRequestAndGoesOnLater) {
    std::stop_source stop;
    stop.request_stop();
    const SetResult stopped = render(stop.get_token());
    EXPECT_FALSE(stopped.complete);
    EXPECT_EQ(stopped.rendered, 0u);
    const SetResult rest = render();
    EXPECT_TRUE(rest.complete);
    EXPECT_EQ(rest.rendered, 3u);
}

class ShardedSet : public RenderSet {
protected:
    void SetUp() override {
        RenderSet::SetUp();
        // The fourth is behind the camera.
        write_text(arguments_.pose_file, std::string(poses) + "0,0,0,0,0,-100\n0,0.1,0,2,1,110\n");
        for (const std::string i : {"1", "2"}) {
            arguments_.shard = i + "/2";
            arguments_.out = folder_ / ("part-" + i);
            render();
        }
    }
    std::string refusal(const std::vector<std::filesystem::path>& shards) const {
        return config_error_of([&] { merge_image_sets(shards, folder_ / "merged"); });
    }
    std::filesystem::path one() const { return folder_ / "part-1"; }
    std::filesystem::path two() const { return folder_ / "part-2"; }
};

TEST_F(ShardedSet, MergedIsTheSetOfOnePiece) {
    arguments_.shard = "";
    arguments_.out = folder_ / "whole";
    render();
    std::filesystem::remove(one() / "pose-000002.png");
    arguments_.shard = "1/2";
    arguments_.out = one();
    EXPECT_EQ(render().rendered, 1u);  // its line is the last one now
    const MergedImages merged = merge_image_sets({two(), one()}, folder_ / "merged");
    EXPECT_EQ(merged.images, 4u);
    EXPECT_EQ(merged.refused, 1u);
    std::size_t files = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "whole")) {
        EXPECT_EQ(read_bytes(folder_ / "merged" / entry.path().filename()),
                  read_bytes(entry.path()))
            << entry.path();
        ++files;
    }
    EXPECT_EQ(files, 4u + 3u);
    EXPECT_EQ(refusal({one(), two()}), "no error");  // again into the same folder
}

TEST_F(ShardedSet, IsNotMergedFromShardsThatDoNotFit) {
    EXPECT_THAT(refusal({two()}), HasSubstr("render merge: shard 1/2 is missing"));
    EXPECT_THAT(refusal({one(), one()}), HasSubstr("is the same shard as"));
    arguments_.shard = "2/2";
    arguments_.out = folder_ / "other";
    arguments_.noise_seed = 8;
    render();
    EXPECT_THAT(refusal({one(), folder_ / "other"}), HasSubstr("its 'noise_seed' differs"));
    arguments_.shard = "";
    arguments_.out = folder_ / "whole";
    render();
    EXPECT_THAT(refusal({folder_ / "whole"}), HasSubstr("is of no shard"));
    const std::string set = read_text(two() / "set.json");
    write_text(two() / "set.json", std::regex_replace(set, std::regex("\"version\": \"[^\"]*"),
                                                      "\"version\": \"0.0.0"));
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("its 'version' differs"));
    write_text(two() / "set.json", set);
    write_text(two() / "pose-000001.png", read_bytes(one() / "pose-000000.png"));
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("is not the image that was rendered"));
}

// A killed shard has the beginning of its lines.
TEST_F(ShardedSet, IsNotMergedFromAShardThatIsNotFinished) {
    const std::string lines = read_text(one() / "images.jsonl");
    write_text(one() / "images.jsonl", lines.substr(0, lines.size() - 5));
    EXPECT_THAT(refusal({one(), two()}), HasSubstr("pose 4 is missing: the shard is not finished"));
}

TEST_F(RenderSet, RefusesAFolderMadeWithOtherArgumentsAndNamesTheFirst) {
    render();
    const std::string before = read_bytes(image(0));
    expect_refusal([](Arguments& a) { a.noise_seed = 5; },
                   "its 'noise_seed' differs (see set.json)");
    expect_refusal([](Arguments& a) { a.tolerance_gray = 0.2; }, "'tolerance_gray'");
    expect_refusal([](Arguments& a) { a.exposure = 0.5; }, "'exposure'");
    expect_refusal([](Arguments& a) { a.background = "0.5"; }, "'background'");
    expect_refusal([](Arguments& a) { a.poses = {"0,0,0,0,0,1"}; }, "'markers'");
    write_text(folder_ / "poses.csv", std::string(poses) + "0,0,0,1,2,300\n");
    EXPECT_THAT(complaint(), HasSubstr("'poses.sha256'"));
    write_text(folder_ / "poses.csv", poses);
    // The same name, other cells.
    write_image(folder_ / "cells.png", {cv::Mat(2, 3, CV_8UC1, cv::Scalar(70)), 8});
    EXPECT_THAT(complaint(), HasSubstr("'markers'"));
    EXPECT_EQ(read_bytes(image(0)), before);
}

TEST_F(RenderSet, RefusesAFolderThatHoldsSomethingElse) {
    std::filesystem::create_directory(arguments_.out);
    write_text(arguments_.out / "thesis.tex", "x");
    EXPECT_THAT(complaint(), HasSubstr("--out: '"));
    EXPECT_THAT(complaint(), HasSubstr("is not empty and holds no image set"));
    write_text(arguments_.out / "set.json", "[7]");
    EXPECT_THAT(complaint(), HasSubstr("not of image-set/1"));
    EXPECT_FALSE(std::filesystem::exists(image(0)));
}

TEST_F(RenderSet, HasTheSameBytesForAnyNumberOfThreadsAndNoiseOfItsOwnInEveryImage) {
    render();
    const std::vector<json> parallel = manifest();
    arguments_.out = folder_ / "again";
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    render();
    EXPECT_EQ(manifest(), parallel);
    EXPECT_NE(parallel[0]["sha256"], parallel[2]["sha256"]);
}

// Its own copy of the poses is then the file that was given.
TEST_F(RenderSet, GoesOnFromItsOwnPoses) {
    render();
    const std::string before = read_text(arguments_.out / "poses.csv");
    std::filesystem::remove(image(1));
    arguments_.pose_file = arguments_.out / "poses.csv";
    const InputGuard guard;
    EXPECT_EQ(render().rendered, 1u);
    EXPECT_EQ(read_text(arguments_.out / "poses.csv"), before);
}

TEST_F(RenderSet, ListsPosesThatCannotBeRendered) {
    write_text(folder_ / "poses.csv",
               "rx,ry,rz,tx,ty,tz\n0,0,0,7,-5,100\n0,0,0,7,-5,-100\n0,0,0,1,2,300\n");
    const SetResult result = render();
    EXPECT_EQ(result.rendered, 2u);
    EXPECT_EQ(result.refused, 1u);
    EXPECT_THAT(result.first_refusal, HasSubstr("pose 1: the marker is behind the camera"));
    EXPECT_FALSE(std::filesystem::exists(image(1)));
    EXPECT_THAT(std::string(manifest().at(1)["refused"]), HasSubstr("behind the camera"));
    EXPECT_EQ(render().refused, 1u);
    EXPECT_EQ(manifest().size(), 3u);
}

TEST_F(RenderSet, PlacesMarkersInTheScene) {
    arguments_.noise_seed.reset();
    arguments_.markers.push_back("apriltag:36h11:5@8mm");
    EXPECT_THAT(complaint(), HasSubstr("--pose: 0 for 2 markers"));
    arguments_.poses = {"0,0,0,2,1,0", "0,0,0.4,-25,3,0"};
    write_text(folder_ / "poses.csv", "rx,ry,rz,tx,ty,tz\n0,0,0,7,-5,100\n");
    render();
    RenderArguments single = arguments_;
    single.pose_file.clear();
    single.out = folder_ / "single.png";
    single.poses = {"0,0,0,9,-4,100", "0,0,0.4,-18,-2,100"};
    run_render(single);
    EXPECT_EQ(read_bytes(image(0)), read_bytes(single.out));
}

TEST_F(RenderSet, WritesRadianceAsTiff) {
    arguments_.noise_seed.reset();
    arguments_.linear = true;
    render();
    EXPECT_EQ(read_radiance(arguments_.out / "pose-000002.tiff").size(), cv::Size(80, 60));
}

TEST(ImageSetFolder, IsWrittenByOneAtATime) {
    const TemporaryFolder folder;
    const auto begin_set = [&] { ImageSet(folder / "set", R"({"seed": 7})", "{}", ".png", 3); };
    {
        const ImageSet first(folder / "set", R"({"seed": 7})", "{}", ".png", 3);
        EXPECT_THAT(config_error_of(begin_set),
                    HasSubstr("set: is in use: another etalon is writing"));
    }
    EXPECT_EQ(config_error_of(begin_set), "no error");
}

TEST(ImageSetFolder, AFullDiskIsADiskError) {
    const TemporaryFolder folder;
    ImageSet set(folder / "set", R"({"seed": 7})", "{}", ".png", 3);
    set.add(R"({"image":0,"refused":"behind the camera"})");
    const FileSizeLimit limit(60);
    EXPECT_THROW(set.add(R"({"image":1,"refused":"behind the camera"})"), DiskError);
    EXPECT_THROW(ImageSet(folder / "other", R"({"seed": 7})", "{}", ".png", 3), DiskError);
}

}  // namespace
}  // namespace etalon
