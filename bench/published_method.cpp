#include "bench/published_method.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <bit>
#include <numbers>

#include "bench/published_kernels.h"
#include "core/program/errors.h"
#include "sim/psf/diffraction.h"
#include "sim/scene/marker_view.h"
#include "sim/scene/pose_sampling.h"

namespace etalon {
namespace published {

struct LensDisk {
    double radius_mm = 0.0, inverse_focus_per_mm = 0.0;
};

}  // namespace published
namespace {

using namespace published;

constexpr int kernel_reach = 5;           // px
constexpr int border = kernel_reach + 1;  // of traced pixels around the image

LensDisk lens_disk(const CameraModel& camera) {
    if (!camera.lens)
        return {};
    const ThinLens lens = thin_lens(camera);
    return {lens.aperture_diameter_mm / 2.0, lens.inverse_focus_per_mm};
}

KernelCamera kernel_camera(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    KernelCamera result{};
    result.inverse_fx = static_cast<float>(1.0 / i.fx);
    result.inverse_fy = static_cast<float>(1.0 / i.fy);
    result.cx = static_cast<float>(i.cx);
    result.cy = static_cast<float>(i.cy);
    const auto coefficients = camera.distortion.in_opencv_order();
    std::transform(coefficients.begin(), coefficients.begin() + 12, result.k,
                   [](double k) { return static_cast<float>(k); });
    return result;
}

// From camera-frame points of the marker's plane to grid coordinates; nothing where the lens does
// not look at the marker's front.
std::optional<Eigen::Matrix3d> grid_from_camera(const PlacedMarker& marker) {
    const Eigen::Matrix3d rotation = marker.camera_from_marker.rotation.toRotationMatrix();
    const Eigen::Vector3d corner = marker.camera_from_marker * marker.grid.point_mm(0, 0);
    if (!(rotation.col(2).dot(corner) > 0.0))
        return std::nullopt;
    Eigen::Matrix3d camera_from_grid;
    camera_from_grid << marker.grid.cell_mm.x() * rotation.col(0),
        marker.grid.cell_mm.y() * rotation.col(1), corner;
    return camera_from_grid.inverse();
}

// Energy of the point spread in the pixel (dx, dy), as far as it lies within the kernel's reach:
// midpoint rule. A pixel is `height` as high as it is wide.
double energy_in_pixel(const PointSpreadFunction& spread, int dx, int dy, double height) {
    constexpr int steps = 64;
    double sum = 0.0;
    for (int j = 0; j < steps; ++j)
        for (int i = 0; i < steps; ++i) {
            const double r =
                std::hypot(dx + (i + 0.5) / steps - 0.5, height * (dy + (j + 0.5) / steps - 0.5));
            if (r < kernel_reach)
                sum += spread.density(r);
        }
    return sum * height / (steps * steps);
}

}  // namespace

namespace published {

// The scene in the kernels' words; holds what they point to.
struct TracedScene {
    TracedScene(const Scene& scene, double inverse_focus) {
        for (const PlacedMarker& marker : scene.markers) {
            const auto h = grid_from_camera(marker);
            if (!h)
                continue;
            cells.push_back(marker.grid.cells.isContinuous() ? marker.grid.cells
                                                             : marker.grid.cells.clone());
            KernelGrid grid{};
            for (int n = 0; n < 9; ++n)
                grid.h[n] = static_cast<float>((*h)(n / 3, n % 3));
            grid.cells = cells.back().ptr<float>();
            grid.columns = marker.grid.columns();
            grid.rows = marker.grid.rows();
            grids.push_back(grid);
        }
        kernel.grids = grids.data();
        kernel.grid_count = grids.size();
        kernel.background = static_cast<float>(scene.background);
        kernel.inverse_focus = static_cast<float>(inverse_focus);
    }

    // |1/z - 1/z_f| where the undistorted point meets the markers' planes, the largest, 1/mm.
    float defocus(float x, float y) const {
        float largest = 0.0f;
        for (const KernelGrid& grid : grids)
            largest = std::max(largest, std::abs(grid.h[6] * x + grid.h[7] * y + grid.h[8] -
                                                 kernel.inverse_focus));
        return largest;
    }

    std::vector<cv::Mat> cells;
    std::vector<KernelGrid> grids;
    KernelScene kernel{};
};

}  // namespace published

// The traced pixels, `border` more than the image on each side.
struct PublishedMethod::Frame {
    Frame(const CameraModel& model, const Scene& scene)
        : camera(kernel_camera(model)),
          lens(lens_disk(model)),
          traced(scene, lens.inverse_focus_per_mm),
          width(model.width + 2 * border),
          height(model.height + 2 * border),
          radiance(height, width + static_cast<int>(slack), CV_32FC1),
          is_edge(cv::Mat::zeros(height, width, CV_8UC1)) {}

    KernelCamera camera;
    LensDisk lens;
    TracedScene traced;
    int width, height;
    cv::Mat radiance;  // with slack on the right
    cv::Mat is_edge;
};

PublishedMethod::PublishedMethod(const CameraModel& camera, int rays_per_pixel,
                                 Undistortion undistortion)
    : camera_(camera), undistortion_(undistortion) {
    if (camera.width < 1 || camera.height < 1)
        throw NumericalError(
            fmt::format("no camera has an image of {} x {} px", camera.width, camera.height));
    require_perspective(camera, "the published method");
    if (camera.distortion.tau_x != 0.0 || camera.distortion.tau_y != 0.0 ||
        camera.distortion.k7 != 0.0)
        throw NumericalError("the published method knows no tilted sensor");
    if (rays_per_pixel < 64 || rays_per_pixel > 65536 ||
        !std::has_single_bit(static_cast<unsigned>(rays_per_pixel)))
        throw NumericalError(
            fmt::format("{} rays are not a power of two from 64 to 65536", rays_per_pixel));
    make_rays(rays_per_pixel);
    make_kernel();
}

void PublishedMethod::make_rays(int count) {
    const double radius = lens_disk(camera_).radius_mm;
    const SobolPoints points(count);
    const SobolPoints::Scramble scramble = make_scramble(0, 0, 0, 0);
    for (int i = 0; i < count; ++i) {
        const SobolPoints::Point u = points.point(i, scramble);
        const Eigen::Vector2d lens = radius * concentric_disk(u[2], u[3]);
        pixel_x_.push_back(static_cast<float>(u[0] - 0.5));
        pixel_y_.push_back(static_cast<float>(u[1] - 0.5));
        lens_x_.push_back(static_cast<float>(lens.x()));
        lens_y_.push_back(static_cast<float>(lens.y()));
    }
}

void PublishedMethod::make_kernel() {
    if (!camera_.lens) {
        taps_ = {{0, 0, 1.0f}};
        return;
    }
    const PointSpreadFunction spread = PointSpreadFunction::of(camera_);
    const double height = camera_.intrinsics.fx / camera_.intrinsics.fy;
    cv::Mat_<double> quarter(kernel_reach + 1, kernel_reach + 1);
    for (int y = 0; y <= kernel_reach; ++y)
        for (int x = 0; x <= kernel_reach; ++x)
            quarter(y, x) = energy_in_pixel(spread, x, y, height);
    double sum = 0.0;
    for (int y = -kernel_reach; y <= kernel_reach; ++y)
        for (int x = -kernel_reach; x <= kernel_reach; ++x)
            sum += quarter(std::abs(y), std::abs(x));
    for (int y = -kernel_reach; y <= kernel_reach; ++y)
        for (int x = -kernel_reach; x <= kernel_reach; ++x)
            if (const double energy = quarter(std::abs(y), std::abs(x)); energy > 0.0)
                taps_.push_back({x, y, static_cast<float>(energy / sum)});
}

PublishedImage PublishedMethod::render(const Scene& scene) const {
    check_scene(scene);
    Frame frame(camera_, scene);
    trace_centre_rays(frame);
    mark_edges(frame);
    const int edge_pixels = refine(frame);
    return {convolved(frame), edge_pixels};
}

void PublishedMethod::trace_centre_rays(Frame& frame) const {
    for (int y = 0; y < frame.height; ++y)
        published::trace_centre_rays(
            frame.camera, frame.traced.kernel, -border, static_cast<float>(y - border),
            static_cast<std::size_t>(frame.width), frame.radiance.ptr<float>(y));
}

void PublishedMethod::mark_edges(Frame& frame) const {
    for (int y = 1; y < frame.height - 1; ++y)
        mark_row(frame, y);
}

// Marks the edge pixels of a row and a disk around each.
void PublishedMethod::mark_row(Frame& frame, int y) const {
    const auto width = static_cast<std::size_t>(frame.width);
    std::vector<int> columns(width);
    columns.resize(find_edges(frame.radiance.ptr<float>(y - 1) + 1,
                              frame.radiance.ptr<float>(y) + 1,
                              frame.radiance.ptr<float>(y + 1) + 1, width - 2, columns.data()));
    std::vector<float> pixel_x(columns.size() + slack), x(pixel_x.size()), point_y(pixel_x.size());
    for (std::size_t i = 0; i < columns.size(); ++i)
        pixel_x[i] = static_cast<float>(columns[i] + 1 - border);
    undistort(frame.camera, pixel_x.data(), static_cast<float>(y - border), columns.size(),
              x.data(), point_y.data());
    const double largest = std::hypot(frame.width, frame.height);
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const double blur =
            frame.lens.radius_mm * camera_.intrinsics.fx * frame.traced.defocus(x[i], point_y[i]);
        const int reach = 1 + static_cast<int>(std::ceil(std::min(blur, largest)));
        const int centre = columns[i] + 1;
        for (int row = std::max(0, y - reach); row <= std::min(frame.height - 1, y + reach);
             ++row) {
            const double rise = row - y;
            const int half = static_cast<int>(std::sqrt(reach * reach - rise * rise));
            const int first = std::max(0, centre - half);
            const int end = std::min(frame.width, centre + half + 1);
            std::fill(frame.is_edge.ptr(row) + first, frame.is_edge.ptr(row) + end, uchar{1});
        }
    }
}

// Replaces the edge pixels that the convolution reaches; returns how many.
int PublishedMethod::refine(Frame& frame) const {
    const KernelRays rays{pixel_x_.data(), pixel_y_.data(), lens_x_.data(), lens_y_.data(),
                          pixel_x_.size()};
    int count = 0;
    std::vector<int> columns;
    for (int y = 1; y < frame.height - 1; ++y) {
        columns.clear();
        for (int x = 1; x < frame.width - 1; ++x)
            if (frame.is_edge.at<uchar>(y, x) != 0)
                columns.push_back(x);
        count += static_cast<int>(columns.size());
        if (undistortion_ == Undistortion::linearised) {
            refine_linearised(frame, y, columns);
            continue;
        }
        for (const int x : columns)
            frame.radiance.at<float>(y, x) =
                mean_of_rays(frame.camera, frame.traced.kernel, rays,
                             static_cast<float>(x - border), static_cast<float>(y - border));
    }
    return count;
}

// The derivative is a central difference over one pixel.
void PublishedMethod::refine_linearised(Frame& frame, int y,
                                        const std::vector<int>& columns) const {
    const KernelRays rays{pixel_x_.data(), pixel_y_.data(), lens_x_.data(), lens_y_.data(),
                          pixel_x_.size()};
    struct Points {
        std::vector<float> x, y;
    };
    const auto undistorted = [&](float dx, float dy) {
        std::vector<float> pixel_x(columns.size() + slack);
        for (std::size_t i = 0; i < columns.size(); ++i)
            pixel_x[i] = static_cast<float>(columns[i] - border) + dx;
        Points points{std::vector<float>(pixel_x.size()), std::vector<float>(pixel_x.size())};
        undistort(frame.camera, pixel_x.data(), static_cast<float>(y - border) + dy, columns.size(),
                  points.x.data(), points.y.data());
        return points;
    };
    const Points centre = undistorted(0.0f, 0.0f);
    const Points left = undistorted(-0.5f, 0.0f), right = undistorted(0.5f, 0.0f);
    const Points above = undistorted(0.0f, -0.5f), below = undistorted(0.0f, 0.5f);
    for (std::size_t i = 0; i < columns.size(); ++i)
        frame.radiance.at<float>(y, columns[i]) = mean_of_linearised_rays(
            frame.traced.kernel, rays,
            {centre.x[i], centre.y[i], right.x[i] - left.x[i], below.x[i] - above.x[i],
             right.y[i] - left.y[i], below.y[i] - above.y[i]});
}

Radiance PublishedMethod::convolved(const Frame& frame) const {
    const auto pitch = static_cast<std::ptrdiff_t>(frame.radiance.step1());
    std::vector<std::ptrdiff_t> offsets;
    std::vector<float> weights;
    for (const Tap& tap : taps_) {
        offsets.push_back(tap.dy * pitch + tap.dx);
        weights.push_back(tap.weight);
    }
    const KernelTaps taps{offsets.data(), weights.data(), taps_.size()};
    Radiance image(camera_.height, camera_.width, CV_32FC1);
    std::vector<float> row(static_cast<std::size_t>(camera_.width) + slack);
    for (int y = 0; y < camera_.height; ++y) {
        convolve_row(frame.radiance.ptr<float>(y + border) + border, taps,
                     static_cast<std::size_t>(camera_.width), row.data());
        std::copy_n(row.data(), camera_.width, image.ptr<float>(y));
    }
    return image;
}

}  // namespace etalon
