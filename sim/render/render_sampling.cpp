#include "sim/render/render_sampling.h"

#include <fmt/format.h>

#include "core/program/errors.h"
#include "sim/tiles/tile_evaluator.h"

namespace etalon {
namespace {

// docs/rendering.md, "Plan", has the derivations. How the tolerance is shared out:
constexpr double share_of_sampling = 0.7;
constexpr double share_of_lens = 0.1;
constexpr double share_of_diffraction = 0.03;
constexpr double share_of_tail = 0.15;
constexpr double share_of_rounding = 0.02;  // the filter's weights, single precision

// A tolerance that needs more samples a side is refused.
constexpr int max_points = 32, max_boxes = 48;
// Up to these points nothing else is faster, if there is a spread. Beside large cells a table of
// edges and corners has few to look at.
constexpr int few_points = 10, few_points_of_large_cells = 6;
constexpr double large_cell_px = 8.0;
// Below this blur two rims lie within a sample, whatever k.
constexpr double min_blur_for_points_px = 0.02;
// Where the plane of focus crosses the marker: from this blur on, 2 x 2 lens averages per box are
// better than lens points.
constexpr double mixed_from_px = 0.14;

// Samples per pixel side that blurred tiles may take instead of the frame's own.
constexpr std::array coarse_samples{2, 3, 4, 6, 8, 10, 12, 16, 24, 32};
// Of the sampling's share, what their interpolation may use.
constexpr double share_of_coarse = 0.5;
constexpr double coarse_blur_step = 1.25;  // between the radii that are tried

struct Choice {
    int k = 0;  // 0: none is enough
    double gray = 0.0;
    bool is_thinned = false;  // disks: sharp tiles are sampled at 2 k
};

// Time of a pixel, in units of an evaluation: the filter, and evaluations of a sample.
double cost(int k, int evaluations) {
    constexpr double cost_of_filter = 4.0;
    return k * k * (cost_of_filter + evaluations);
}

// Not every k, because each has a filter and bounds that are made when first needed.
constexpr std::array sample_counts{1, 2, 3, 4, 5, 6, 8, 9, 10, 12, 15, 18, 24, 32, 40, 48};

template <class Bound>
Choice least_k(int least, int most, double allowed_gray, const Bound& bound) {
    for (const int k : sample_counts)
        if (k >= least && k <= most)
            if (const double gray = bound(k); gray <= allowed_gray)
                return {k, gray};
    return {};
}

class Chooser {
public:
    Chooser(const ImageExtremes& image, const ImageFilter& filter, const SamplingBound& bound,
            const RenderOptions& options)
        : image_(image), filter_(filter), bound_(bound), options_(options) {
        chosen_.plan.tolerance_gray = options.tolerance_gray;
        chosen_.plan.min_blur_radius_px = image.undistorted_blur.smallest_px;
        chosen_.plan.max_blur_radius_px = image.undistorted_blur.largest_px;
        chosen_.sampling.least_blur_scale = image.bend.least_scale;
        chosen_.sampling.largest_blur_scale = image.bend.largest_scale;
        chosen_.plan.method = options.method;
    }

    RenderSampling choose() {
        if (options_.method == RenderMethod::reference)
            return chosen_;
        leave_out_diffraction();
        leave_out_lens();
        choose_method();
        state_border();
        choose_tail();
        choose_edges();
        return chosen_;
    }

private:
    double allowed(double share) const { return share * options_.tolerance_gray; }

    void leave_out(NeglectedEffect what, std::string why, double gray) {
        chosen_.plan.left_out.push_back({what, std::move(why), gray});
    }
    bool is_automatic() const { return options_.method == RenderMethod::automatic; }

    void leave_out_diffraction() {
        chosen_.with_spread = filter_.has_point_spread();
        if (!chosen_.with_spread)
            return leave_out(NeglectedEffect::diffraction, "the camera states no lens", 0.0);
        const double gray = image_.step * bound_.of_no_spread();
        if (gray > allowed(share_of_diffraction) || options_.keeps(NeglectedEffect::diffraction))
            return;
        chosen_.with_spread = false;
        leave_out(NeglectedEffect::diffraction,
                  fmt::format("a step of {:.3g} keeps its shape to {:.2g} gray", image_.step, gray),
                  gray);
    }

    // A disk of radius R moves an edge's profile f by less than R^2 / 8 |f''|, where f'' is no more
    // than the peak of the line spread; and by less than 2 R / (3 pi), by the box's corner.
    void leave_out_lens() {
        if (options_.keeps(NeglectedEffect::lens))
            return;
        const double gray = allowed(share_of_lens), blur_px = image_.blur.largest_px;
        double& sharp_up_to = chosen_.sampling.sharp_up_to_px;
        sharp_up_to = gray / (255.0 * image_.step * 2.0 / (3.0 * std::numbers::pi));
        double change = 2.0 * blur_px / (3.0 * std::numbers::pi);
        if (chosen_.with_spread) {
            const double peak = bound_.line_spread_peak();
            sharp_up_to =
                std::max(sharp_up_to, std::sqrt(8.0 * gray / (255.0 * image_.step * peak)));
            change = std::min(blur_px * blur_px / 8.0 * peak, change);
        }
        if (blur_px <= sharp_up_to)
            leave_out(NeglectedEffect::lens, fmt::format("blur radius at most {:.2g} px", blur_px),
                      255.0 * image_.step * change);
    }

    // Bounds are of one edge. A pixel sees 1 / cell of them where cells are smaller than it; of
    // very many the errors cancel (measured in tests/sim/render/renderer_test.cpp).
    double edges() const {
        constexpr double most = 8.0;
        return image_.cell_px > 0.0 ? std::clamp(1.0 / image_.cell_px, 1.0, most) : 1.0;
    }
    double step_of_edges() const { return image_.step * edges(); }
    // Short pieces of an edge err as one along the pixels does.
    EdgeTangents tangents() const {
        return edges() > 1.0 ? image_.tangents | EdgeTangents(1) : image_.tangents;
    }

    // Or a fold, which is one.
    bool sees_border() const { return image_.bend.curvature >= UndistortionMap::Bend::most; }

    // Measured: the largest is along the pixels.
    void state_border() {
        constexpr double gray_times_k = 11.2;
        const bool is_interpolated =
            chosen_.with_spread || chosen_.sampling.kind == SampleKind::point;
        if (is_interpolated && sees_border())
            chosen_.plan.border_gray = gray_times_k / chosen_.sampling.k * image_.contrast;
    }

    Choice of_points(int most) const {
        const double blur = image_.blur.smallest_px;
        if (blur < min_blur_for_points_px)
            return {};
        return least_k(min_points(), most, allowed(share_of_sampling),
                       [&](int k) { return step_of_edges() * gray_of_points(k, blur); });
    }
    // The border of the valid region is sharp however blurred the marker is. Measured beside folds:
    // 1.4 gray of a step of 33 with 1 point a side, 0.03 with 4.
    int min_points() const {
        constexpr int at_border = 8;
        return sees_border() ? at_border : 1;
    }
    // Blur disks much smaller than a sample's part cancel along an edge only, not at its end.
    double gray_of_points(int k, double blur_px) const {
        constexpr double min_radius = 0.6;  // of samples
        if (k * blur_px < min_radius)
            return std::numeric_limits<double>::infinity();
        // At the border of the valid region the curvature is a guess, 1: twice that.
        const double safety = sees_border() ? 2.0 : 1.0;
        const double slope = std::min(1.0, 2.0 / (std::numbers::pi * blur_px));
        return bound_.of_points(k, blur_px, tangents()) + safety * slope * gray_of_bend(k);
    }
    // Of a sharp edge across parts of 1 / k px.
    double gray_of_bend(int k) const { return 255.0 * image_.bend.curvature / (24.0 * k * k); }
    Choice of_boxes() const {
        return least_k(fewest_boxes(), max_boxes, allowed(share_of_sampling),
                       [&](int k) { return step_of_edges() * gray_of_boxes(k); });
    }
    bool needs_lens() const { return image_.blur.largest_px > chosen_.sampling.sharp_up_to_px; }

    // Direct samples or, of a coarser grid, thinned ones.
    Choice of_disks() const {
        const DeconvolvedPsf* sharpened = chosen_.with_spread ? filter_.sharpened() : nullptr;
        constexpr double max_curvature = 0.004;
        if (sharpened == nullptr || (needs_lens() && disks_of_lens() == 0) ||
            !image_.bend.is_polynomial || image_.bend.curvature > max_curvature)
            return {};
        const auto gray = [&](int k, bool is_thinned) {
            return step_of_edges() * bound_.of_disks(k, *sharpened,
                                                     disk_blur(image_.blur.smallest_px), tangents(),
                                                     is_thinned);
        };
        if (const int k = options_.samples_per_side; k > 0)
            return {k, gray(k, false)};
        const double enough = allowed(share_of_sampling);
        Choice thinned = least_k(1, max_boxes / 2, enough, [&](int k) { return gray(k, true); });
        thinned.is_thinned = true;
        const Choice direct = least_k(1, thinned.k == 0 ? max_points : 2 * thinned.k, enough,
                                      [&](int k) { return gray(k, false); });
        const bool thin =
            thinned.k > 0 && (direct.k == 0 || cost_of_disks(thinned) < cost_of_disks(direct));
        return thin ? thinned : direct;
    }
    // From this blur radius on; none where the lens is left out.
    DiskBlur disk_blur(double least_px) const {
        const double sharp = chosen_.sampling.sharp_up_to_px;
        return {least_px <= sharp ? 0.0 : least_px, needs_lens() ? image_.blur.largest_px : 0.0,
                one_disk_up_to_px()};
    }
    double one_disk_up_to_px() const {
        return filter_.sharpened()->blur_of_one_disk_px(allowed(share_of_lens) / image_.step);
    }
    double cost_of_disks(const Choice& disks) const {
        const int count = needs_lens() ? disks_of_lens() : 1;
        return cost(disks.k, disks.is_thinned ? 4 * count : count);
    }
    // Concentric disks that stand for a sample's disk and the lens.
    int disks_of_lens() const {
        const double gray = allowed(share_of_lens) / image_.step;
        if (image_.blur.largest_px <= one_disk_up_to_px())
            return 1;
        return filter_.sharpened()->disks_for_any_blur(gray);
    }
    double gray_of_boxes(int k) const {
        return gray_of_bend(k) + (chosen_.with_spread ? bound_.of_boxes(k, tangents()) : 0.0);
    }

    // Of a sharp edge along the pixels under a narrow pattern, which is beyond every k.
    Choice nearly_enough() const {
        constexpr double let_pass = 3.0;
        Choice best;
        for (const int k : {1, 2, 4, 9, 16, 24, 36, max_boxes}) {
            if (k < fewest_boxes())
                continue;
            const double gray = step_of_edges() * gray_of_boxes(k);
            if (gray <= let_pass * edges() * options_.tolerance_gray &&
                (best.k == 0 || gray < 0.8 * best.gray))
                best = {k, gray};
        }
        return best;
    }

    // The mean of 2 x 2 lens averages is a box average only if the boxes are smaller than the blur.
    int fewest_boxes() const { return is_mixed() ? 18 : 1; }

    bool is_mixed() const { return is_automatic() && image_.blur.largest_px > mixed_from_px; }

    // Evaluations per pixel where an edge is.
    double cost_of_boxes(const Choice& boxes) const {
        const double blur = image_.blur.largest_px;
        const int points =
            is_mixed() ? 4 : lens_rule(blur, chosen_.sampling.sharp_up_to_px).points();
        return static_cast<double>(boxes.k) * boxes.k * points;
    }

    // Edges and corners by a table.
    Choice of_wedges() const {
        constexpr double smallest_cells_px = 2.0, steepest_blur = 0.05, largest_asymmetry = 0.01;
        constexpr double most_stretched_px = 0.25, gray_by_curvature = 10.0;
        const UndistortionMap::Bend& bend = image_.bend;
        const double gray =
            step_of_edges() * (WedgeTable::gray + gray_by_curvature * bend.curvature);
        const double stretched =
            (bend.largest_scale / bend.least_scale - 1.0) * image_.blur.largest_px;
        if (!chosen_.with_spread || options_.samples_per_side > 0 || !image_.is_far_from_border ||
            image_.cell_px < smallest_cells_px ||
            image_.blur.largest_px > WedgeTable::largest_blur_px || stretched > most_stretched_px ||
            image_.blur_slope > steepest_blur || image_.blur_asymmetry > largest_asymmetry ||
            gray > allowed(share_of_sampling + share_of_lens) || filter_.wedges() == nullptr)
            return {};
        return {1, gray};
    }

    void choose_method() {
        const bool automatic = is_automatic();
        Choice points, boxes;
        if (automatic ? needs_lens() : options_.method == RenderMethod::exact_lens)
            points = of_points(automatic ? points_worth_no_thought() : max_points);
        if (options_.method != RenderMethod::exact_lens &&
            (points.k == 0 || !chosen_.with_spread)) {
            if (const Choice wedges = automatic ? of_wedges() : Choice{}; wedges.k > 0)
                return take_wedges(wedges);
            const Choice disks = automatic || !needs_lens() ? of_disks() : Choice{};
            if (automatic)
                points = of_points(disks.k == 0 ? max_points : points_worth(disks));
            if (points.k == 0 && disks.k > 0)
                return take_disks(disks);
            boxes = of_boxes();
            if (automatic && boxes.k == 0 && points.k == 0)
                boxes = nearly_enough();
        }
        bool by_points = options_.method == RenderMethod::exact_lens;
        if (automatic)
            by_points =
                points.k > 0 && (boxes.k == 0 || points.k * points.k < cost_of_boxes(boxes));
        if (options_.samples_per_side > 0)
            (by_points ? points : boxes) = forced(by_points);
        const bool lens_points_suffice = automatic || image_.blur.largest_px <= 0.5;
        if ((by_points ? points : boxes).k == 0 ||
            (!by_points && !lens_points_suffice && options_.samples_per_side == 0))
            refuse(by_points);
        by_points ? take_points(points) : take_boxes(boxes);
    }

    int points_worth_no_thought() const {
        const bool few_corners = image_.cell_px >= large_cell_px && of_wedges().k > 0;
        return few_corners ? few_points_of_large_cells : few_points;
    }

    // The largest k of points that costs no more than these disks.
    int points_worth(const Choice& disks) const {
        return static_cast<int>(std::sqrt(cost_of_disks(disks) / cost(1, 1)));
    }

    Choice forced(bool by_points) const {
        const int k = options_.samples_per_side;
        const double blur = std::max(image_.blur.smallest_px, min_blur_for_points_px);
        return {k, step_of_edges() *
                       (by_points ? bound_.of_points(k, blur, tangents()) : gray_of_boxes(k))};
    }

    [[noreturn]] void refuse(bool by_points) const {
        throw NumericalError(fmt::format(
            "{} cannot meet a tolerance of {:.3g} gray for a blur radius from {:.3g} px on with {} "
            "samples a pixel side",
            by_points ? "exact lens averages (E)" : "exact areas (C)", options_.tolerance_gray,
            image_.blur.smallest_px, by_points ? max_points : max_boxes));
    }

    void take(const Choice& choice, RenderMethod method, SampleKind kind) {
        chosen_.plan.method = method;
        chosen_.plan.points_per_pixel_side = chosen_.sampling.k = choice.k;
        chosen_.plan.sampling_gray = choice.gray;
        chosen_.sampling.kind = kind;
    }
    void take_points(const Choice& points) {
        take(points, RenderMethod::exact_lens, SampleKind::point);
        add_coarser(points_of_tile(points.k));
    }
    void take_boxes(const Choice& boxes) {
        take(boxes, RenderMethod::exact_area, SampleKind::box);
        if (is_mixed())
            chosen_.sampling.exact_lens_from_px = mixed_from_px;
        if (is_automatic())
            add_coarser(points_of_tile(2 * boxes.k));
    }

    static int points_of_tile(int k) { return tile_px * k * tile_px * k; }

    // Grids of fewer points than the frame's own, each from the least blur on at which it is
    // enough.
    void add_coarser(int points_of_frame) {
        if (options_.samples_per_side > 0 || image_.blur.largest_px < min_blur_for_points_px)
            return;
        double blur = largest_blur_tried();
        for (const int k : coarse_samples) {
            const int side = TileInterpolation::side(k);
            if (3 * side * side > 2 * points_of_frame)
                return;
            if (const double from = least_blur_of(k, blur); std::isfinite(from))
                chosen_.sampling.coarser.push_back({from, k});
        }
    }

    double largest_blur_tried() const {
        double blur = min_blur_for_points_px;
        while (blur * coarse_blur_step <= image_.blur.largest_px)
            blur *= coarse_blur_step;
        return blur;
    }

    // The least blur, from this one down, at which tiles may be sampled at k; infinite: none.
    // Then `blur` is the next to be tried.
    double least_blur_of(int k, double& blur) const {
        const double gray = share_of_coarse * allowed(share_of_sampling);
        const double least =
            std::max(image_.blur.smallest_px / coarse_blur_step, min_blur_for_points_px);
        double from = std::numeric_limits<double>::infinity();
        for (; blur >= least && step_of_edges() * gray_of_tiles(k, blur) <= gray;
             blur /= coarse_blur_step)
            from = blur;
        return from;
    }

    double gray_of_tiles(int k, double blur_px) const {
        return chosen_.sampling.kind == SampleKind::disk
                   ? bound_.of_disks(k, *filter_.sharpened(), disk_blur(blur_px), tangents())
                   : gray_of_points(k, blur_px);
    }

    void take_disks(const Choice& disks) {
        take(disks, RenderMethod::exact_area, SampleKind::disk);
        Sampling& sampling = chosen_.sampling;
        sampling.disk_radius_px = filter_.sharpened()->disk_radius_px();
        sampling.one_disk_up_to_px = one_disk_up_to_px();
        sampling.disks = needs_lens() ? disks_of_lens() : 1;
        add_coarser(points_of_tile(disks.k));
        if (disks.is_thinned) {
            double blur = largest_blur_tried();
            sampling.direct_from_px = least_blur_of(disks.k, blur);
        }
    }

    void take_wedges(const Choice& wedges) {
        take(wedges, RenderMethod::wedge_table, SampleKind::pixel);
        std::erase_if(chosen_.plan.left_out, [](const NeglectedBound& left) {
            return left.what == NeglectedEffect::lens;
        });
        chosen_.sampling.wedges = filter_.wedges();
        chosen_.sampling.wedge_reach_px = chosen_.sampling.wedges->reach_px(image_.blur.largest_px);
    }

    void choose_tail() {
        if (!chosen_.with_spread || !filter_.has_tail())
            return;
        const double gray = allowed(share_of_tail) / image_.markers;
        RenderPlan& plan = chosen_.plan;
        chosen_.finest_ring = filter_.first_ring();
        if (options_.keeps(NeglectedEffect::tail)) {
            plan.tail_reach_px = std::numeric_limits<double>::infinity();
            return;
        }
        plan.tail_reach_px = filter_.tail_reach_px(image_.contrast, image_.area_px, gray);
        leave_out(NeglectedEffect::tail,
                  fmt::format(
                      "beyond {:.0f} px, a marker {} at contrast {:.2g}", plan.tail_reach_px,
                      std::isfinite(image_.area_px) ? fmt::format("of {:.0f} px^2", image_.area_px)
                                                    : "that the distortion model cuts",
                      image_.contrast),
                  gray);
        if (options_.samples_per_side == 0 && plan.tail_reach_px > 0.0)
            leave_out_fine_rings();
    }

    // Beside a corner two edges add up, among small cells several of them.
    double gray_of_rings(int finest) const {
        constexpr double many_edges_px = 12.0;
        const double edges = image_.cell_px < many_edges_px ? 3.0 : 1.5;
        return edges * image_.step * filter_.gray_of_coarser_ring(finest, image_.blur.smallest_px);
    }

    // Blurred images do not need the finest grids: for what nothing else has used of the tolerance.
    void leave_out_fine_rings() {
        const RenderPlan& plan = chosen_.plan;
        double left = allowed(1.0 - share_of_rounding) - plan.sampling_gray;
        for (const NeglectedBound& omitted : plan.left_out)
            left -= omitted.gray;
        const int first = filter_.first_ring();
        while (chosen_.finest_ring < first + 2 && gray_of_rings(chosen_.finest_ring + 1) <= left)
            ++chosen_.finest_ring;
        if (chosen_.finest_ring > first)
            leave_out(NeglectedEffect::tail,
                      fmt::format("its detail below {} px", 1 << chosen_.finest_ring),
                      gray_of_rings(chosen_.finest_ring));
    }

    // Of the tail only grids of 2 px and more know the edges.
    void choose_edges() {
        constexpr double smallest_cells_px = 40.0;
        const double left = allowed(share_of_sampling) - EdgeTable::gray * image_.step;
        if (!is_automatic() || options_.samples_per_side > 0 ||
            chosen_.sampling.kind != SampleKind::point || !chosen_.with_spread ||
            chosen_.finest_ring < 1 || chosen_.plan.tail_reach_px == 0.0 ||
            image_.cell_px < smallest_cells_px || left <= 0.0 ||
            options_.keeps(NeglectedEffect::uniform_tiles))
            return;
        chosen_.sampling.edges = filter_.edges();
        chosen_.sampling.edge_gray = left;
    }

    const ImageExtremes& image_;
    const ImageFilter& filter_;
    const SamplingBound& bound_;
    const RenderOptions& options_;
    RenderSampling chosen_;
};

}  // namespace

RenderSampling choose_sampling(const ImageExtremes& image, const ImageFilter& filter,
                               const SamplingBound& bound, const RenderOptions& options) {
    return Chooser(image, filter, bound, options).choose();
}

}  // namespace etalon
