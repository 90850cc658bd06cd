#include "bench/published_kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bench/published_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

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

HWY_INLINE Point undistorted(const KernelCamera& camera, Floats pixel_x, Floats pixel_y) {
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
HWY_INLINE Floats radiance(const KernelScene& scene, const Point& x, const Point& l) {
    const Floats zero = hn::Zero(d), one = set(1.0f);
    const Floats inverse_focus = set(scene.inverse_focus);
    Floats seen = set(scene.background), nearest = set(1e30f);
    for (std::size_t g = 0; g < scene.grid_count; ++g) {
        const KernelGrid& grid = scene.grids[g];
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
            hn::And(hn::Ge(u, zero), hn::Lt(u, set(static_cast<float>(grid.columns))));
        const auto in_v = hn::And(hn::Ge(v, zero), hn::Lt(v, set(static_cast<float>(grid.rows))));
        const auto hit = hn::And(front, hn::And(in_u, in_v));
        const auto column = hn::ConvertTo(di, hn::IfThenElseZero(hit, u));
        const auto row = hn::ConvertTo(di, hn::IfThenElseZero(hit, v));
        const auto index = hn::Add(hn::Mul(row, hn::Set(di, grid.columns)), column);
        seen = hn::IfThenElse(hit, hn::GatherIndex(d, grid.cells, index), seen);
        nearest = hn::IfThenElse(hit, z, nearest);
    }
    return seen;
}

}  // namespace

void Undistort(const KernelCamera& camera, const float* pixel_x, float pixel_y, std::size_t count,
               float* x, float* y) {
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
        const Point p = undistorted(camera, hn::LoadU(d, pixel_x + i), set(pixel_y));
        hn::StoreU(p.x, d, x + i);
        hn::StoreU(p.y, d, y + i);
    }
}

void TraceCentreRays(const KernelCamera& camera, const KernelScene& scene, float first_x, float y,
                     std::size_t count, float* result) {
    const Point centre{hn::Zero(d), hn::Zero(d)};
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
        const Floats x = hn::Iota(d, first_x + static_cast<float>(i));
        hn::StoreU(radiance(scene, undistorted(camera, x, set(y)), centre), d, result + i);
    }
}

float MeanOfRays(const KernelCamera& camera, const KernelScene& scene, const KernelRays& rays,
                 float pixel_x, float pixel_y) {
    Floats sum = hn::Zero(d);
    for (std::size_t i = 0; i < rays.n; i += hn::Lanes(d)) {
        const Floats px = hn::Add(set(pixel_x), hn::LoadU(d, rays.pixel_x + i));
        const Floats py = hn::Add(set(pixel_y), hn::LoadU(d, rays.pixel_y + i));
        const Point l{hn::LoadU(d, rays.lens_x + i), hn::LoadU(d, rays.lens_y + i)};
        sum = hn::Add(sum, radiance(scene, undistorted(camera, px, py), l));
    }
    return hn::GetLane(hn::SumOfLanes(d, sum)) / static_cast<float>(rays.n);
}

float MeanOfLinearisedRays(const KernelScene& scene, const KernelRays& rays,
                           const LinearisedPoint& point) {
    Floats sum = hn::Zero(d);
    for (std::size_t i = 0; i < rays.n; i += hn::Lanes(d)) {
        const Floats dx = hn::LoadU(d, rays.pixel_x + i), dy = hn::LoadU(d, rays.pixel_y + i);
        const Point x{
            hn::MulAdd(set(point.x_by_px), dx, hn::MulAdd(set(point.x_by_py), dy, set(point.x))),
            hn::MulAdd(set(point.y_by_px), dx, hn::MulAdd(set(point.y_by_py), dy, set(point.y)))};
        const Point l{hn::LoadU(d, rays.lens_x + i), hn::LoadU(d, rays.lens_y + i)};
        sum = hn::Add(sum, radiance(scene, x, l));
    }
    return hn::GetLane(hn::SumOfLanes(d, sum)) / static_cast<float>(rays.n);
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
            if (row[j] != row[j - 1] || row[j] != row[j + 1] || row[j] != above[j] ||
                row[j] != below[j])
                indices[found++] = static_cast<int>(j);
    }
    return found;
}

void ConvolveRow(const float* image, const KernelTaps& taps, std::size_t count, float* sums) {
    const std::size_t lanes = hn::Lanes(d);
    for (std::size_t i = 0; i < count; i += 4 * lanes) {
        const float* start = image + i;
        Floats a = hn::Zero(d), b = a, c = a, e = a;
        for (std::size_t t = 0; t < taps.count; ++t) {
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
namespace etalon::published {

HWY_EXPORT(Undistort);
HWY_EXPORT(TraceCentreRays);
HWY_EXPORT(MeanOfRays);
HWY_EXPORT(MeanOfLinearisedRays);
HWY_EXPORT(FindEdges);
HWY_EXPORT(ConvolveRow);

void undistort(const KernelCamera& camera, const float* pixel_x, float pixel_y, std::size_t count,
               float* x, float* y) {
    HWY_DYNAMIC_DISPATCH(Undistort)(camera, pixel_x, pixel_y, count, x, y);
}

void trace_centre_rays(const KernelCamera& camera, const KernelScene& scene, float first_x, float y,
                       std::size_t count, float* radiance) {
    HWY_DYNAMIC_DISPATCH(TraceCentreRays)(camera, scene, first_x, y, count, radiance);
}

float mean_of_rays(const KernelCamera& camera, const KernelScene& scene, const KernelRays& rays,
                   float pixel_x, float pixel_y) {
    return HWY_DYNAMIC_DISPATCH(MeanOfRays)(camera, scene, rays, pixel_x, pixel_y);
}

float mean_of_linearised_rays(const KernelScene& scene, const KernelRays& rays,
                              const LinearisedPoint& point) {
    return HWY_DYNAMIC_DISPATCH(MeanOfLinearisedRays)(scene, rays, point);
}

std::size_t find_edges(const float* above, const float* row, const float* below, std::size_t count,
                       int* indices) {
    return HWY_DYNAMIC_DISPATCH(FindEdges)(above, row, below, count, indices);
}

void convolve_row(const float* image, const KernelTaps& taps, std::size_t count, float* sums) {
    HWY_DYNAMIC_DISPATCH(ConvolveRow)(image, taps, count, sums);
}

}  // namespace etalon::published
#endif  // HWY_ONCE
