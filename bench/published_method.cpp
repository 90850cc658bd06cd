#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bench/published_method.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <fmt/format.h>

#include <Eigen/LU>
#include <bit>

#include "bench/published_method.h"
#include "core/program/errors.h"
#include "sim/psf/diffraction.h"
#include "sim/scene/marker_view.h"
#include "sim/scene/pose_sampling.h"

#ifndef ETALON_PUBLISHED_METHOD  // once, not for every instruction set
#define ETALON_PUBLISHED_METHOD
namespace etalon::published {

// Loops may read and write this many floats past the count they are given.
constexpr std::size_t slack = 64;

// A marker: h takes an undistorted sensor point (x, y, 1) times its depth to grid coordinates.
struct Grid {
    float h[9];
    cv::Mat cells;  // without gaps
};

struct TracedScene {
    std::vector<Grid> grids;
    float background, inverse_focus;  // 1/z_f, 1/mm
};

// An undistorted sensor point with its derivative by the pixel.
struct LinearisedPoint {
    float x, y, x_by_px, x_by_py, y_by_px, y_by_py;
};

}  // namespace etalon::published
#endif

HWY_BEFORE_NAMESPACE();
namespace etalon::published::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr hn::CappedTag<float, 16> d;  // the slack allows four vectors
constexpr hn::RebindToSigned<decltype(d)> di;
using Floats = hn::Vec<decltype(d)>;

struct Point {
    Floats x, y;
};

HWY_INLINE Floats set(float value) {
    return hn::Set(d, value);
}

// c0 + r (c1 + r (c2 + r c3))
HWY_INLINE Floats cubic(Floats r, float c0, float c1, float c2, float c3) {
    return hn::MulAdd(r, hn::MulAdd(r, hn::MulAdd(r, set(c3), set(c2)), set(c1)), set(c0));
}

HWY_INLINE Point undistorted(const Camera& camera, Floats pixel_x, Floats pixel_y) {
    const Point start{hn::Mul(hn::Sub(pixel_x, set(camera.cx)), set(camera.inverse_fx)),
                      hn::Mul(hn::Sub(pixel_y, set(camera.cy)), set(camera.inverse_fy))};
    const float* k = camera.k;
    Point p = start;
    for (int iteration = 0; iteration < 5; ++iteration) {
        const Floats xx = hn::Mul(p.x, p.x), yy = hn::Mul(p.y, p.y), xy = hn::Mul(p.x, p.y);
        const Floats r2 = hn::Add(xx, yy);
        const Floats inverse =
            hn::Div(cubic(r2, 1.0f, k[5], k[6], k[7]), cubic(r2, 1.0f, k[0], k[1], k[4]));
        const Floats x_prism = hn::Mul(r2, hn::MulAdd(r2, set(k[9]), set(k[8])));
        const Floats y_prism = hn::Mul(r2, hn::MulAdd(r2, set(k[11]), set(k[10])));
        const Floats shift_x = hn::MulAdd(
            set(2.0f * k[2]), xy, hn::MulAdd(set(k[3]), hn::MulAdd(set(2.0f), xx, r2), x_prism));
        const Floats shift_y = hn::MulAdd(
            set(2.0f * k[3]), xy, hn::MulAdd(set(k[2]), hn::MulAdd(set(2.0f), yy, r2), y_prism));
        p.x = hn::Mul(hn::Sub(start.x, shift_x), inverse);
        p.y = hn::Mul(hn::Sub(start.y, shift_y), inverse);
    }
    return p;
}

// A ray through the sensor point x and the lens point l holds the points z (x, 1) + (1 - z / z_f) l
// in the camera frame; the marker's plane is h2 . p = 1.
HWY_INLINE Floats radiance(const TracedScene& scene, const Point& x, const Point& l) {
    const Floats zero = hn::Zero(d), one = set(1.0f);
    const Floats inverse_focus = set(scene.inverse_focus);
    Floats seen = set(scene.background), nearest = set(1e30f);
    for (const Grid& grid : scene.grids) {
        const auto by_depth = [&](int row) {
            const float* h = grid.h + 3 * row;
            return hn::MulAdd(set(h[0]), x.x, hn::MulAdd(set(h[1]), x.y, set(h[2])));
        };
        const auto on_lens = [&](int row) {
            const float* h = grid.h + 3 * row;
            return hn::MulAdd(set(h[0]), l.x, hn::Mul(set(h[1]), l.y));
        };
        const Floats a = on_lens(2), above = hn::Sub(one, a);
        const Floats below = hn::NegMulAdd(a, inverse_focus, by_depth(2));
        const Floats z = hn::Div(above, below);
        const Floats lens_part = hn::NegMulAdd(z, inverse_focus, one);
        const Floats u = hn::MulAdd(z, by_depth(0), hn::Mul(lens_part, on_lens(0)));
        const Floats v = hn::MulAdd(z, by_depth(1), hn::Mul(lens_part, on_lens(1)));
        const auto front =
            hn::And(hn::Gt(above, zero), hn::And(hn::Gt(z, zero), hn::Lt(z, nearest)));
        const auto in_u =
            hn::And(hn::Ge(u, zero), hn::Lt(u, set(static_cast<float>(grid.cells.cols))));
        const auto in_v =
            hn::And(hn::Ge(v, zero), hn::Lt(v, set(static_cast<float>(grid.cells.rows))));
        const auto hit = hn::And(front, hn::And(in_u, in_v));
        const auto* cells = reinterpret_cast<const float*>(grid.cells.data);
        const auto column = hn::ConvertTo(di, hn::IfThenElseZero(hit, u));
        const auto row = hn::ConvertTo(di, hn::IfThenElseZero(hit, v));
        const auto index = hn::Add(hn::Mul(row, hn::Set(di, grid.cells.cols)), column);
        seen = hn::IfThenElse(hit, hn::GatherIndex(d, cells, index), seen);
        nearest = hn::IfThenElse(hit, z, nearest);
    }
    return seen;
}

}  // namespace

void Undistort(const Camera& camera, const float* pixel_x, float pixel_y, std::size_t count,
               float* x, float* y) {
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
        const Point p = undistorted(camera, hn::LoadU(d, pixel_x + i), set(pixel_y));
        hn::StoreU(p.x, d, x + i);
        hn::StoreU(p.y, d, y + i);
    }
}

void TraceCentreRays(const Camera& camera, const TracedScene& scene, float first_x, float y,
                     std::size_t count, float* result) {
    const Point centre{hn::Zero(d), hn::Zero(d)};
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
        const Floats x = hn::Iota(d, first_x + static_cast<float>(i));
        hn::StoreU(radiance(scene, undistorted(camera, x, set(y)), centre), d, result + i);
    }
}

float MeanOfRays(const Camera& camera, const TracedScene& scene, const Rays& rays, float pixel_x,
                 float pixel_y) {
    Floats sum = hn::Zero(d);
    for (std::size_t i = 0; i < rays.pixel_x.size(); i += hn::Lanes(d)) {
        const Floats px = hn::Add(set(pixel_x), hn::LoadU(d, rays.pixel_x.data() + i));
        const Floats py = hn::Add(set(pixel_y), hn::LoadU(d, rays.pixel_y.data() + i));
        const Point l{hn::LoadU(d, rays.lens_x.data() + i), hn::LoadU(d, rays.lens_y.data() + i)};
        sum = hn::Add(sum, radiance(scene, undistorted(camera, px, py), l));
    }
    return hn::GetLane(hn::SumOfLanes(d, sum)) / static_cast<float>(rays.pixel_x.size());
}

float MeanOfLinearisedRays(const TracedScene& scene, const Rays& rays,
                           const LinearisedPoint& point) {
    Floats sum = hn::Zero(d);
    for (std::size_t i = 0; i < rays.pixel_x.size(); i += hn::Lanes(d)) {
        const Floats dx = hn::LoadU(d, rays.pixel_x.data() + i),
                     dy = hn::LoadU(d, rays.pixel_y.data() + i);
        const Point x{
            hn::MulAdd(set(point.x_by_px), dx, hn::MulAdd(set(point.x_by_py), dy, set(point.x))),
            hn::MulAdd(set(point.y_by_px), dx, hn::MulAdd(set(point.y_by_py), dy, set(point.y)))};
        const Point l{hn::LoadU(d, rays.lens_x.data() + i), hn::LoadU(d, rays.lens_y.data() + i)};
        sum = hn::Add(sum, radiance(scene, x, l));
    }
    return hn::GetLane(hn::SumOfLanes(d, sum)) / static_cast<float>(rays.pixel_x.size());
}

std::size_t FindEdges(const float* above, const float* row, const float* below, std::size_t count,
                      int* indices) {
    std::size_t found = 0;
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
        const Floats here = hn::LoadU(d, row + i);
        const auto differs = hn::Or(
            hn::Or(hn::Ne(here, hn::LoadU(d, row + i - 1)),
                   hn::Ne(here, hn::LoadU(d, row + i + 1))),
            hn::Or(hn::Ne(here, hn::LoadU(d, above + i)), hn::Ne(here, hn::LoadU(d, below + i))));
        if (hn::AllFalse(d, differs))
            continue;
        for (std::size_t j = i; j < count && j < i + hn::Lanes(d); ++j)
            if (const float* at = row + j;
                *at != at[-1] || *at != at[1] || *at != above[j] || *at != below[j])
                indices[found++] = static_cast<int>(j);
    }
    return found;
}

void ConvolveRow(const float* image, const Taps& taps, std::size_t count, float* sums) {
    const std::size_t lanes = hn::Lanes(d);
    for (std::size_t i = 0; i < count; i += 4 * lanes) {
        const float* start = image + i;
        Floats a = hn::Zero(d), b = a, c = a, e = a;
        for (std::size_t t = 0; t < taps.offset.size(); ++t) {
            const float* source = start + taps.offset[t];
            const Floats weight = set(taps.weight[t]);
            a = hn::MulAdd(weight, hn::LoadU(d, source), a);
            b = hn::MulAdd(weight, hn::LoadU(d, source + lanes), b);
            c = hn::MulAdd(weight, hn::LoadU(d, source + 2 * lanes), c);
            e = hn::MulAdd(weight, hn::LoadU(d, source + 3 * lanes), e);
        }
        hn::StoreU(a, d, sums + i);
        hn::StoreU(b, d, sums + i + lanes);
        hn::StoreU(c, d, sums + i + 2 * lanes);
        hn::StoreU(e, d, sums + i + 3 * lanes);
    }
}

}  // namespace etalon::published::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {

using namespace published;

namespace published {
HWY_EXPORT(Undistort);
HWY_EXPORT(TraceCentreRays);
HWY_EXPORT(MeanOfRays);
HWY_EXPORT(MeanOfLinearisedRays);
HWY_EXPORT(FindEdges);
HWY_EXPORT(ConvolveRow);
}  // namespace published

namespace {

constexpr int kernel_reach = 5;           // px
constexpr int border = kernel_reach + 1;  // of traced pixels around the image

Camera kernel_camera(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    Camera result{static_cast<float>(1.0 / i.fx),
                  static_cast<float>(1.0 / i.fy),
                  static_cast<float>(i.cx),
                  static_cast<float>(i.cy),
                  {}};
    const auto coefficients = camera.distortion.in_opencv_order();
    std::copy_n(coefficients.begin(), 12, result.k);
    return result;
}

// Camera frame to grid coordinates; nothing where the lens does not look at the front.
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

// The traced pixels, `border` more than the image on each side.
struct PublishedMethod::Frame {
    Frame(const CameraModel& camera, const Scene& scene, double inverse_focus)
        : width(camera.width + 2 * border),
          height(camera.height + 2 * border),
          radiance(height, width + static_cast<int>(slack), CV_32FC1),
          is_edge(cv::Mat::zeros(height, width, CV_8UC1)) {
        traced.background = static_cast<float>(scene.background);
        traced.inverse_focus = static_cast<float>(inverse_focus);
        for (const PlacedMarker& marker : scene.markers)
            if (const auto h = grid_from_camera(marker)) {
                Grid& grid = traced.grids.emplace_back();
                for (int n = 0; n < 9; ++n)
                    grid.h[n] = static_cast<float>((*h)(n / 3, n % 3));
                const cv::Mat& cells = marker.grid.cells;
                grid.cells = cells.isContinuous() ? cells : cells.clone();
            }
    }

    // |1/z - 1/z_f| where the undistorted point meets the markers' planes, the largest, 1/mm.
    float defocus(float x, float y) const {
        float largest = 0.0f;
        for (const Grid& grid : traced.grids)
            largest = std::max(largest, std::abs(grid.h[6] * x + grid.h[7] * y + grid.h[8] -
                                                 traced.inverse_focus));
        return largest;
    }

    TracedScene traced;
    int width, height;
    cv::Mat radiance;  // with slack on the right
    cv::Mat is_edge;
};

PublishedMethod::PublishedMethod(const CameraModel& camera, int rays_per_pixel,
                                 Undistortion undistortion)
    : camera_(camera), undistortion_(undistortion), kernel_camera_(kernel_camera(camera)) {
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
    if (camera.lens) {
        const ThinLens lens = thin_lens(camera);
        lens_radius_mm_ = lens.aperture_diameter_mm / 2.0;
        inverse_focus_per_mm_ = lens.inverse_focus_per_mm;
    }
    make_rays(rays_per_pixel);
    make_kernel();
}

void PublishedMethod::make_rays(int count) {
    const SobolPoints points(count);
    const SobolPoints::Scramble scramble = make_scramble(0, 0, 0, 0);
    for (int i = 0; i < count; ++i) {
        const SobolPoints::Point u = points.point(i, scramble);
        const Eigen::Vector2d lens = lens_radius_mm_ * concentric_disk(u[2], u[3]);
        rays_.pixel_x.push_back(static_cast<float>(u[0] - 0.5));
        rays_.pixel_y.push_back(static_cast<float>(u[1] - 0.5));
        rays_.lens_x.push_back(static_cast<float>(lens.x()));
        rays_.lens_y.push_back(static_cast<float>(lens.y()));
    }
}

void PublishedMethod::make_kernel() {
    if (!camera_.lens) {
        taps_ = {{0}, {1.0f}};
        return;
    }
    const PointSpreadFunction spread = PointSpreadFunction::of(camera_);
    const double height = camera_.intrinsics.fx / camera_.intrinsics.fy;
    cv::Mat_<double> energy(2 * kernel_reach + 1, 2 * kernel_reach + 1);
    for (int y = -kernel_reach; y <= kernel_reach; ++y)
        for (int x = -kernel_reach; x <= kernel_reach; ++x)
            energy(y + kernel_reach, x + kernel_reach) =
                energy_in_pixel(spread, std::abs(x), std::abs(y), height);
    double sum = 0.0;
    for (const double of_pixel : energy)
        sum += of_pixel;
    const int row_step = camera_.width + 2 * border + static_cast<int>(slack);
    for (int y = 0; y < energy.rows; ++y)
        for (int x = 0; x < energy.cols; ++x)
            if (energy(y, x) > 0.0) {
                taps_.offset.push_back((y - kernel_reach) * row_step + x - kernel_reach);
                taps_.weight.push_back(static_cast<float>(energy(y, x) / sum));
            }
}

PublishedMethod::Points PublishedMethod::undistorted(std::vector<float> x, float y) const {
    const std::size_t count = x.size();
    x.resize(count + slack);
    Points points{std::vector<float>(x.size()), std::vector<float>(x.size())};
    HWY_DYNAMIC_DISPATCH(Undistort)
    (kernel_camera_, x.data(), y, count, points.x.data(), points.y.data());
    return points;
}

PublishedImage PublishedMethod::render(const Scene& scene) const {
    check_scene(scene);
    Frame frame(camera_, scene, inverse_focus_per_mm_);
    for (int y = 0; y < frame.height; ++y)
        HWY_DYNAMIC_DISPATCH(TraceCentreRays)
    (kernel_camera_, frame.traced, -border, static_cast<float>(y - border),
     static_cast<std::size_t>(frame.width), frame.radiance.ptr<float>(y));
    for (int y = 1; y < frame.height - 1; ++y)
        mark_row(frame, y);
    const int edge_pixels = refine(frame);
    return {convolved(frame), edge_pixels};
}

// Marks the edge pixels of a row and a disk around each.
void PublishedMethod::mark_row(Frame& frame, int y) const {
    const auto width = static_cast<std::size_t>(frame.width);
    std::vector<int> columns(width);
    const auto values = [&](int at) { return frame.radiance.ptr<float>(at) + 1; };
    columns.resize(HWY_DYNAMIC_DISPATCH(FindEdges)(values(y - 1), values(y), values(y + 1),
                                                   width - 2, columns.data()));
    std::vector<float> pixel_x;
    for (const int column : columns)
        pixel_x.push_back(static_cast<float>(column + 1 - border));
    const Points points = undistorted(std::move(pixel_x), static_cast<float>(y - border));
    const double largest = std::hypot(frame.width, frame.height);
    for (std::size_t i = 0; i < columns.size(); ++i) {
        const double blur =
            lens_radius_mm_ * camera_.intrinsics.fx * frame.defocus(points.x[i], points.y[i]);
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
            frame.radiance.at<float>(y, x) = HWY_DYNAMIC_DISPATCH(MeanOfRays)(
                kernel_camera_, frame.traced, rays_, static_cast<float>(x - border),
                static_cast<float>(y - border));
    }
    return count;
}

// The derivative is a central difference over one pixel.
void PublishedMethod::refine_linearised(Frame& frame, int y,
                                        const std::vector<int>& columns) const {
    const auto moved = [&](float dx, float dy) {
        std::vector<float> pixel_x;
        for (const int column : columns)
            pixel_x.push_back(static_cast<float>(column - border) + dx);
        return undistorted(std::move(pixel_x), static_cast<float>(y - border) + dy);
    };
    const Points centre = moved(0.0f, 0.0f);
    const Points left = moved(-0.5f, 0.0f), right = moved(0.5f, 0.0f);
    const Points above = moved(0.0f, -0.5f), below = moved(0.0f, 0.5f);
    for (std::size_t i = 0; i < columns.size(); ++i)
        frame.radiance.at<float>(y, columns[i]) = HWY_DYNAMIC_DISPATCH(MeanOfLinearisedRays)(
            frame.traced, rays_,
            {centre.x[i], centre.y[i], right.x[i] - left.x[i], below.x[i] - above.x[i],
             right.y[i] - left.y[i], below.y[i] - above.y[i]});
}

Radiance PublishedMethod::convolved(const Frame& frame) const {
    Radiance image(camera_.height, camera_.width, CV_32FC1);
    std::vector<float> row(static_cast<std::size_t>(camera_.width) + slack);
    for (int y = 0; y < camera_.height; ++y) {
        HWY_DYNAMIC_DISPATCH(ConvolveRow)
        (frame.radiance.ptr<float>(y + border) + border, taps_,
         static_cast<std::size_t>(camera_.width), row.data());
        std::copy_n(row.data(), camera_.width, image.ptr<float>(y));
    }
    return image;
}

}  // namespace etalon
#endif  // HWY_ONCE
