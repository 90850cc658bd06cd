// From samples of the aperture average to pixels: convolution with (pixel box * point spread),
// split by radius into a core at k samples per pixel and rings of the diffraction tail, each twice
// as wide and on a grid twice as coarse. Weights: docs/rendering.md, "Filter".
#pragma once

#include "sim/psf/deconvolved_psf.h"
#include "sim/tiles/core_filter.h"
#include "sim/tiles/sampling.h"

namespace etalon {

// A value that is made when it is first asked for. Safe from every thread.
template <class T>
class Lazy {
public:
    template <class Make>
    const T& get(const Make& make) const {
        std::call_once(made_, [&] { value_.emplace(make()); });
        return *value_;
    }

private:
    mutable std::once_flag made_;
    mutable std::optional<T> value_;
};

// Smooth ring of radii: 0 up to rise_from, 1 from rise_to to fall_from, 0 from fall_to.
struct RadialWindow {
    double rise_from = -1, rise_to = -1, fall_from, fall_to;

    double operator()(double r) const;
};

// Safe from every thread.
class ImageFilter {
public:
    // No lens section: pixels are box averages, no tail.
    explicit ImageFilter(const CameraModel& camera);

    bool has_point_spread() const { return psf_.has_value(); }
    const PointSpreadFunction* point_spread() const { return psf_ ? &*psf_ : nullptr; }
    bool has_tail() const { return psf_ && psf_->is_airy(); }

    // What follows is made when first asked for.

    // What sharp images can be sampled for; nullptr where there is none.
    const DeconvolvedPsf* sharpened() const;

    // The core beside straight edges; nullptr where pixels are not square or the core is wide.
    const EdgeTable* edges() const;

    // The core beside edges and corners of sharp images; nullptr where pixels are not square or the
    // spread does not suit.
    const WedgeTable* wedges() const;

    // On samples at k per pixel; disk samples need sharpened().
    const FilterKernel& core(int k, SampleKind kind) const;

    // The tail's rings: each works on averages over 2^shift px squares, from the shift first_ring()
    // on, at radii from 1.65 to 6.6 squares and more.
    int first_ring() const { return first_shift_; }
    // The ring of a grid (k = 1), at the squares' centres; `and_finer`: with the part of all finer
    // ones, for images too blurred to need these.
    const FilterKernel& ring(int shift, bool and_finer) const;
    // Core and the rings on grids finer than `shift` hold the whole pattern up to this radius, px
    // along x.
    double radius_held(int shift) const {
        return std::ldexp(1.5 * split_px_, shift - first_shift_);
    }
    // What it changes at most, beside an edge of contrast 1 with this blur radius, that a grid up
    // to two steps coarser than the first ring's takes its part: gray.
    double gray_of_coarser_ring(int shift, double blur_px) const;

    // How far around a pixel the core and a ring on pixel averages look, px.
    int reach_px() const;

    // The tail beyond this radius (px along x) changes no pixel by more than `allowed_gray`, with
    // `contrast` over `area_px` pixels at most: from the energy beyond r, or area times largest
    // density there. 0 when the core's part is enough. Airy only.
    double tail_reach_px(double contrast, double area_px, double allowed_gray) const;

private:
    using Kernels = std::map<std::pair<int, int>, Lazy<FilterKernel>>;

    bool has_square_pixels() const;
    const Lazy<FilterKernel>& slot(Kernels& kernels, std::pair<int, int> key) const;
    FilterKernel make_core(int k, SampleKind kind) const;
    FilterKernel make_ring(int shift, bool and_finer) const;

    std::optional<PointSpreadFunction> psf_;
    double pitch_y_ = 1.0;   // a pixel's height in units of its width
    double split_px_ = 1.0;  // s: the core ends between 1.5 s and 3 s
    int first_shift_ = 0;
    RadialWindow core_{-1, -1, 0, 0};
    Lazy<std::optional<DeconvolvedPsf>> sharpened_;
    Lazy<std::unique_ptr<const EdgeTable>> edges_;
    Lazy<std::unique_ptr<const WedgeTable>> wedges_;
    mutable std::mutex mutex_;
    mutable Kernels cores_, rings_;  // by k and kind, by shift and whether alone
};

}  // namespace etalon
