// Photographs as others bring them, through the built program: boards and markers of every kind, no
// calibration, patterns and films, sets that are not of one camera. All are rendered here.

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "calib/files/camera_file.h"
#include "tests/calib/synthetic_views.h"
#include "tests/compare/rendered_tags.h"
#include "tests/station/built_program.h"

namespace etalon::test {
namespace {

constexpr const char* tag_name = "apriltag:36h11:5@40mm";

CameraModel small_camera(double focal_px = 400.0, double k1 = 0.0) {
    return {.width = 320,
            .height = 240,
            .intrinsics = {focal_px, focal_px * 1.005, 161.3, 118.4},
            .distortion = {.k1 = k1}};
}

CodeImage photo_of(const CameraModel& camera, const std::vector<PlacedMarker>& markers) {
    return SensorModel(camera).expose(0.08 +
                                      0.75 * Renderer(camera).render({markers, 1.0}).radiance);
}

PlacedMarker placed(const std::string& name, const Eigen::Vector3d& rotation,
                    const Eigen::Vector3d& middle) {
    const Marker marker = parse_marker(name, "test");
    return {marker.grid, board_pose(marker, rotation, middle)};
}

class StrangersPhotographs : public testing::Test {
protected:
    void photograph(const std::string& name, const CameraModel& camera,
                    const std::vector<PlacedMarker>& markers) const {
        write_image(folder_ / name, photo_of(camera, markers));
    }
    void blank(const std::string& name, int width, int height) const {
        write_image(folder_ / name, {cv::Mat(height, width, CV_8UC1, cv::Scalar(70 + name[1])), 8});
    }
    void chessboard_set(int first, int last, const CameraModel& camera) const {
        for (int i = first; i < last; ++i)
            photograph(fmt::format("a{:02}.png", i), camera,
                       {placed("chessboard:6x5@10mm",
                               {0.5 * std::sin(2.4 * i), 0.55 * std::cos(2.4 * i), 0.1 * i},
                               {6.0 * std::sin(1.7 * i), 5.0 * std::cos(1.3 * i),
                                150.0 + 12.0 * std::sin(4.0 * i)})});
    }
    Finished etalon(const std::string& arguments) const { return etalon_with(folder_, arguments); }
    nlohmann::json json_of(const std::string& arguments) const {
        const Finished finished = etalon(arguments + " --json");
        EXPECT_EQ(finished.exit_code, 0) << finished.err;
        return nlohmann::json::parse(finished.out);
    }

    TemporaryFolder folder_;
};

TEST_F(StrangersPhotographs, ShowCornersWithoutACalibration) {
    photograph("a.png", small_camera(), {placed(tag_name, {0.2, -0.1, 0.1}, {5, 3, 200})});
    const Finished finished = etalon(fmt::format("detect a.png --marker {}", tag_name));
    EXPECT_EQ(finished.exit_code, 0) << finished.err;
    EXPECT_EQ(split(std::string(trimmed(finished.out)), '\n').size(), 5u) << finished.out;
    EXPECT_THAT(finished.out, AllOf(HasSubstr("x px"), HasSubstr("a.png")));
    EXPECT_THAT(finished.err, HasSubstr("poses need a calibration: --camera"));
    expect_one_line_error(
        etalon(fmt::format("detect a.png --detector photometric --marker {}", tag_name)), 3,
        "--camera: a calibration is needed for poses");
}

TEST_F(StrangersPhotographs, ShowEveryOneOfSeveralEqualMarkers) {
    write_camera(folder_ / "camera.yml", small_camera());
    photograph("a.png", small_camera(),
               {placed(tag_name, {0.2, -0.1, 0.1}, {-30, 3, 200}),
                placed(tag_name, {-0.1, 0.3, 0.2}, {32, -4, 215})});
    const Finished finished =
        etalon(fmt::format("detect a.png --camera camera.yml --json --marker {}", tag_name));
    EXPECT_EQ(finished.exit_code, 0) << finished.err;
    EXPECT_THAT(finished.err, HasSubstr("a.png: the marker is seen more than once"));
    const auto photos = nlohmann::json::parse(finished.out)["photos"];
    ASSERT_EQ(photos.size(), 2u);
    const double x = photos[0]["camera_from_marker"][3], other = photos[1]["camera_from_marker"][3];
    EXPECT_NEAR(std::min(x, other), -30.0, 0.3);
    EXPECT_NEAR(std::max(x, other), 32.0, 0.3);
}

class StrangersBoards : public StrangersPhotographs,
                        public testing::WithParamInterface<const char*> {};

TEST_P(StrangersBoards, AreDetectedAndCompared) {
    CameraModel camera = small_camera();
    if (std::string_view(GetParam())
            .starts_with("circles")) {  // blur that cells of 0.5 px hardly bear
        camera.sensor = blurred_camera(0.5).sensor;
        camera.lens = blurred_camera(0.5).lens;
    }
    write_camera(folder_ / "camera.yml", camera);
    const PlacedMarker board = placed(GetParam(), {0.25, -0.2, 0.06}, {1, -2, 190});
    photograph("a.png", camera, {board});
    const std::string asked = fmt::format("--camera camera.yml --marker {}", GetParam());
    const auto pose = json_of("detect a.png " + asked)["photos"][0]["camera_from_marker"];
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(pose[3 + i].get<double>(), board.camera_from_marker.translation[i], 0.5) << i;
    const auto compared = json_of("compare a.png --out out " + asked);
    EXPECT_LT(compared["mean_residual_gray"].get<double>(), 6.0);
}

INSTANTIATE_TEST_SUITE_P(OfEveryKind, StrangersBoards,
                         testing::Values("aprilgrid:36h11:3x2@32mm/9.6mm", "circles:4x3@30mm/18mm",
                                         "charuco:4X4_50:6x5@20mm/15mm"));

// What a ray to the pixel sees: a chessboard with a white margin.
float wide_gray(const Projector& projector, const Rigid& camera_from_board,
                const Eigen::Vector2d& pixel) {
    const Eigen::Matrix3d board = camera_from_board.rotation.toRotationMatrix();
    const Eigen::Vector3d& origin = camera_from_board.translation;
    const auto ray = projector.ray(pixel);
    const double along = ray ? board.col(2).dot(origin) / board.col(2).dot(*ray) : 0.0;
    if (!(along > 0.0))
        return 90.0f;
    const Eigen::Vector3d point = board.transpose() * (along * *ray - origin) / 25.0;
    const int x = static_cast<int>(std::floor(point.x())),
              y = static_cast<int>(std::floor(point.y()));
    if (x < -2 || x > 9 || y < -2 || y > 6)
        return 90.0f;
    const bool on_board = x >= -1 && x <= 8 && y >= -1 && y <= 5;
    return on_board && (x + y) % 2 == 0 ? 30.0f : 210.0f;
}

// So many rays a pixel each way where its corners do not see the same.
CodeImage wide_photo(const Projector& projector, const Rigid& camera_from_board, int rays) {
    const CameraModel& camera = projector.camera();
    const auto gray = [&](double u, double v) {
        return wide_gray(projector, camera_from_board, {u, v});
    };
    cv::Mat corners(camera.height + 1, camera.width + 1, CV_32F);
    for (int v = 0; v <= camera.height; ++v)
        for (int u = 0; u <= camera.width; ++u)
            corners.at<float>(v, u) = gray(u - 0.5, v - 0.5);
    CodeImage photo{cv::Mat(camera.height, camera.width, CV_8U), 8};
    for (int v = 0; v < camera.height; ++v)
        for (int u = 0; u < camera.width; ++u) {
            float sum = corners.at<float>(v, u);
            if (cv::countNonZero(corners({u, v, 2, 2}) != sum) > 0) {
                sum = 0.0f;
                for (int i = 0; i < rays * rays; ++i)
                    sum +=
                        gray(u - 0.5 + (i % rays + 0.5) / rays, v - 0.5 + (i / rays + 0.5) / rays) /
                        static_cast<float>(rays * rays);
            }
            photo.pixels.at<uchar>(v, u) = cv::saturate_cast<uchar>(sum);
        }
    return photo;
}

TEST_F(StrangersPhotographs, MayBeOfAFisheye) {
    const CameraModel truth = wide_truth({Projection::double_sphere, -0.17, 0.59}, 155.0);
    const Projector projector(truth);
    std::string photos;
    for (int i = 0; i < 9; ++i) {
        const std::string name = fmt::format("a{}.png", i);
        write_image(folder_ / name, wide_photo(projector, wide_pose(i), 12));
        photos += " " + name;
    }
    const Finished finished =
        etalon("calibrate --target chessboard:9x6@25mm --out camera.yml --report r" + photos);
    ASSERT_EQ(finished.exit_code, 0) << finished.err;
    const CameraModel found = read_any_camera(folder_ / "camera.yml");
    EXPECT_FALSE(found.projection.is_flat()) << finished.out;
    // After the best rotation, where boards were seen.
    const ImageRays rays = image_rays(truth);
    const auto off =
        projection_difference(found, rays, Eigen::VectorXd::Ones(std::ssize(rays.pixels)));
    for (std::size_t i = 0; i < off.pixels.size(); ++i) {
        const double radius = (off.pixels[i] - Eigen::Vector2d(331, 243)).norm();
        EXPECT_TRUE(radius > 200.0 || off.differences_px[i].norm() < 0.3) << radius;
    }
    EXPECT_EQ(etalon("camera check camera.yml").exit_code, 0);
    const auto seen =
        json_of("detect a1.png --camera camera.yml --marker chessboard:9x6@25mm")["photos"][0];
    EXPECT_LT(seen["reprojection_rms_px"].get<double>(), 0.1) << seen;
    // 12 x 12 rays: steps of 1 / 144 of 180 gray at an edge, 0.4 gray RMS; calibrated to some 0.03
    // px. The second board's middle is 72 degrees from the axis, its corners beyond 90.
    for (const char* photo : {"a0", "a5"}) {
        const auto compared = json_of(fmt::format(
            "compare {0}.png --camera camera.yml --out {0} --marker chessboard:9x6@25mm", photo));
        EXPECT_LT(compared["mean_residual_gray"].get<double>(), 3.0) << photo;
    }
    const Finished characterised =
        etalon("characterise a1.png --camera camera.yml --out k.yml --target chessboard:9x6@25mm");
    EXPECT_EQ(characterised.exit_code, 0) << characterised.err;
    EXPECT_THAT(characterised.out, HasSubstr("not measured: focus distance and f-number"));
}

TEST_F(StrangersPhotographs, MayBePatternsAndFilms) {
    const CameraModel camera = small_camera();
    cv::VideoWriter film((folder_ / "clip.avi").string(),
                         cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10.0, {320, 240}, false);
    if (!film.isOpened())
        GTEST_SKIP() << "this OpenCV writes no MJPG films";
    for (int i = 0; i < 5; ++i) {
        const CodeImage photo =
            photo_of(camera, {placed(tag_name, {0.2, -0.1, 0.1}, {5.0 * i - 10.0, 3, 200})});
        film.write(photo.pixels);
        if (i < 3)
            write_image(folder_ / fmt::format("p{}.png", i), photo);
    }
    film.release();
    blank("other.png", 320, 240);
    const auto found = [&](const std::string& photos) {
        return etalon(fmt::format("detect {} --marker {}", photos, tag_name)).err;
    };
    EXPECT_THAT(found("'p*.png'"), HasSubstr("found in 3 of 3 photographs"));
    EXPECT_THAT(found("'video:clip.avi?every=2'"), HasSubstr("found in 3 of 3 photographs"));
    EXPECT_THAT(found("'video:clip.avi'"), HasSubstr("found in 5 of 5 photographs"));
    EXPECT_THAT(found("'q*.png'"), HasSubstr("q*.png"));
    EXPECT_THAT(found("'video:clip.avi?every=0'"), HasSubstr("N at least 1"));
}

TEST_F(StrangersPhotographs, OfATelephoneAreRefusedByName) {
    using std::string_literals::operator""s;
    write_text(folder_ / "IMG_1.HEIC",
               "\0\0\0\x18"
               "ftypheic\0\0\0\0mif1heic"s);
    expect_one_line_error(etalon(fmt::format("detect IMG_1.HEIC --marker {}", tag_name)), 3,
                          "IMG_1.HEIC: is HEIC, which is not read here: convert it to PNG");
}

// Each would count as a view of its own, and the deviations would be too small.
TEST_F(StrangersPhotographs, OfAFrozenCameraAreOnePhotograph) {
    chessboard_set(0, 1, small_camera());
    for (const char* copy : {"b.png", "c.png", "d.png"})
        std::filesystem::copy_file(folder_ / "a00.png", folder_ / copy);
    const Finished finished =
        etalon("calibrate --target chessboard:6x5@10mm --out c.yml a00.png b.png c.png d.png");
    EXPECT_EQ(finished.exit_code, 3);
    EXPECT_THAT(finished.err, HasSubstr("not used: d.png is the same picture as a00.png"));
    EXPECT_THAT(finished.err, HasSubstr("was found in 1 of 4 photos; three are needed"));
}

TEST_F(StrangersPhotographs, OfSeveralSizesAreGroupedAndNamed) {
    for (int i = 0; i < 4; ++i)
        blank(fmt::format("a{}.png", i), 320, 240);
    blank("b0.png", 240, 320);
    const std::string calibrate = "calibrate --board 6x5 --square-mm 10 --out c.yml ";
    EXPECT_THAT(etalon(calibrate + "a?.png b0.png").err,
                HasSubstr("not used, as most photos have 320x240 px; 240x320 px: b0.png"));
    const Finished half = etalon(calibrate + "a0.png b0.png");
    EXPECT_EQ(half.exit_code, 3);
    EXPECT_THAT(half.err, AllOf(HasSubstr("are of several sizes"), HasSubstr("240x320 px: ")));
}

TEST_F(StrangersPhotographs, OfTagsWithAShortenedFamilyAreHelpedOn) {
    blank("a.png", 320, 240);
    expect_one_line_error(etalon("detect a.png --marker apriltag:41h12:5@40mm"), 3,
                          "did you mean 'Standard41h12'?");
}

TEST_F(StrangersPhotographs, OfAZoomInBetweenAreNotUsedAndNamed) {
    chessboard_set(0, 5, small_camera(400.0));
    chessboard_set(5, 7, small_camera(500.0));
    const std::string calibrate =
        "calibrate --board 6x5 --square-mm 10 --model pinhole --out c.yml --report r ";
    const Finished most = etalon(calibrate + "'a*.png'");
    EXPECT_EQ(most.exit_code, 0) << most.err;
    EXPECT_THAT(most.err, HasSubstr("Not used: photos a05.png, a06.png do not share the others'"));
    EXPECT_NEAR(read_camera(folder_ / "c.yml").intrinsics.fx, 400.0, 2.0);
    const auto json = nlohmann::json::parse(read_text(folder_ / "r/calibration.json"));
    EXPECT_EQ(json["photos_of_other_cameras"].size(), 2u);
    EXPECT_EQ(json["photos"].size(), 5u);
    EXPECT_THAT(read_text(folder_ / "r/report.html"),
                HasSubstr("not used: another zoom, focus or camera"));
}

TEST_F(StrangersPhotographs, OfTwoZoomsAreRefusedWhenNeitherIsThatOfMost) {
    chessboard_set(0, 4, small_camera(400.0));
    chessboard_set(4, 7, small_camera(500.0));
    const Finished finished = etalon("calibrate --board 6x5 --square-mm 10 --out c.yml 'a*.png'");
    expect_one_line_error(finished, 2,
                          "these photos are of several cameras: photos a04.png, a05.png, a06.png");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "c.yml"));
}

// k1 = -0.35 folds over 130 px from the middle; the board stays within 90.
TEST_F(StrangersPhotographs, OfAFoldingDistortionLeavePartOfTheImageWithoutRays) {
    chessboard_set(0, 3, small_camera(200.0, -0.35));
    const Finished finished =
        etalon("calibrate --board 6x5 --square-mm 10 --model radial --out c.yml 'a*.png'");
    EXPECT_EQ(finished.exit_code, 0) << finished.err;
    EXPECT_THAT(finished.err, HasSubstr("% of the image has no ray"));
}

TEST_F(StrangersPhotographs, OfCharucoBoardsDrawnAsBefore46AreNamed) {
    photograph("a.png", small_camera(),
               {placed("charuco-legacy:4X4_50:5x4@20mm/15mm", {0.2, -0.1, 0.1}, {1, 2, 180})});
    const Finished finished = etalon("detect a.png --marker charuco:4X4_50:5x4@20mm/15mm");
    EXPECT_THAT(finished.err + finished.out,
                HasSubstr("the board that is seen is charuco-legacy:4X4_50:5x4@20mm/15mm"));
}

// A half plane behind a Gaussian of 0.9 px, whose MTF is one half at sqrt(ln 2 / 2) / (pi sigma).
TEST_F(StrangersPhotographs, OfAnEdgeTellItsSharpness) {
    constexpr double sigma_px = 0.9, slope = 0.09;
    cv::Mat pixels(160, 200, CV_8UC1);
    for (int y = 0; y < pixels.rows; ++y)
        for (int x = 0; x < pixels.cols; ++x) {
            const double from_edge = (x - 97.3 - slope * (y - 80)) / std::hypot(1.0, slope);
            pixels.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(std::lround(
                40.0 + 170.0 * 0.5 * std::erfc(-from_edge / sigma_px / std::numbers::sqrt2)));
        }
    write_image(folder_ / "edge.png", {pixels, 8});
    const double truth = std::sqrt(std::numbers::ln2 / 2.0) / (std::numbers::pi * sigma_px);
    for (const char* where : {"auto", "60,30,75x100"}) {
        const Finished finished = etalon(fmt::format("characterise --edge {} edge.png", where));
        EXPECT_EQ(finished.exit_code, 0) << finished.err;
        ASSERT_THAT(finished.out, StartsWith("MTF50 ")) << where;
        EXPECT_NEAR(std::stod(finished.out.substr(6)), truth, 0.02 * truth) << where;
    }
    expect_one_line_error(etalon("characterise --edge 60,30 edge.png"), 3,
                          "'60,30' is neither auto nor X,Y,WxH in px");
}

}  // namespace
}  // namespace etalon::test
