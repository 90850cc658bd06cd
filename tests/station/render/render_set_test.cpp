#include "station/render/image_set.h"

#include <tbb/global_control.h>

#include <nlohmann/json.hpp>

#include "core/file/sha256.h"
#include "core/image/image.h"
#include "tests/test.h"

namespace etalon {
namespace {

using nlohmann::json;

constexpr const char* camera =
    "etalon: camera/1\n"
    "image: {width: 80, height: 60}\n"
    "intrinsics: {fx: 100, fy: 100, cx: 39.5, cy: 29.5}\n"
    "sensor: {pixel_pitch_um: 5, bits: 8, gain_e_per_dn: 2, read_noise_e: 6}\n";
// The first and the last one are the same: their noise must not be.
constexpr const char* poses =
    "rx,ry,rz,tx,ty,tz\n"
    "0,0,0,7,-5,100\n"
    "0.3,-0.2,0.5,-3,4,120\n"
    "0,0,0,7,-5,100\n";

class RenderSet : public testing::Test {
protected:
    void SetUp() override {
        const cv::Mat cells = (cv::Mat_<std::uint8_t>(2, 3) << 0, 51, 255, 102, 153, 204);
        write_image(folder_ / "cells.png", {cells, 8});
        write_text(folder_ / "camera.yml", camera);
        write_text(folder_ / "poses.csv", poses);
        arguments_.camera = folder_ / "camera.yml";
        arguments_.markers = {"bitmap:" + (folder_ / "cells.png").string() + "@30x20mm"};
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
    std::string complaint() const {
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

    TemporaryFolder folder_;
    RenderArguments arguments_;
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
    const RenderArguments good = arguments_;
    const auto refuses = [&](auto change, const char* words) {
        arguments_ = good;
        change(arguments_);
        EXPECT_THAT(complaint(), HasSubstr(words));
    };
    using Arguments = RenderArguments;
    refuses([](Arguments& a) { a.noise_seed = 5; }, "its 'noise_seed' differs (see set.json)");
    refuses([](Arguments& a) { a.tolerance_gray = 0.2; }, "'tolerance_gray'");
    refuses([](Arguments& a) { a.exposure = 0.5; }, "'exposure'");
    refuses([](Arguments& a) { a.background = "0.5"; }, "'background'");
    refuses([](Arguments& a) { a.poses = {"0,0,0,0,0,1"}; }, "'markers'");
    arguments_ = good;
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
