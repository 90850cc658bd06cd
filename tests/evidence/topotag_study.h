// Images with and without TopoTags for the figures that the detector claims: the poses of the
// published comparison, and images in which nothing may be found but what is there.
#pragma once

#include <fmt/format.h>

#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "compare/detect/detector_adaptors.h"
#include "compare/detect/topotag/topotag_detector.h"
#include "core/statistics/random.h"
#include "sim/marker/marker.h"
#include "sim/marker/topotag_pattern.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

constexpr double degree = std::numbers::pi / 180.0;

// With a sensor of ordinary noise: 40 electrons a code value, 8 read.
inline CameraModel study_camera() {
    return study_webcam(1000.0, 40.0, 8.0);
}

// The middle of the larger camera's image.
inline CameraModel cropped(CameraModel camera, int width, int height) {
    camera.intrinsics.cx -= (camera.width - width) / 2;
    camera.intrinsics.cy -= (camera.height - height) / 2;
    camera.width = width;
    camera.height = height;
    return camera;
}

class Draw {
public:
    Draw(std::uint32_t stream, std::uint64_t index) : random_(20211, stream, index) {}
    double between(double low, double high) { return low + (high - low) * random_.uniform(); }
    int below(int count) {
        return std::min(count - 1, static_cast<int>(random_.uniform() * count));
    }
    double normal() { return random_.normal(); }

private:
    RandomStream random_;
};

// Normal noise for many images, cut from one field: drawing it again would cost more than all the
// rest. CV_32FC1, deviation 1.
inline cv::Mat noise_window(Draw& draw, const cv::Size& size) {
    constexpr int side = 1400;
    static const cv::Mat field = [] {
        cv::Mat all(side, side, CV_32FC1);
        RandomStream random(20212, 0);
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x)
                all.at<float>(y, x) = static_cast<float>(random.normal());
        return all;
    }();
    return field(cv::Rect(draw.below(side - size.width), draw.below(side - size.height), size.width,
                          size.height));
}

// Photon and read noise of a camera, before its curve.
inline Radiance with_noise(const Radiance& radiance, const CameraModel& camera, Draw& draw) {
    const double full = (1 << camera.sensor->bits) - 1, gain = camera.sensor->gain_e_per_dn;
    const double read = camera.sensor->read_noise_e / gain / full;
    cv::Mat deviation;
    cv::sqrt(cv::max(radiance, 0.0) / (gain * full) + read * read, deviation);
    return radiance + deviation.mul(noise_window(draw, radiance.size()));
}

struct SeenTag {
    Rigid camera_from_marker;
    std::vector<Eigen::Vector2d> vertices;
    double side_px = 0.0;  // of the white square, mean of its four sides
};

// The tag at a pose, when all of it with its frame is in the image.
inline std::optional<SeenTag> seen_tag(const Projector& projector, const Marker& tag,
                                       const Rigid& pose) {
    const CameraModel& camera = projector.camera();
    const double frame =
        0.5 + topotag_frame / static_cast<double>(topotag_white_side(topotag_order(tag.family)));
    std::array<Eigen::Vector2d, 4> corners;
    for (const bool outside : {true, false}) {
        const double half = tag.size_mm * (outside ? frame : 0.5);
        const std::array<Eigen::Vector3d, 4> square = {
            {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}}};
        for (std::size_t i = 0; i < 4; ++i) {
            const auto pixel = projector.project(pose * square[i]);
            if (!pixel || !(pixel->minCoeff() >= 0.0 && pixel->x() <= camera.width - 1.0 &&
                            pixel->y() <= camera.height - 1.0))
                return std::nullopt;
            corners[i] = *pixel;
        }
    }
    SeenTag seen{pose, {}, 0.0};
    for (std::size_t i = 0; i < 4; ++i)
        seen.side_px += (corners[(i + 1) % 4] - corners[i]).norm() / 4.0;
    for (const Eigen::Vector3d& point : tag.points_mm)
        seen.vertices.push_back(projector.project(pose * point).value());
    return seen;
}

// z 500 to 1500 mm or as given, roll and pitch +-`tilt`, any yaw, R = Rz(yaw) Ry(pitch) Rx(roll),
// all over the image.
inline SeenTag study_pose(const Projector& projector, const Marker& tag, Draw& draw, double near_mm,
                          double far_mm, double tilt_deg) {
    using Eigen::AngleAxisd, Eigen::Vector3d;
    const CameraModel& camera = projector.camera();
    for (;;) {
        const double tilt = tilt_deg * degree, z = draw.between(near_mm, far_mm);
        const AngleAxisd roll(draw.between(-tilt, tilt), Vector3d::UnitX()),
            pitch(draw.between(-tilt, tilt), Vector3d::UnitY()),
            yaw(draw.between(-180.0, 180.0) * degree, Vector3d::UnitZ());
        const double x = draw.between(0, camera.width - 1), y = draw.between(0, camera.height - 1);
        const Vector3d place((x - camera.intrinsics.cx) / camera.intrinsics.fx * z,
                             (y - camera.intrinsics.cy) / camera.intrinsics.fy * z, z);
        if (const auto seen = seen_tag(projector, tag, {yaw * pitch * roll, place}))
            return *seen;
    }
}

inline std::vector<DetectedCorners> find_in(const CodeImage& image, const std::string& family) {
    return find_topotags(image.pixels, as_float(image), family);
}

// Pictures without the family that is looked for, by kind.
class Distraction {
public:
    static constexpr const char* names[] = {
        "white noise",   "blurred noise",  "gradient and noise", "dead leaves",    "rings and dots",
        "other markers", "other TopoTags", "mirrored TopoTag",   "covered TopoTag"};
    static constexpr int kinds = static_cast<int>(std::size(names));

    Distraction(const Renderer& renderer, const SensorModel& sensor)
        : camera_(renderer.camera()), renderer_(renderer), sensor_(sensor) {}

    CodeImage picture(int kind, std::uint64_t index, const std::string& family) const {
        Draw draw(7, index);
        switch (kind) {
            case 0:
                return noise(draw, 0.0);
            case 1:
                return noise(draw, draw.between(0.5, 6.0));
            case 2:
                return gradient(draw);
            case 3:
                return dead_leaves(draw);
            case 4:
                return rings(draw);
            case 5:
                return other_markers(draw);
            case 6:
                return topotag(draw, other_family(draw, family), false, false);
            case 7:
                return topotag(draw, family, true, false);
            default:
                return topotag(draw, family, false, true);
        }
    }

    static Marker random_tag(Draw& draw, const std::string& family, double size_mm) {
        return parse_marker(
            fmt::format("topotag:{}:{}@{}mm", family, draw.below(topotag_count(family)), size_mm),
            "study");
    }

private:
    cv::Mat blank(double level) const {
        return cv::Mat(camera_.height, camera_.width, CV_32FC1, cv::Scalar::all(level));
    }

    static void add_noise(cv::Mat& image, Draw& draw, double deviation) {
        image += noise_window(draw, image.size()) * deviation;
    }

    CodeImage eight_bit(const cv::Mat& image) const {
        CodeImage result;
        image.convertTo(result.pixels, CV_8U, 255.0);
        return result;
    }

    CodeImage noise(Draw& draw, double blur_px) const {
        cv::Mat image = blank(0.0);
        add_noise(image, draw, 1.0);
        if (blur_px > 0.0)
            cv::GaussianBlur(image, image, {}, blur_px);
        cv::Scalar mean, deviation;
        cv::meanStdDev(image, mean, deviation);
        return eight_bit((image - mean) * (draw.between(0.02, 0.6) / deviation[0]) + 0.5);
    }

    CodeImage gradient(Draw& draw) const {
        cv::Mat image = blank(draw.between(0.2, 0.8));
        const double gx = draw.between(-0.6, 0.6), gy = draw.between(-0.6, 0.6);
        for (int y = 0; y < image.rows; ++y)
            for (int x = 0; x < image.cols; ++x)
                image.at<float>(y, x) +=
                    static_cast<float>(gx * x / image.cols + gy * y / image.rows);
        add_noise(image, draw, draw.between(0.0, 0.03));
        return eight_bit(image);
    }

    // A thousand rectangles and ellipses of all sizes, each over the others, with the sizes' power
    // law of natural images (Lee, Mumford, Huang, Int. J. Computer Vision 41, 2001).
    CodeImage dead_leaves(Draw& draw) const {
        cv::Mat image = blank(0.5);
        const double smallest = draw.between(1.5, 8.0);
        for (int i = 0; i < 1000; ++i) {
            const double radius = smallest / std::sqrt(draw.between(1e-3, 1.0));
            const cv::Point2f place(static_cast<float>(draw.between(0, image.cols)),
                                    static_cast<float>(draw.between(0, image.rows)));
            const auto side = [&] { return static_cast<float>(radius * draw.between(0.5, 2.0)); };
            const cv::RotatedRect box(place, {side(), side()},
                                      static_cast<float>(draw.between(0, 180)));
            const cv::Scalar gray = cv::Scalar::all(draw.between(0.0, 1.0));
            if (draw.below(2) == 0) {
                cv::ellipse(image, box, gray, cv::FILLED);
            } else {
                cv::Point2f corner[4];
                box.points(corner);
                const std::vector<cv::Point> polygon(corner, corner + 4);
                cv::fillConvexPoly(image, polygon, gray);
            }
        }
        cv::GaussianBlur(image, image, {}, draw.between(0.3, 1.5));
        add_noise(image, draw, 0.01);
        return eight_bit(image);
    }

    // Lattices of black spots with and without white dots: nearly TopoTags.
    CodeImage rings(Draw& draw) const {
        cv::Mat image = blank(0.1);
        const int count = 3 + draw.below(3);
        const double spacing = draw.between(8.0, 40.0), left = draw.between(5.0, 40.0),
                     top = draw.between(5.0, 40.0);
        const auto disk = [&](double x, double y, double radius, double gray) {
            constexpr int bits = 4;
            cv::circle(image,
                       {cvRound((left + x * spacing) * (1 << bits)),
                        cvRound((top + y * spacing) * (1 << bits))},
                       cvRound(radius * spacing * (1 << bits)), cv::Scalar::all(gray), cv::FILLED,
                       cv::LINE_AA, bits);
        };
        cv::rectangle(image, cv::Point2d(left, top),
                      cv::Point2d(left + (count + 0.25) * spacing, top + (count + 0.25) * spacing),
                      cv::Scalar::all(0.9), cv::FILLED);
        const double jitter = draw.below(2) == 0 ? 0.0 : draw.between(0.02, 0.2);
        const int doubled = draw.below(count * count);
        for (int i = 0; i < count * count; ++i) {
            const double x = i % count + 0.625 + jitter * draw.normal(),
                         y = i / count + 0.625 + jitter * draw.normal();
            disk(x, y, 0.375, 0.1);
            if (i == doubled) {
                disk(x - 0.16, y, 0.1, 0.9);
                disk(x + 0.16, y, 0.1, 0.9);
            } else if (draw.below(2) == 0) {
                disk(x, y, 0.125, 0.9);
            }
        }
        add_noise(image, draw, draw.between(0.0, 0.03));
        return eight_bit(image);
    }

    CodeImage other_markers(Draw& draw) const {
        static const std::vector<Marker> markers = [] {
            std::vector<Marker> all;
            for (const char* spec :
                 {"apriltag:36h11:5@50mm", "apriltag:Standard41h12:17@50mm", "aruco:4X4_50:7@50mm",
                  "aruco:6X6_250:33@50mm", "chessboard:6x5@8mm", "charuco:4X4_50:5x4@12mm/9mm",
                  "aprilgrid:36h11:3x2@15mm/5mm", "circles:4x4@12mm/7mm", "circles:5x3@12mm/9mm",
                  "acircles:3x5@8mm/6mm"})
                all.push_back(parse_marker(spec, "study"));
            return all;
        }();
        return exposed(
            draw,
            markers[static_cast<std::size_t>(draw.below(static_cast<int>(markers.size())))].grid);
    }

    static std::string other_family(Draw& draw, const std::string& family) {
        const int order = topotag_order(family), other = 3 + (order - 3 + 1 + draw.below(3)) % 4;
        return fmt::format("{}x{}{}", other, other, draw.below(2) == 0 ? "" : "-circle");
    }

    CodeImage topotag(Draw& draw, const std::string& family, bool mirrored, bool covered) const {
        CellGrid grid = random_tag(draw, family, 50.0).grid;
        if (mirrored)
            cv::flip(grid.cells, grid.cells, 1);
        if (covered) {
            // A strip from a side, over at least a whole row of nodes.
            constexpr double min_cells = topotag_margin + topotag_frame + topotag_spacing + 0.5;
            const int cells = grid.cells.cols,
                      cell = cells / (topotag_white_side(topotag_order(family)) +
                                      2 * (topotag_margin + topotag_frame)),
                      strip = static_cast<int>(draw.between(min_cells * cell, 0.6 * cells));
            const cv::Rect part = draw.below(2) == 0 ? cv::Rect(0, 0, strip, cells)
                                                     : cv::Rect(0, cells - strip, cells, strip);
            grid.cells(part).setTo(cv::Scalar::all(draw.below(2)));
        }
        return exposed(draw, grid);
    }

    CodeImage exposed(Draw& draw, const CellGrid& grid) const {
        using Eigen::AngleAxisd, Eigen::Vector3d;
        const double z = draw.between(250.0, 1500.0);
        const auto angle = [&](double most) { return draw.between(-most, most) * degree; };
        const Rigid pose{AngleAxisd(angle(180), Vector3d::UnitZ()) *
                             AngleAxisd(angle(45), Vector3d::UnitY()) *
                             AngleAxisd(angle(45), Vector3d::UnitX()),
                         {draw.between(-0.1, 0.1) * z, draw.between(-0.08, 0.08) * z, z}};
        const Scene scene{{{grid, pose}}, draw.between(0.1, 1.0)};
        const Radiance radiance = renderer_.render(scene, {.tolerance_gray = 0.5}).radiance;
        return sensor_.expose(with_noise(radiance, camera_, draw));
    }

    const CameraModel& camera_;
    const Renderer& renderer_;
    const SensorModel& sensor_;
};

}  // namespace etalon::test
