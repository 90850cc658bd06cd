// What we write, read and used by the tool that it is for, where that is installed.

#include <sstream>

#include "calib/files/foreign_camera.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Debian's own interpreter, which has Debian's modules.
constexpr const char* python = "/usr/bin/python3";

bool succeeds(const std::string& command) {
    return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

std::vector<Eigen::Vector2d> projected_by_mrcal(const TemporaryFolder& folder,
                                                const std::vector<Eigen::Vector3d>& points) {
    std::string lines;
    for (const Eigen::Vector3d& point : points)
        lines += fmt::format("{} {} {}\n", point.x(), point.y(), point.z());
    write_text(folder / "points.txt", lines);
    write_text(folder / "project.py",
               "import mrcal, numpy\n"
               "model = mrcal.cameramodel('camera.cameramodel')\n"
               "for pixel in mrcal.project(numpy.loadtxt('points.txt'), *model.intrinsics()):\n"
               "    print(repr(float(pixel[0])), repr(float(pixel[1])))\n");
    const std::string command =
        fmt::format("cd '{}' && {} project.py > pixels.txt", (folder / "").string(), python);
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::istringstream answer(read_text(folder / "pixels.txt"));
    std::vector<Eigen::Vector2d> pixels;
    for (double x, y; answer >> x >> y;)
        pixels.emplace_back(x, y);
    return pixels;
}

// Over the whole image: our ray of a pixel, projected there, is the pixel; and so here.
TEST(InstalledTools, MrcalProjectsAsWeDo) {
    if (!succeeds(fmt::format("{} -c 'import mrcal'", python)))
        GTEST_SKIP() << "mrcal is not installed (python3-mrcal)";
    std::vector<CameraModel> cameras{webcam(), all_fourteen(),
                                     wide_truth({Projection::stereographic}, 140.0),
                                     wide_truth(cahvors()[0], 400.0)};
    cameras[1].distortion.tau_x = cameras[1].distortion.tau_y = 0.0;
    for (const LensProjection& projection :
         {cahvors()[2], cahvors()[3], cahvors()[4], splines()[0], splines()[1]})
        cameras.push_back(wide_truth(projection, 140.0));
    for (const CameraModel& camera : cameras) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const TemporaryFolder folder;
        write_foreign_camera(folder / "camera.cameramodel", CalibrationTool::mrcal, camera);
        const Projector projector(camera);
        std::vector<Eigen::Vector3d> rays;
        std::vector<Eigen::Vector2d> pixels;
        for (int y = 0; y < camera.height; y += 20)
            for (int x = 0; x < camera.width; x += 20)
                if (const auto ray = projector.ray({x, y})) {
                    rays.push_back(617.0 * *ray);
                    pixels.emplace_back(x, y);
                }
        const auto theirs = projected_by_mrcal(folder, rays);
        ASSERT_EQ(theirs.size(), rays.size());
        ASSERT_GT(rays.size(), 600u);
        for (std::size_t i = 0; i < rays.size(); ++i) {
            ASSERT_LT((theirs[i] - pixels[i]).norm(), 1e-9) << pixels[i].transpose();
            ASSERT_LT((*projector.project(rays[i]) - theirs[i]).norm(), 1e-9);
        }
    }
}

// ---- COLMAP

constexpr const char* colmap = "QT_QPA_PLATFORM=offscreen colmap";

struct Sighting {
    Eigen::Vector3d point;
    Eigen::Vector2d pixel;
};

// COLMAP measures how far each point of a reconstruction lies from its two sightings when it
// filters them: here both by the same camera, at the origin. The mean distance of each point, px.
std::vector<double> distances_by_colmap(const TemporaryFolder& folder,
                                        const std::vector<Sighting>& sightings) {
    std::string seen, points;
    for (std::size_t i = 0; i < sightings.size(); ++i) {
        const auto& [point, pixel] = sightings[i];
        const Eigen::Vector2d theirs = pixel.array() + 0.5;
        seen += fmt::format("{} {} {} ", theirs.x(), theirs.y(), i + 1);
        points += fmt::format("{} {} {} {} 0 0 0 9 1 {} 2 {}\n", i + 1, point.x(), point.y(),
                              point.z(), i, i);
    }
    write_text(folder / "images.txt",
               "1 1 0 0 0 0 0 0 1 a.png\n" + seen + "\n2 1 0 0 0 0 0 0 1 b.png\n" + seen + "\n");
    write_text(folder / "points3D.txt", points);
    const std::string command = fmt::format(
        "cd '{0}' && mkdir out && {1} point_filtering --input_path . --output_path out "
        "--max_reproj_error 1e-3 --min_tri_angle 0 --min_track_len 2 >log 2>&1 && "
        "{1} model_converter --input_path out --output_path out --output_type TXT >log 2>&1",
        (folder / "").string(), colmap);
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::istringstream lines(read_text(folder / "out/points3D.txt"));
    std::vector<double> distances;
    for (std::string line; std::getline(lines, line);) {
        double number[8] = {};
        std::istringstream words(line);
        for (double& word : number)
            words >> word;
        if (words)
            distances.push_back(number[7]);
    }
    return distances;
}

std::vector<CameraModel> cameras_of_colmap() {
    using enum Projection;
    CameraModel pinhole = webcam(), full = all_fourteen();
    pinhole.distortion = {};
    auto coefficients = full.distortion.coefficients();
    std::fill(coefficients.begin() + 8, coefficients.end(), 0.0);  // from s1 on
    full.distortion = Distortion::of(coefficients);
    CameraModel four = pinhole;
    four.distortion = {.k1 = -0.286, .k2 = 0.057, .p1 = 0.0021, .p2 = -0.0034};
    const Distortion kannala_brandt{.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4};
    Distortion prism = kannala_brandt;
    prism.p1 = 0.0012;
    prism.p2 = -0.0007;
    prism.s1 = 0.001;
    prism.s3 = -0.002;
    return {pinhole,
            four,
            full,
            wide_truth({field_of_view, 0.93}, 190.0),
            wide_truth({equidistant}, 181.0, kannala_brandt),
            wide_truth({equidistant}, 181.0, prism)};
}

// Over the whole image, as far as COLMAP goes: not beside or behind the camera.
TEST(InstalledTools, ColmapProjectsAsWeDo) {
    if (!succeeds(fmt::format("{} help", colmap)))
        GTEST_SKIP() << "COLMAP is not installed (colmap)";
    for (const CameraModel& camera : cameras_of_colmap()) {
        const TemporaryFolder folder;
        write_foreign_camera(folder / "cameras.txt", CalibrationTool::colmap, camera);
        SCOPED_TRACE(read_text(folder / "cameras.txt"));
        const Projector projector(camera);
        std::vector<Sighting> sightings;
        for (int y = 0; y < camera.height; y += 20)
            for (int x = 0; x < camera.width; x += 20)
                if (const auto ray = projector.ray({x, y}); ray && ray->z() > 0.1)
                    sightings.push_back({617.0 * *ray, {x, y}});
        const std::vector<double> distances = distances_by_colmap(folder, sightings);
        ASSERT_GT(sightings.size(), 400u);
        ASSERT_EQ(distances.size(), sightings.size());
        EXPECT_LT(*std::max_element(distances.begin(), distances.end()), 1e-9);
    }
}

}  // namespace
}  // namespace etalon
