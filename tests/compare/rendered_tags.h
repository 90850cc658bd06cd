// Exact renderings of tags at poses that spread over position, tilt and sub-pixel phase, and how
// far a detector's corners are from the truth in them.
#pragma once

#include "compare/make_detector.h"
#include "core/statistics/random.h"
#include "sim/render/renderer.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

// A sharp linear camera; nothing but geometry and pixels.
inline CameraModel sharp_camera() {
    return camera_with(640, 480, {700.0, 705.0, 321.7, 238.2});
}

struct RenderedTag {
    CodeImage image;
    std::vector<Eigen::Vector2d> corners;  // the projections of Marker::points_mm
};

inline RenderedTag render_tag(const Renderer& renderer, const Marker& tag, const Rigid& pose) {
    const CameraModel& camera = renderer.camera();
    return {SensorModel(camera).expose(renderer.render({{{tag.grid, pose}}, 1.0}).radiance),
            corners_at(Projector(camera), tag.points_mm, pose)};
}

inline RenderedTag render_tag(const CameraModel& camera, const Marker& tag,
                              const std::array<double, 6>& pose) {
    return render_tag(Renderer(camera), tag, rigid_from_vector(Vector6d(pose.data())));
}

// The largest distance of a point that was found from the truth.
inline double largest_error_px(const std::vector<Eigen::Vector2d>& found,
                               const std::vector<Eigen::Vector2d>& truth) {
    double largest = found.size() == truth.size() ? 0.0 : 1e9;
    for (std::size_t i = 0; i < truth.size() && i < found.size(); ++i)
        largest = std::max(largest, (found[i] - truth[i]).norm());
    return largest;
}

// Of what the tag's own detector finds.
inline double detection_error_px(const Marker& tag, const CodeImage& photo,
                                 const std::vector<Eigen::Vector2d>& truth) {
    const auto found = make_detector("auto", tag, "test")->detect(photo).corners;
    return found && found->id == tag.id ? largest_error_px(found->pixels, truth) : 1e9;
}

struct Offsets {
    int detected = 0;
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();  // found - true, px
    double inward = 0.0;                             // mean of the part towards the tag's centre
    double rms = 0.0;                                // of |found - true|
};

// `count` tags: tilts to 0.35 rad, any roll, all over the image; about 120 px times `scale`.
inline std::vector<RenderedTag> tag_photos(const CameraModel& camera, const Marker& tag, int count,
                                           double scale = 1.0) {
    const Renderer renderer(camera);
    std::vector<RenderedTag> photos;
    for (int n = 0; n < count; ++n) {
        RandomStream random(23, 4, static_cast<std::uint64_t>(n));
        const auto between = [&](double low, double high) {
            return low + (high - low) * random.uniform();
        };
        Vector6d pose{between(-0.35, 0.35), between(-0.35, 0.35), between(-3.1, 3.1),
                      between(-50, 50),     between(-30, 30),     between(270, 310)};
        pose.tail<3>() /= scale;
        photos.push_back(render_tag(renderer, tag, rigid_from_vector(pose)));
    }
    return photos;
}

inline Offsets mean_offset(const std::vector<RenderedTag>& photos, Detector& detector) {
    Offsets offsets;
    for (const RenderedTag& photo : photos) {
        const auto found = detector.detect(photo.image).corners;
        if (!found)
            continue;
        ++offsets.detected;
        Eigen::Vector2d centre = Eigen::Vector2d::Zero();
        for (const Eigen::Vector2d& corner : photo.corners)
            centre += corner / 4.0;
        for (std::size_t i = 0; i < 4; ++i) {
            const Eigen::Vector2d error = found->pixels[i] - photo.corners[i];
            offsets.mean += error;
            offsets.inward += error.dot((centre - photo.corners[i]).normalized());
            offsets.rms += error.squaredNorm();
        }
    }
    const double corners = 4.0 * std::max(offsets.detected, 1);
    offsets.mean /= corners;
    offsets.inward /= corners;
    offsets.rms = std::sqrt(offsets.rms / corners);
    return offsets;
}

}  // namespace etalon::test
