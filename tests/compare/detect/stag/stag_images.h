// Images with and without STag markers, made by OpenCV's warping and not by our renderer: to see
// what the finder takes for a marker. An image is a pure function of its number.
#pragma once

#include <Eigen/Geometry>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "compare/detect/stag/stag_detector.h"
#include "core/statistics/random.h"
#include "sim/marker/board_pattern.h"
#include "sim/marker/tag_pattern.h"

namespace etalon::test {

enum class StagImageKind {
    noise,
    clouds,   // noise of all sizes, as natural textures have
    shapes,   // rectangles, ellipses, lines and polygons on a gradient
    tags,     // AprilTags and ArUco tags
    boards,   // chessboards and circle grids
    strange,  // STag markers of other families
    marker,   // one of the markers looked for
    cropped,  // one of them with a part outside the image or covered
    kinds
};
inline constexpr int stag_image_kinds = static_cast<int>(StagImageKind::kinds);

struct StagImage {
    StagImageKind kind;
    cv::Mat pixels;                          // CV_8UC1, 640x480
    int id = -1;                             // of the marker in it
    std::array<Eigen::Vector2d, 4> corners;  // its black square's
};

class StagImages {
public:
    // `words` are those looked for.
    StagImages(std::vector<StagCode> words, std::uint64_t seed)
        : words_(std::move(words)), seed_(seed) {
        for (const char* family : {"HD17", "HD19", "HD21", "HD23"})
            for (const StagCode word : stag_codes(family))
                strange_.push_back(word);
    }

    StagImage make(std::uint64_t number) const {
        RandomStream random(seed_, 1, number);
        StagImage image{static_cast<StagImageKind>(number % stag_image_kinds), {}, -1, {}};
        cv::Mat scene = background(image.kind, random);
        switch (image.kind) {
            case StagImageKind::shapes:
                draw_shapes(scene, random);
                break;
            case StagImageKind::tags:
                for (int i = 0; i < 3; ++i)
                    place(tag_cells(random), random, scene);
                break;
            case StagImageKind::boards:
                place(board_cells(random), random, scene);
                break;
            case StagImageKind::strange:
                place(stag_cells(strange_[below(random, strange_.size())]), random, scene);
                break;
            case StagImageKind::marker:
            case StagImageKind::cropped:
                place_marker(image, random, scene);
                break;
            default:
                break;
        }
        image.pixels = photograph(scene, random);
        return image;
    }

private:
    static double between(RandomStream& random, double low, double high) {
        return low + (high - low) * random.uniform();
    }
    static std::size_t below(RandomStream& random, std::size_t count) {
        return std::min(count - 1,
                        static_cast<std::size_t>(random.uniform() * static_cast<double>(count)));
    }

    static cv::Mat noise(cv::Size size, RandomStream& random) {
        cv::Mat field(size, CV_32FC1);
        cv::RNG generator(random.bits());
        generator.fill(field, cv::RNG::UNIFORM, 0.0, 1.0);
        return field;
    }

    static cv::Mat clouds(RandomStream& random) {
        const double roughness = between(random, 0.4, 1.0);
        cv::Mat sum(480, 640, CV_32FC1, cv::Scalar::all(0.0));
        double weight = 1.0;
        for (int cell = 256; cell >= 2; cell /= 2, weight *= roughness) {
            cv::Mat octave;
            cv::resize(noise({640 / cell + 2, 480 / cell + 2}, random), octave, {640, 480}, 0, 0,
                       cv::INTER_CUBIC);
            sum += weight * octave;
        }
        cv::normalize(sum, sum, between(random, 0.0, 0.3), between(random, 0.6, 1.0),
                      cv::NORM_MINMAX);
        return sum;
    }

    static cv::Mat gradient(RandomStream& random) {
        cv::Mat corners = 0.2 + 0.8 * noise({2, 2}, random), field;
        cv::resize(corners, field, {640, 480}, 0, 0, cv::INTER_LINEAR);
        return field;
    }

    static cv::Mat background(StagImageKind kind, RandomStream& random) {
        if (kind == StagImageKind::noise)
            return noise({640, 480}, random);
        if (kind == StagImageKind::clouds || random.uniform() < 0.3)
            return clouds(random);
        return gradient(random);
    }

    static void draw_shapes(cv::Mat& scene, RandomStream& random) {
        const auto point = [&] {
            return cv::Point(static_cast<int>(between(random, 0, 640)),
                             static_cast<int>(between(random, 0, 480)));
        };
        for (int i = 0; i < 30; ++i) {
            const cv::Scalar shade = cv::Scalar::all(random.uniform());
            const double what = random.uniform();
            const cv::Size2f size(static_cast<float>(between(random, 10, 200)),
                                  static_cast<float>(between(random, 10, 200)));
            const cv::RotatedRect box(point(), size, static_cast<float>(between(random, 0, 360)));
            if (what < 0.3) {
                cv::ellipse(scene, box, shade, cv::FILLED);
            } else if (what < 0.8) {
                cv::Point2f corners[4];
                box.points(corners);
                const std::vector<cv::Point> outline(corners, corners + 4);
                cv::fillConvexPoly(scene, outline, shade);
                if (what < 0.5)  // a dark frame around a disk, as the markers are
                    cv::ellipse(scene,
                                {box.center, {0.8f * size.width, 0.8f * size.height}, box.angle},
                                cv::Scalar::all(random.uniform()), cv::FILLED);
            } else {
                const cv::Point from = point(), to = point();
                cv::line(scene, from, to, shade, 1 + static_cast<int>(below(random, 12)));
            }
        }
    }

    static cv::Mat tag_cells(RandomStream& random) {
        const auto& families = random.uniform() < 0.5 ? apriltag_families() : aruco_dictionaries();
        const std::string& family = families[below(random, families.size())];
        const bool apriltag = &families == &apriltag_families();
        const int ids = apriltag ? apriltag_count(family) : aruco_count(family);
        const int id = static_cast<int>(below(random, static_cast<std::size_t>(ids)));
        return apriltag ? apriltag_pattern(family, id).cells : aruco_pattern(family, id).cells;
    }

    static cv::Mat board_cells(RandomStream& random) {
        if (random.uniform() < 0.5)
            return chessboard_pattern(3 + static_cast<int>(below(random, 7)), 4, 10.0).grid.cells;
        return circles_pattern(CircleLayout::symmetric, 4, 3, 20.0, 14.0).grid.cells;
    }

    // Where a pinhole of 800 px would see a square of side 1 at a random pose: the image from the
    // marker's plane. Sides of 20 to 300 px.
    static Eigen::Matrix3d random_view(RandomStream& random) {
        const double side_px = 20.0 * std::pow(15.0, random.uniform());
        const double tilt = between(random, 0.0, 1.1), towards = between(random, 0.0, 6.28);
        const Eigen::AngleAxisd lean(tilt,
                                     Eigen::Vector3d(std::cos(towards), std::sin(towards), 0));
        const Eigen::AngleAxisd turn(between(random, 0.0, 6.28), Eigen::Vector3d::UnitZ());
        const Eigen::Matrix3d rotation = (lean * turn).toRotationMatrix();
        const Eigen::Vector3d centre(between(random, 0, 640) - 320, between(random, 0, 480) - 240,
                                     800.0);
        Eigen::Matrix3d camera;
        camera << 800, 0, 320, 0, 800, 240, 0, 0, 1;
        Eigen::Matrix3d view;
        view << rotation.col(0), rotation.col(1), centre / side_px;
        return camera * view;
    }

    // Draws cells, `side` of them to the unit of the view, centred; returns what they cover.
    static void draw(const cv::Mat& cells, double side, const Eigen::Matrix3d& view,
                     cv::Mat& scene) {
        const int magnified = std::max(1, 300 / cells.cols);
        cv::Mat fine;
        cv::resize(cells, fine, {}, magnified, magnified, cv::INTER_NEAREST);
        const double unit = side * magnified;  // px of `fine`; its pixels' centres are at 0.5
        Eigen::Matrix3d from_fine;
        from_fine << 1 / unit, 0, (0.5 - fine.cols / 2.0) / unit,  //
            0, 1 / unit, (0.5 - fine.rows / 2.0) / unit, 0, 0, 1;
        const Eigen::Matrix3d all = view * from_fine;
        const double scale =
            std::sqrt(std::abs(view.determinant() / std::pow(view(2, 2), 3))) / unit;
        if (scale < 1.0)
            cv::GaussianBlur(fine, fine, {}, 0.4 / scale, 0, cv::BORDER_REPLICATE);
        cv::Mat map(3, 3, CV_64FC1), warped, seen;
        for (int i = 0; i < 9; ++i)
            map.at<double>(i / 3, i % 3) = all(i / 3, i % 3);
        cv::warpPerspective(fine, warped, map, scene.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT,
                            cv::Scalar::all(0.0));
        cv::warpPerspective(cv::Mat(fine.size(), CV_32FC1, cv::Scalar::all(1.0)), seen, map,
                            scene.size(), cv::INTER_LINEAR);
        // Printed in black of 0.05 on paper of 0.9.
        scene = scene.mul(1.0 - seen) + (0.05 * seen + 0.85 * warped);
    }

    static void place(const cv::Mat& cells, RandomStream& random, cv::Mat& scene) {
        draw(cells, std::max(cells.cols, cells.rows), random_view(random), scene);
    }

    void place_marker(StagImage& image, RandomStream& random, cv::Mat& scene) const {
        image.id = static_cast<int>(below(random, words_.size()));
        const Eigen::Matrix3d view = random_view(random);
        draw(stag_cells(words_[static_cast<std::size_t>(image.id)]), stag_cells_a_side, view,
             scene);
        const Eigen::Vector2d square[] = {{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}};
        for (std::size_t i = 0; i < 4; ++i)
            image.corners[i] = (view * square[i].homogeneous()).hnormalized();
        if (image.kind != StagImageKind::cropped)
            return;
        const Eigen::Vector2d a = image.corners[below(random, 4)];
        const double reach =
            between(random, 0.1, 0.7) * (image.corners[2] - image.corners[0]).norm();
        cv::circle(scene, cv::Point(static_cast<int>(a.x()), static_cast<int>(a.y())),
                   static_cast<int>(reach), cv::Scalar::all(random.uniform()), cv::FILLED);
    }

    static cv::Mat photograph(cv::Mat scene, RandomStream& random) {
        cv::GaussianBlur(scene, scene, {}, between(random, 0.4, 1.2));
        const double exposure = between(random, 0.3, 1.05), noise_rms = between(random, 0.0, 0.02);
        cv::Mat grain(scene.size(), CV_32FC1), pixels;
        cv::RNG generator(random.bits());
        generator.fill(grain, cv::RNG::NORMAL, 0.0, noise_rms);
        cv::Mat(exposure * scene + grain).convertTo(pixels, CV_8U, 255.0);
        return pixels;
    }

    std::vector<StagCode> words_, strange_;
    std::uint64_t seed_;
};

// Right and wrong of what was found in an image.
struct StagTally {
    int images = 0;
    int found = 0;      // the marker that is there, refined
    int unrefined = 0;  // it was read, but a detector would not report it
    int false_ids = 0;  // refined, with the word of a marker that is not there
    int misplaced = 0;  // refined, the right word, a corner too far off

    // A corner may be off by 1 px and a hundredth of the marker's diagonal: the finder promises a
    // standard deviation of at most 0.25 px for the worst one, the warped images are good to
    // 0.2 px.
    void add(const StagImage& image, const std::vector<FoundStag>& all) {
        ++images;
        const auto is_placed = [&](const FoundStag& one) {
            const double allowed = 1.0 + (image.corners[2] - image.corners[0]).norm() / 100.0;
            return std::ranges::equal(
                one.corners, image.corners,
                [&](const auto& p, const auto& q) { return (p - q).norm() <= allowed; });
        };
        for (const FoundStag& one : all)
            ++(!one.is_refined      ? unrefined
               : one.id != image.id ? false_ids
               : is_placed(one)     ? found
                                    : misplaced);
    }
};

}  // namespace etalon::test
