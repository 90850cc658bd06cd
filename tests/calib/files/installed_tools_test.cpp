// What we write, read and used by the tool that it is for, where that is installed.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "calib/camera/projector.h"
#include "calib/files/mrcal_file.h"
#include "core/text.h"
#include "tests/calib/lens_tables.h"
#include "tests/calib/wide_views.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

// Debian's own interpreter, which has Debian's modules.
constexpr const char* python = "/usr/bin/python3";

bool has_mrcal() {
    return std::system(fmt::format("{} -c 'import mrcal' 2>/dev/null", python).c_str()) == 0;
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
    if (!has_mrcal())
        GTEST_SKIP() << "mrcal is not installed (python3-mrcal)";
    std::vector<CameraModel> cameras{test::webcam(), test::all_fourteen(),
                                     test::wide_truth({Projection::stereographic}, 140.0),
                                     test::wide_truth(test::cahvors()[0], 400.0)};
    cameras[1].distortion.tau_x = cameras[1].distortion.tau_y = 0.0;
    for (const LensProjection& projection :
         {test::cahvors()[2], test::cahvors()[3], test::cahvors()[4], test::splines()[0],
          test::splines()[1]})
        cameras.push_back(test::wide_truth(projection, 140.0));
    for (const CameraModel& camera : cameras) {
        SCOPED_TRACE(name_of(camera.projection.kind).name);
        const TemporaryFolder folder;
        write_mrcal_camera(folder / "camera.cameramodel", camera);
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

}  // namespace
}  // namespace etalon
