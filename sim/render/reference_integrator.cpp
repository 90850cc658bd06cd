#include "sim/render/reference_integrator.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/point_spread_sampler.h"
#include "sim/render/wave_render.h"
#include "sim/scene/pose_sampling.h"

namespace etalon {
namespace {

struct Hit {
    double depth, radiance;
};

// A ray's point at a parameter, which grows along it, is from + parameter * along.
struct Ray {
    Eigen::Vector3d from, along;
};

// A marker in whose own frame rays are traced.
struct TracedMarker {
    const CellGrid& grid;
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;  // of marker_from_camera

    // Of the marker's whole plane; 0 or less: never met going forward.
    double inverse_depth(const Ray& ray) const {
        return -(rotation * ray.along).z() / (rotation * ray.from + translation).z();
    }

    // Where the ray meets the marker's front, if it does.
    std::optional<Hit> hit(const Ray& ray) const {
        const Eigen::Vector3d from = rotation * ray.from + translation;
        const Eigen::Vector3d along = rotation * ray.along;
        const bool towards_front = from.z() < 0.0 && along.z() > 0.0;
        if (!towards_front)
            return std::nullopt;
        const double depth = -from.z() / along.z();
        const double u = (from.x() + depth * along.x() - grid.corner_mm.x()) / grid.cell_mm.x();
        const double v = (from.y() + depth * along.y() - grid.corner_mm.y()) / grid.cell_mm.y();
        if (!(u >= 0.0 && v >= 0.0 && u < grid.columns() && v < grid.rows()))
            return std::nullopt;
        return Hit{depth, grid.cells.at<float>(static_cast<int>(v), static_cast<int>(u))};
    }
};

// A pixel that has a ray; of a flat projection with the linear start for Newton's method.
struct PixelRay {
    cv::Point pixel;
    Eigen::Vector2d x = Eigen::Vector2d::Zero();
    Eigen::Matrix2d x_by_pixel = Eigen::Matrix2d::Zero();
};

// Perspective: (z x + l (1 - z / z_f), z) passes l at depth 0 and the focus plane at z_f x.
// Telecentric: (x + l (z - z_f), z), l the tangents of the ray's angles.
Ray flat_ray(const Aperture& aperture, const Eigen::Vector2d& x, const Eigen::Vector2d& l) {
    const double focus = aperture.focus(x);
    Ray ray{Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ()};
    if (aperture.projection == Projection::telecentric) {
        ray.from.head<2>() = x - focus * l;
        ray.along.head<2>() = l;
    } else {
        ray.from.head<2>() = l;
        ray.along.head<2>() = x - focus * l;
    }
    return ray;
}

// Of a wide lens: from the point l of the disc that faces the chief ray, of length 1, to where that
// ray is sharp.
Ray wide_ray(const Aperture& aperture, const Eigen::Vector3d& chief, const Eigen::Vector2d& l) {
    const Eigen::Vector3d across = chief.unitOrthogonal(), other = chief.cross(across);
    const Eigen::Vector3d from = l.x() * across + l.y() * other;
    return {from, chief - aperture.focus_on_axis * from};
}

// Sum over the samples of each scramble so far, as differences from the background.
struct Sums {
    std::vector<double> by_scramble;
    int samples = 0;  // of each
};

class Integrator {
public:
    Integrator(const CameraModel& camera, const Scene& scene, const ReferenceOptions& options)
        : camera_(camera),
          scene_(scene),
          options_(options),
          projector_(camera),
          aperture_(aperture_of(camera)),
          points_(options.samples_per_scramble) {
        for (const PlacedMarker& marker : scene.markers) {
            const Rigid marker_from_camera = marker.camera_from_marker.inverse();
            markers_.push_back({marker.grid, marker_from_camera.rotation.toRotationMatrix(),
                                marker_from_camera.translation});
        }
        if (camera.lens && camera.lens->psf.kind == PointSpread::Kind::wave)
            wave_.emplace(lambda_n_px(camera), max_wave_blur_px);
        else if (camera.lens)
            spread_.emplace(camera);
    }

    std::optional<PixelRay> ray(const cv::Point& pixel) const {
        const auto x = projector_.undistorted({pixel.x, pixel.y});
        if (!x)
            return std::nullopt;
        if (!camera_.projection.is_flat())
            return PixelRay{pixel};
        return PixelRay{pixel, *x, projector_.pixel_by_normalised(*x).inverse()};
    }

    // Continues every scramble's sequence up to `samples`.
    void extend(const PixelRay& ray, int samples, Sums& sums) const {
        sums.by_scramble.resize(static_cast<std::size_t>(options_.scrambles), 0.0);
        for (int s = 0; s < options_.scrambles; ++s) {
            const auto scramble = make_scramble(
                options_.seed, static_cast<std::uint32_t>(ray.pixel.x),
                static_cast<std::uint32_t>(ray.pixel.y), static_cast<std::uint32_t>(s));
            double sum = 0.0;
            for (int i = sums.samples; i < samples; ++i)
                sum += difference(ray, points_.point(i, scramble));
            sums.by_scramble[static_cast<std::size_t>(s)] += sum;
        }
        sums.samples = samples;
    }

    ReferencePixel result(const Sums& sums) const {
        const double scrambles = options_.scrambles;
        double mean = 0.0, square = 0.0;
        for (const double sum : sums.by_scramble)
            mean += sum / sums.samples / scrambles;
        for (const double sum : sums.by_scramble) {
            const double deviation = sum / sums.samples - mean;
            square += deviation * deviation;
        }
        return {scene_.background + mean, std::sqrt(square / (scrambles - 1.0) / scrambles)};
    }

private:
    // Weighted radiance of one sample minus the background.
    double difference(const PixelRay& ray, const SobolPoints::Point& u) const {
        Eigen::Vector2d offset(u[0] - 0.5, u[1] - 0.5);
        Eigen::Vector2d l(0.0, 0.0);
        double weight = 1.0;
        if (spread_) {
            l = aperture_.radius_mm * concentric_disk(u[2], u[3]);
            const auto energy = PointSpreadSampler::energy(u[4]);
            offset += on_sensor(spread_->radius_of(energy.within), u[5]);
            weight = energy.weight;
        } else if (wave_) {
            const auto seen = undistorted(ray, offset);
            if (!seen)
                return 0.0;
            const auto energy = PointSpreadSampler::energy(u[4]);
            offset += on_sensor(wave_->radius_of(energy.within, blur_radius_px(*seen)), u[5]);
            weight = energy.weight;
        }
        const auto seen_by = ray_of(ray, offset, l);
        return seen_by ? weight * (radiance(*seen_by) - scene_.background) : 0.0;
    }

    std::optional<Ray> ray_of(const PixelRay& ray, const Eigen::Vector2d& offset,
                              const Eigen::Vector2d& l) const {
        if (!camera_.projection.is_flat()) {
            const auto chief = projector_.ray(Eigen::Vector2d(ray.pixel.x, ray.pixel.y) + offset);
            return chief ? std::optional(wide_ray(aperture_, *chief, l)) : std::nullopt;
        }
        const auto x = undistorted(ray, offset);
        return x ? std::optional(flat_ray(aperture_, *x, l)) : std::nullopt;
    }

    // A point of the pattern, px. It is round on the sensor; a pixel is fx/fy as high as wide, and
    // leans with a skew.
    Eigen::Vector2d on_sensor(double radius, double turn) const {
        const double angle = 2.0 * std::numbers::pi * turn;
        const Eigen::Vector2d point(std::cos(angle), std::sin(angle));
        return radius / camera_.intrinsics.fx * camera_.intrinsics.pixel_by_plane() * point;
    }

    // Of the (only) marker's plane where the chief ray of a sensor point meets it.
    double blur_radius_px(const Eigen::Vector2d& x) const {
        const Ray ray = flat_ray(aperture_, x, Eigen::Vector2d::Zero());
        const double inverse_depth = markers_.front().inverse_depth(ray);
        const double focus = aperture_.focus(x);
        const double defocus = camera_.projection.kind == Projection::telecentric
                                   ? 1.0 / inverse_depth - focus
                                   : inverse_depth - focus;
        return camera_.intrinsics.fx * aperture_.radius_mm * std::abs(defocus);
    }

    // Newton's method from the linear guess; the projector's safeguarded one where it fails.
    std::optional<Eigen::Vector2d> undistorted(const PixelRay& ray,
                                               const Eigen::Vector2d& offset) const {
        const Eigen::Vector2d pixel(ray.pixel.x + offset.x(), ray.pixel.y + offset.y());
        const Eigen::Vector2d target = camera_.intrinsics.on_plane(pixel);
        if (images_lines_straight(camera_))
            return target;
        Eigen::Vector2d x = ray.x + ray.x_by_pixel * offset;
        for (int iteration = 0; iteration < 4; ++iteration) {
            if (!projector_.valid_region().contains(x))
                break;
            const Distorted d = distort(camera_.distortion, x);
            if (!d.is_regular())
                break;
            const Eigen::Vector2d error = target - d.point;
            x += d.jacobian.inverse() * error;
            // Quadratic convergence: the step after an error of 1e-7 leaves about 1e-13.
            if (error.squaredNorm() < 1e-14)
                return x;
        }
        return projector_.unproject(pixel);
    }

    double radiance(const Ray& ray) const {
        double nearest = std::numeric_limits<double>::infinity();
        double seen = scene_.background;
        for (const TracedMarker& marker : markers_)
            if (const auto hit = marker.hit(ray); hit && hit->depth < nearest) {
                nearest = hit->depth;
                seen = hit->radiance;
            }
        return seen;
    }

    const CameraModel& camera_;
    const Scene& scene_;
    const ReferenceOptions& options_;
    Projector projector_;
    Aperture aperture_;
    std::optional<PointSpreadSampler> spread_;  // with a lens, one of the two
    std::optional<WaveTable> wave_;
    SobolPoints points_;
    std::vector<TracedMarker> markers_;
};

void check(const CameraModel& camera, const Scene& scene, const ReferenceOptions& options) {
    check_scene(scene);
    check_reach(scene, camera);
    if (camera.lens && camera.lens->psf.kind == PointSpread::Kind::wave)
        check_wave_scene(scene, camera);
    else if (camera.lens)
        PointSpreadFunction::of(camera);  // refuses what is not a point spread
    const int n = options.samples_per_scramble;
    if (options.scrambles < 2 || n < 1 || n > (1 << 24) || (n & (n - 1)) != 0)
        throw NumericalError(
            fmt::format("a reference needs two scrambles and a power of two samples, not {} and {}",
                        options.scrambles, n));
    if (!(options.stop_at_gray >= 0.0))
        throw NumericalError(fmt::format("cannot stop at {} gray", options.stop_at_gray));
}

// Samples per scramble of the first pass over an image that may stop early.
constexpr int first_samples = 4;
constexpr int pass_factor = 4;

}  // namespace

std::vector<ReferencePixel> integrate_reference(const CameraModel& camera, const Scene& scene,
                                                const std::vector<cv::Point>& pixels,
                                                const ReferenceOptions& options) {
    check(camera, scene, options);
    const Integrator integrator(camera, scene, options);
    std::vector<ReferencePixel> results(pixels.size(), {scene.background, 0.0});
    tbb::parallel_for(std::size_t{0}, pixels.size(), [&](std::size_t i) {
        throw_if_stopped(options.stop);
        if (const auto ray = integrator.ray(pixels[i])) {
            Sums sums;
            integrator.extend(*ray, options.samples_per_scramble, sums);
            results[i] = integrator.result(sums);
        }
    });
    return results;
}

ReferenceImage integrate_reference(const CameraModel& camera, const Scene& scene,
                                   const cv::Rect& region, const ReferenceOptions& options) {
    check(camera, scene, options);
    const Integrator integrator(camera, scene, options);
    ReferenceImage image{cv::Mat(region.size(), CV_32FC1, cv::Scalar(scene.background)),
                         cv::Mat::zeros(region.size(), CV_32FC1)};
    std::vector<Sums> sums(static_cast<std::size_t>(region.area()));
    cv::Mat unfinished(region.size(), CV_8UC1, cv::Scalar(255));
    int samples = options.stop_at_gray > 0.0 ? std::min(first_samples, options.samples_per_scramble)
                                             : options.samples_per_scramble;
    for (;;) {
        tbb::parallel_for(0, region.height, [&](int y) {
            for (int x = 0; x < region.width; ++x) {
                if (unfinished.at<uchar>(y, x) == 0)
                    continue;
                throw_if_stopped(options.stop);
                const auto ray = integrator.ray(region.tl() + cv::Point(x, y));
                if (!ray)
                    continue;
                Sums& pixel = sums[static_cast<std::size_t>(y * region.width + x)];
                integrator.extend(*ray, samples, pixel);
                const ReferencePixel result = integrator.result(pixel);
                image.mean.at<float>(y, x) = static_cast<float>(result.mean);
                image.standard_error.at<float>(y, x) = static_cast<float>(result.standard_error);
            }
        });
        if (samples == options.samples_per_scramble)
            return image;
        cv::dilate(image.standard_error > options.stop_at_gray / 255.0, unfinished, cv::Mat());
        samples = std::min(samples * pass_factor, options.samples_per_scramble);
    }
}

}  // namespace etalon
