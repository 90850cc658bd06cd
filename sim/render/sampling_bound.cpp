#include "sim/render/sampling_bound.h"

#include <cmath>

#include "sim/tiles/tile_interpolation.h"

namespace etalon {
namespace {

constexpr double full_scale_gray = 255.0;
// Steps of the edge's place and of the spread in a sample's width.
constexpr int steps_per_sample = 8;
// How far a spread is followed; the energy beyond counts as if it smoothed nothing.
double reach_of(const PointSpreadFunction& spread) {
    return std::clamp(8.0 * spread.scale_px(), 2.0, 16.0);
}

// Part of the blur disk (radius 1) beyond a line at t from its centre, and that part's integral
// from -infinity to t.
double segment(double t) {
    if (std::abs(t) >= 1.0)
        return t > 0.0 ? 1.0 : 0.0;
    const double q = std::sqrt(1.0 - t * t);
    return (std::atan2(q, -t) + t * q) / std::numbers::pi;
}
double segment_integral(double t) {
    if (std::abs(t) >= 1.0)
        return std::max(t, 0.0);
    const double q = std::sqrt(1.0 - t * t);
    return t * segment(t) + 2.0 / (3.0 * std::numbers::pi) * q * q * q;
}

// Pixel box of an edge under a blur disk, at `offset` beyond the edge.
double exact_box(double offset, double blur_px) {
    return blur_px * (segment_integral((offset + 0.5) / blur_px) -
                      segment_integral((offset - 0.5) / blur_px));
}

double symmetric(const std::vector<double>& values, int n) {
    return values[static_cast<std::size_t>(std::abs(n))];
}

// What blurs an edge: the mean over some disks.
struct BlurDisk {
    double radius_px, weight;
};

template <class OfDisk>
double mean(const std::vector<BlurDisk>& disks, const OfDisk& of_disk) {
    double sum = 0.0;
    for (const BlurDisk& disk : disks)
        sum += disk.weight * of_disk(disk.radius_px);
    return sum;
}

// An edge under blur disks, by the place in steps, `reach` of them on both sides.
std::vector<double> edge_values(const std::vector<BlurDisk>& disks, double step, int reach) {
    std::vector<double> values;
    for (int n = -reach; n <= reach; ++n)
        values.push_back(mean(disks, [&](double radius) { return segment(n * step / radius); }));
    return values;
}

// The same as samples that are thinned out from twice as many see it
// (sim/tiles/tile_interpolation.h).
std::vector<double> thinned(const std::vector<double>& values) {
    std::vector<double> result;
    constexpr int fine_step = steps_per_sample / 2;
    const int last = static_cast<int>(values.size()) - 1;
    const auto at = [&](int n) { return values[static_cast<std::size_t>(std::clamp(n, 0, last))]; };
    for (int n = 0; n <= last; ++n) {
        double sum = 0.0;
        for (int tap = 0; tap < std::ssize(TileInterpolation::low_pass); ++tap) {
            const int distance = fine_step * tap + fine_step / 2;
            sum += TileInterpolation::low_pass[static_cast<std::size_t>(tap)] *
                   (at(n - distance) + at(n + distance));
        }
        result.push_back(sum);
    }
    return result;
}

// Errors of a pixel's box, spread by `spread` (symmetric, in bins of a step), over the interpolant
// of k point samples a pixel of an edge under blur disks: by the place of the edge, in steps from
// the pixel's centre, the middle element at it.
std::vector<float> point_errors(int k, const std::vector<BlurDisk>& disks, bool is_thinned,
                                const std::vector<double>& spread) {
    const int steps_per_px = steps_per_sample * k;
    const double step = 1.0 / steps_per_px;
    const int bins = static_cast<int>(spread.size()) - 1;
    const int margin = bins / steps_per_sample + 4;
    std::vector<double> response;  // of a pixel's box to a sample, by their distance in steps
    for (int n = 0; n <= bins + steps_per_sample * (margin + k); ++n) {
        const double samples = static_cast<double>(n) / steps_per_sample;
        response.push_back(lagrange6_integral(samples - 0.5 * k, samples + 0.5 * k) / k);
    }
    std::vector<int> places;  // of the samples, in steps
    std::vector<double> weights;
    for (int i = -margin; i < k + margin; ++i) {
        places.push_back(steps_per_sample * (2 * i + 1 - k) / 2);
        double weight = 0.0;
        for (int b = -bins; b <= bins; ++b)
            weight += symmetric(spread, b) * symmetric(response, b - places.back());
        weights.push_back(weight);
    }
    const double blur_px = std::ranges::max(disks, {}, &BlurDisk::radius_px).radius_px;
    const int reach = static_cast<int>(std::ceil((blur_px + 0.5) * steps_per_px)) + bins;
    std::vector<double> exact;  // by |offset|, for offsets of up to reach + bins; 1 - f(-x) = f(x)
    for (int m = 0; m <= reach + bins; ++m)
        exact.push_back(mean(disks, [&](double radius) { return exact_box(m * step, radius); }));
    const int farthest = reach + places.back() + 2 * steps_per_sample;
    const std::vector<double> edge = edge_values(disks, step, farthest);
    const std::vector<double> seen = is_thinned ? thinned(edge) : edge;
    std::vector<float> errors(static_cast<std::size_t>(2 * reach + 1));
    for (int m = -reach; m <= 0; ++m) {  // the errors of edges at m and -m are opposite
        double error = 0.0;
        for (std::size_t i = 0; i < places.size(); ++i)
            error += weights[i] * seen[static_cast<std::size_t>(farthest + places[i] - m)];
        for (int b = -bins; b <= bins; ++b) {
            const double value = symmetric(exact, b - m);
            error -= symmetric(spread, b) * (b - m >= 0 ? value : 1.0 - value);
        }
        errors[static_cast<std::size_t>(reach + m)] = static_cast<float>(error);
        errors[static_cast<std::size_t>(reach - m)] = static_cast<float>(-error);
    }
    return errors;
}

// The sharpened spread seen along one axis, in bins of a step.
std::vector<double> line(const DeconvolvedPsf& sharpened, int k) {
    const int bins_per_px = steps_per_sample * k;
    std::vector<double> bins(static_cast<std::size_t>(sharpened.reach_px() * bins_per_px) + 2);
    for (std::size_t b = 0; b < bins.size(); ++b)
        bins[b] = sharpened.line(static_cast<double>(b) / bins_per_px) / bins_per_px;
    return bins;
}

// What stands for a sample's disk and a blur.
std::vector<BlurDisk> two_disks(double disk_px, double blur_px) {
    std::vector<BlurDisk> disks;
    for (const ConcentricDisk& one : concentric_disks(2))
        disks.push_back({std::sqrt(blur_px * blur_px + disk_px * disk_px +
                                   2.0 * one.cosine * blur_px * disk_px),
                         one.weight});
    return disks;
}

// The largest error of an edge that moves by `tangent` samples from each of a pixel's k rows of
// samples to the next.
double largest_over_rows(const std::vector<float>& errors, int k, double tangent) {
    const double shift = steps_per_sample * tangent;
    const auto n = std::ssize(errors), margin = static_cast<std::ptrdiff_t>(0.5 * shift * k) + 2;
    std::vector<float> sums(static_cast<std::size_t>(n + 2 * margin));
    for (int row = 0; row < k; ++row) {
        const double place = shift * (row - 0.5 * (k - 1));
        const auto steps = static_cast<std::ptrdiff_t>(std::floor(place));
        const auto t = static_cast<float>(place - static_cast<double>(steps));
        float* to = &sums[static_cast<std::size_t>(margin + steps)];
        for (std::ptrdiff_t m = 0; m < n; ++m)
            to[m] += (1.0f - t) * errors[static_cast<std::size_t>(m)];
        for (std::ptrdiff_t m = 0; m < n; ++m)
            to[m + 1] += t * errors[static_cast<std::size_t>(m)];
    }
    float largest = 0.0f;
    for (const float sum : sums)
        largest = std::max(largest, std::abs(sum));
    return static_cast<double>(largest) / k;
}

// Error of the interpolant of box averages around a sharp edge at `phase` steps beyond a sample, by
// the distance from the edge in steps; lengths in samples.
constexpr int box_reach = 4 * steps_per_sample;
std::vector<double> box_errors(int phase) {
    const double edge = static_cast<double>(phase) / steps_per_sample;
    std::vector<double> errors;
    for (int d = -box_reach; d <= box_reach; ++d) {
        const double place = edge + static_cast<double>(d) / steps_per_sample;
        double sum = 0.0;
        for (int i = -8; i <= 8; ++i)
            sum += lagrange6(place - i) * std::clamp(i + 0.5 - edge, 0.0, 1.0);
        errors.push_back(sum - std::clamp(place + 0.5 - edge, 0.0, 1.0));
    }
    return errors;
}

// Errors of a pixel of k boxes, spread by `spread`, of a sharp edge: by the distance of its first
// box from the edge, in steps. That distance tells at which phase of the samples the edge is.
std::vector<float> pixel_box_errors(int k, const std::vector<double>& spread) {
    std::vector<std::vector<double>> by_phase;
    for (int phase = 0; phase < steps_per_sample; ++phase) {
        const std::vector<double> one = box_errors(phase);
        // The boxes lie a sample apart: their mean error.
        std::vector<double> pixel(one.size() +
                                  static_cast<std::size_t>(steps_per_sample * (k - 1)));
        for (int m = 0; m < k; ++m)
            for (std::size_t d = 0; d < one.size(); ++d)
                pixel[d + static_cast<std::size_t>(steps_per_sample * m)] += one[d] / k;
        by_phase.push_back(std::move(pixel));
    }
    const int bins = static_cast<int>(spread.size()) - 1;
    const int n = static_cast<int>(by_phase[0].size());
    std::vector<float> errors;
    for (int at = -bins; at < n + bins; ++at) {
        const int remainder = (at % steps_per_sample + steps_per_sample) % steps_per_sample;
        const auto& pixel =
            by_phase[static_cast<std::size_t>((steps_per_sample - remainder) % steps_per_sample)];
        double sum = 0.0;
        for (int b = std::max(-bins, at - n + 1); b <= std::min(bins, at); ++b)
            sum += symmetric(spread, b) * pixel[static_cast<std::size_t>(at - b)];
        errors.push_back(static_cast<float>(sum));
    }
    return errors;
}

// `body` gets radius and energy of rings of equal ratios, so that a narrow pattern is resolved.
template <class Body>
void for_each_ring(const PointSpreadFunction& spread, double min_px, int rings, const Body& body) {
    const double ratio = std::pow(reach_of(spread) / min_px, 1.0 / rings);
    double within = spread.energy_within(min_px);
    for (int ring = 0; ring < rings; ++ring) {
        const double next = spread.energy_within(min_px * std::pow(ratio, ring + 1));
        body(min_px * std::pow(ratio, ring + 0.5), next - within);
        within = next;
    }
}

// How far a spread moves light to one side, at most 1 px, on average over all of its light: r / pi
// for a ring. At the corner of a box's profile that is the error of leaving the spread out.
double mean_distance_to_one_side(const PointSpreadFunction& spread) {
    double sum = 0.0;
    for_each_ring(spread, 1e-9, 2000, [&](double r, double energy) {
        sum += energy * std::min(r, 1.0) / std::numbers::pi;
    });
    return sum;
}

}  // namespace

SamplingBound::SamplingBound(const PointSpreadFunction* spread) : spread_(spread) {
    if (spread_ == nullptr)
        return;
    constexpr int bins_per_px = 256;
    const std::vector<double> bins = line_spread(bins_per_px);
    const double beyond = 1.0 - spread_->energy_within(reach_of(*spread_));
    peak_ = bins_per_px * (bins[0] - beyond);
    of_no_spread_ = full_scale_gray * (mean_distance_to_one_side(*spread_) + 0.5 * beyond);
}

// A ring of radius r, seen along one axis, has the part 1/2 + asin(x / r) / pi of its energy below
// x.
std::vector<double> SamplingBound::line_spread(int bins_per_px) const {
    if (spread_ == nullptr)
        return {1.0};
    const double reach_px = reach_of(*spread_);
    constexpr double min_px = 1e-6;
    std::vector<double> bins(static_cast<std::size_t>(reach_px * bins_per_px) + 2, 0.0);
    bins[0] = spread_->energy_within(min_px) + 1.0 - spread_->energy_within(reach_px);
    for_each_ring(*spread_, min_px, 400, [&](double r, double energy) {
        double below = 0.0;  // energy between -x and x, to be shared by the bins of both sides
        for (std::size_t b = 0; b < bins.size() && below < 1.0; ++b) {
            const double x = (static_cast<double>(b) + 0.5) / bins_per_px;
            const double up_to = x < r ? 2.0 * std::asin(x / r) / std::numbers::pi : 1.0;
            bins[b] += energy * (up_to - below) * (b == 0 ? 1.0 : 0.5);
            below = up_to;
        }
    });
    return bins;
}

// Falls for wide blur. Where the disk is not much wider than a sample it has ripples, whose largest
// counts.
double SamplingBound::of_points(int k, double blur_radius_px, EdgeTangents tangents) const {
    constexpr double max_px = 12.0, bin = 1.08, no_ripples_from_samples = 3.0;
    if (blur_radius_px > max_px)
        return of_points(k, max_px, tangents) * std::pow(max_px / blur_radius_px, 1.5);
    const auto bin_of = [&](double blur) {
        return static_cast<int>(std::floor(std::log(blur) / std::log(bin)));
    };
    const int first = bin_of(blur_radius_px), last = bin_of(no_ripples_from_samples / k);
    double largest = 0.0;
    for (int index = first; index <= std::max(first, last); ++index)
        largest = std::max(largest, largest_of(k, index, tangents, [&] {
                               return point_errors(k, {{std::pow(bin, index), 1.0}}, false,
                                                   line_spread(steps_per_sample * k));
                           }));
    return largest;
}

// The disks that stand for a sample's disk and the lens have ripples of their own at the samples'
// frequencies, whose largest counts. Two disks for more of them tell enough.
double SamplingBound::of_disks(int k, const DeconvolvedPsf& sharpened, const DiskBlur& blur,
                               EdgeTangents tangents, bool is_thinned) const {
    constexpr double bin_of_one = 1.03, bin_of_two = 1.15, no_ripples_from_samples = 3.0;
    const double disk = sharpened.disk_radius_px();
    const auto place = [&](double radius_px, double bin) {
        return std::log(radius_px / disk) / std::log(bin);
    };
    double largest = 0.0;
    const auto see = [&](int kind, double bin, double least_px, double most_px, auto disks_of) {
        constexpr int kinds = 4, first_index = std::numeric_limits<int>::min() / 2;
        const auto first = static_cast<int>(std::floor(place(least_px, bin)));
        const auto last = std::lround(place(most_px, bin));
        for (int index = first; index <= std::max<long>(first, last); ++index) {
            const int key = first_index + kinds * index + 2 * kind + (is_thinned ? 1 : 0);
            const auto errors = [&] {
                return point_errors(k, disks_of(disk * std::pow(bin, index)), is_thinned,
                                    line(sharpened, k));
            };
            largest = std::max(largest, largest_of(k, key, tangents, errors));
        }
    };
    if (blur.smallest_px <= blur.one_disk_up_to_px)
        see(0, bin_of_one, std::hypot(disk, blur.smallest_px),
            std::hypot(disk, std::min(blur.largest_px, blur.one_disk_up_to_px)),
            [](double radius_px) {
                return std::vector<BlurDisk>{{radius_px, 1.0}};
            });
    if (blur.largest_px > blur.one_disk_up_to_px)
        see(1, bin_of_two, std::max(blur.smallest_px, blur.one_disk_up_to_px),
            std::min(blur.largest_px, no_ripples_from_samples / k),
            [&](double blur_px) { return two_disks(disk, blur_px); });
    return largest;
}

template <class Errors>
double SamplingBound::largest_of(int k, int index, EdgeTangents tangents,
                                 const Errors& errors) const {
    std::unique_lock all(mutex_);
    Known& known = known_[{k, index}];
    all.unlock();
    const std::lock_guard lock(known.mutex);  // of this one: others need not wait
    if (known.errors.empty())
        known.errors = errors();
    double largest = 0.0;
    for (std::size_t n = 0; n < tangents.size(); ++n) {
        if (!tangents[n])
            continue;
        if (known.largest[n] == 0.0)
            known.largest[n] =
                largest_over_rows(known.errors, k, static_cast<double>(n) / tangent_steps);
        largest = std::max(largest, known.largest[n]);
    }
    return full_scale_gray * largest;
}

double SamplingBound::of_boxes(int k, EdgeTangents tangents) const {
    if (spread_ == nullptr)
        return 0.0;  // the mean of k box averages is the pixel's average
    constexpr int index_of_boxes = std::numeric_limits<int>::min() + 1;
    return largest_of(k, index_of_boxes, tangents,
                      [&] { return pixel_box_errors(k, line_spread(steps_per_sample * k)); });
}

}  // namespace etalon
