// Compiled once for each instruction set, as sim/tiles/tile_lens_kernel.cpp.
#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/tiles/edge_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include "sim/tiles/edge_group.h"
#include "sim/tiles/tile_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {
namespace {

constexpr std::size_t side = EdgeGroup::side_px;
static_assert(side == block);

// The places of a row's pixels, and the distance's cubic in one row.
struct EdgeRow {
    HWY_ALIGN float c[4];

    EdgeRow(const EdgeGroup& group, int row) {
        const float t = (static_cast<float>(row) + 0.5f) / static_cast<float>(side) - 0.5f;
        const float* of = group.distance.data();
        for (int n = 0; n < 4; ++n)
            c[n] = of[n] + t * (of[4 + n] + t * (of[8 + n] + t * of[12 + n]));
    }

    HWY_INLINE Vector distance(std::size_t lane) const {
        const Vector s = hn::MulAdd(hn::Iota(tag, static_cast<float>(lane) + 0.5f),
                                    all(1.0f / side), all(-0.5f));
        return polynomial<3>(c, s);
    }
};

void average_edge(const EdgeGroup& group, float* averages) {
    const Vector inverse = all(1.0f / group.blur), one = all(1.0f);
    const Vector before = all(group.before), step = all(group.beyond - group.before);
    for (std::size_t row = 0; row < side; row += 2) {
        HWY_ALIGN float sums[side];
        for (std::size_t lane = 0; lane < side; lane += hn::Lanes(tag)) {
            Vector sum = hn::Zero(tag);
            for (std::size_t y = row; y < row + 2; ++y) {
                const EdgeRow of_row(group, static_cast<int>(y));
                const Vector offset = hn::Clamp(of_row.distance(lane) * inverse, hn::Neg(one), one);
                sum = sum + area_beyond(offset, hn::Sqrt(one - hn::Abs(offset)));
            }
            store(hn::MulAdd(sum * all(0.5f), step, before), sums + lane);
        }
        for (std::size_t x = 0; x < side / 2; ++x)
            averages[side / 4 * row + x] = 0.5f * (sums[2 * x] + sums[2 * x + 1]);
    }
}

void add_edge_rows(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first,
                   int end, float* out, std::ptrdiff_t stride) {
    const hn::RebindToSigned<Tag> whole;
    const float* values = profile.values.data();
    const Vector last = all(static_cast<float>(profile.values.size() - 2));
    const Vector per_px = all(static_cast<float>(EdgeTable::per_px));
    const Vector before = all(energy * group.before), beyond = all(energy * group.beyond);
    const Vector step = all(group.beyond - group.before), shift = all(profile.shift);
    for (int row = first; row < end; ++row, out += stride) {
        const EdgeRow of_row(group, row);
        for (std::size_t lane = 0; lane < side; lane += hn::Lanes(tag)) {
            const Vector distance = of_row.distance(lane);
            const Vector place = hn::Min(hn::MulAdd(hn::Abs(distance), per_px, shift), last);
            const auto index = hn::ConvertTo(whole, place);
            const Vector way = place - hn::ConvertTo(tag, index);
            const Vector near = hn::GatherIndex(tag, values, index);
            const Vector far = hn::GatherIndex(tag, values + 1, index);
            const Vector part = step * hn::MulAdd(way, far - near, near);
            const Vector seen =
                hn::IfThenElse(hn::Lt(distance, hn::Zero(tag)), before + part, beyond - part);
            hn::StoreU(hn::LoadU(tag, out + lane) + seen, tag, out + lane);
        }
    }
}

}  // namespace
}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace etalon {
namespace {

HWY_EXPORT(average_edge);
HWY_EXPORT(add_edge_rows);

}  // namespace

void edge_averages(const EdgeGroup& group, float* averages) {
    HWY_DYNAMIC_DISPATCH(average_edge)(group, averages);
}

void add_edge(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first, int end,
              float* out, std::ptrdiff_t stride) {
    HWY_DYNAMIC_DISPATCH(add_edge_rows)(group, profile, energy, first, end, out, stride);
}

}  // namespace etalon
#endif
