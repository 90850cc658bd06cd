#include "sim/tiles/vector_targets.h"
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/sensor/sensor_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

#include "sim/sensor/sensor_simd.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int most_lanes = 16, stretch = 64;
using Floats = hn::CappedTag<float, most_lanes>;
using Integers = hn::RebindToSigned<Floats>;

// Codes in the low 16 bits, and which of them are doubtful.
struct Found {
    hn::Vec<Integers> codes;
    hn::Mask<Integers> doubtful;
};

#if HWY_MAX_BYTES == 64  // a register holds a number of every piece
HWY_ATTR HWY_INLINE Found follow_curve(const PiecewisePolynomial& pieces, hn::Vec<Floats> values) {
    static_assert(PiecewisePolynomial::count == most_lanes);
    const Floats d;
    const Integers di;
    const auto number = hn::ShiftRight<PiecewisePolynomial::shift>(hn::BitCast(di, values));
    const auto piece = hn::IndicesFromVec(
        d, hn::Min(hn::Max(hn::Sub(number, hn::Set(di, PiecewisePolynomial::first)), hn::Zero(di)),
                   hn::Set(di, PiecewisePolynomial::count - 1)));
    const auto u = hn::Sub(values, hn::TableLookupLanes(hn::LoadU(d, pieces.centre), piece));
    auto code =
        hn::TableLookupLanes(hn::LoadU(d, pieces.factor[PiecewisePolynomial::degree]), piece);
    for (int n = PiecewisePolynomial::degree - 1; n >= 0; --n)
        code = hn::MulAdd(code, u, hn::TableLookupLanes(hn::LoadU(d, pieces.factor[n]), piece));
    // Beside 1.5 * 2^23 floats are whole numbers, whose last bits are the low ones.
    const auto large = hn::Set(d, 0x1.8p23f);
    const auto rounded = hn::Add(code, large);
    const auto rest = hn::Abs(hn::Sub(code, hn::Sub(rounded, large)));
    const auto half = hn::Set(d, 0.5f);
    const auto is_sure = hn::And(hn::Lt(rest, hn::Set(d, 0.5f - pieces.doubt)),
                                 hn::Le(hn::Abs(hn::Sub(values, half)), half));
    return {hn::BitCast(di, rounded), hn::RebindMask(di, hn::Not(is_sure))};
}
#endif

HWY_ATTR HWY_INLINE Found look_up_codes(const StepCells& cells, const std::uint32_t* entries,
                                        bool is_rounded, hn::Vec<Floats> values) {
    const Integers d;
    const auto all = [&](std::int32_t value) { return hn::Set(d, value); };
    // -0 becomes 0.
    const auto bits = hn::BitCast(d, hn::Add(values, hn::Zero(Floats())));
    const auto is_negative = hn::ShiftRight<31>(bits);  // -1 or 0
    const auto unlimited = hn::And(bits, all(0x7fffffff));
    const auto size = hn::Min(hn::Max(unlimited, all(cells.first << cells.shift)),
                              all(cells.last << cells.shift));
    const auto cell = hn::ShiftRightSame(size, cells.shift);
    const auto side = hn::And(is_negative, all(cells.last - cells.first + 1));
    const auto entry = hn::GatherIndex(d, reinterpret_cast<const std::int32_t*>(entries),
                                       hn::Add(hn::Sub(cell, all(cells.first)), side));
    const std::int32_t last_place = (1 << cells.shift) - 1;
    const auto place = hn::And(size, all(last_place));
    const auto step = hn::And(entry, all(StepCells::doubtful - 1));
    const auto direction = hn::Or(is_negative, all(1));
    const auto is_across = hn::Not(hn::Lt(place, step));
    const auto codes = hn::Add(hn::ShiftRight<16>(entry), hn::IfThenElseZero(is_across, direction));
    constexpr std::int32_t largest = 0x7f7fffff;  // what is not finite is larger
    auto doubtful =
        hn::Or(hn::TestBit(entry, all(StepCells::doubtful)), hn::Gt(unlimited, all(largest)));
    if (is_rounded) {  // beyond the cells there is no step: its own place, not the limited one,
                       // counts
        const auto own = hn::And(unlimited, all(last_place));
        const auto beside_step = hn::Lt(hn::Abs(hn::Sub(own, step)), all(2));
        const auto beside_end = hn::Or(hn::Eq(own, hn::Zero(d)), hn::Eq(own, all(last_place)));
        doubtful = hn::Or(doubtful, hn::Or(beside_step, beside_end));
    }
    return {codes, doubtful};
}

template <bool follow>
HWY_ATTR HWY_INLINE Found find_codes(const StepCells& cells, const std::uint32_t* entries,
                                     bool is_rounded, hn::Vec<Floats> values) {
#if HWY_MAX_BYTES == 64
    if constexpr (follow) {
        const Found found = follow_curve(cells.pieces, values);
        if (HWY_LIKELY(hn::AllFalse(Integers(), found.doubtful)))
            return found;
    }
#endif
    return look_up_codes(cells, entries, is_rounded, values);
}

template <class Code>
struct Output {
    Code* codes;
    std::uint16_t* doubtful;
    int doubts = 0;
};

// Of the first `count` lanes, at `x`.
template <class Code>
HWY_ATTR HWY_INLINE void put_vector(const Found& found, int x, int count, Output<Code>& output) {
    const hn::RebindToUnsigned<Integers> d;
    const hn::Rebind<Code, Floats> narrow;
    HWY_ALIGN Code codes[most_lanes];
    hn::Store(hn::TruncateTo(narrow, hn::BitCast(d, found.codes)), narrow, codes);
    std::copy_n(codes, count, output.codes + x);
    if (hn::AllFalse(Integers(), found.doubtful))
        return;
    HWY_ALIGN std::int32_t is_doubtful[most_lanes] = {};
    hn::Store(hn::VecFromMask(Integers(), found.doubtful), Integers(), is_doubtful);
    for (int i = 0; i < count; ++i)
        if (is_doubtful[i] != 0)
            output.doubtful[output.doubts++] = static_cast<std::uint16_t>(x + i);
}

HWY_ATTR HWY_INLINE bool is_even(const float* values) {
    const Floats d;
    const auto first = hn::Set(d, values[0]);
    auto even = hn::Eq(first, hn::LoadU(d, values));
    for (int x = static_cast<int>(hn::Lanes(d)); x < stretch; x += static_cast<int>(hn::Lanes(d)))
        even = hn::And(even, hn::Eq(first, hn::LoadU(d, values + x)));
    return hn::AllTrue(d, even);
}

// Most of a rendered image is an even background: a stretch of it needs one code.
template <bool follow, class Code>
HWY_ATTR HWY_INLINE int put_codes(const StepCells& cells, const std::uint32_t* entries,
                                  const float* values, bool is_rounded, int count,
                                  Output<Code> output) {
    const Floats d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    int x = 0;
    for (; x + lanes <= count; x += lanes) {
        const int doubts = output.doubts;
        put_vector(find_codes<follow>(cells, entries, is_rounded, hn::LoadU(d, values + x)), x,
                   lanes, output);
        if (x % stretch == 0 && x + stretch <= count && output.doubts == doubts &&
            values[x] == values[x + stretch - 1] && is_even(values + x)) {
            std::fill_n(output.codes + x, stretch, output.codes[x]);
            x += stretch - lanes;
        }
    }
    if (x < count) {
        HWY_ALIGN float rest[most_lanes] = {};
        std::copy(values + x, values + count, rest);
        put_vector(find_codes<follow>(cells, entries, is_rounded, hn::Load(d, rest)), x, count - x,
                   output);
    }
    return output.doubts;
}

template <class Code>
HWY_ATTR HWY_INLINE int put_codes(const StepCells& cells, const std::uint32_t* entries,
                                  const float* values, bool is_rounded, int count,
                                  const Output<Code>& output) {
    return cells.pieces.follow
               ? put_codes<true>(cells, entries, values, is_rounded, count, output)
               : put_codes<false>(cells, entries, values, is_rounded, count, output);
}

HWY_ATTR int StepCodes8(const StepCells& cells, const std::uint32_t* entries, const float* values,
                        bool is_rounded, int count, std::uint8_t* codes, std::uint16_t* doubtful) {
    return put_codes(cells, entries, values, is_rounded, count,
                     Output<std::uint8_t>{codes, doubtful});
}

HWY_ATTR int StepCodes16(const StepCells& cells, const std::uint32_t* entries, const float* values,
                         bool is_rounded, int count, std::uint16_t* codes,
                         std::uint16_t* doubtful) {
    return put_codes(cells, entries, values, is_rounded, count,
                     Output<std::uint16_t>{codes, doubtful});
}

// 0 times a number is 0, and NaN for the others; a NaN stays in the sum.
HWY_ATTR bool AllFinite(const float* values, int count) {
    const hn::ScalableTag<float> d;
    const int n = static_cast<int>(hn::Lanes(d));
    auto sum = hn::Zero(d);
    int x = 0;
    for (; x + n <= count; x += n)
        sum = hn::Add(sum, hn::Mul(hn::LoadU(d, values + x), hn::Zero(d)));
    float rest = 0.0f;
    for (; x < count; ++x)
        rest += values[x] * 0.0f;
    return rest == 0.0f && hn::AllTrue(d, hn::Eq(sum, hn::Zero(d)));
}

}  // namespace etalon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace etalon {

HWY_EXPORT(StepCodes8);
HWY_EXPORT(StepCodes16);
HWY_EXPORT(AllFinite);

int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint8_t* codes, std::uint16_t* doubtful) {
    return HWY_DYNAMIC_DISPATCH(StepCodes8)(cells, entries, values, is_rounded, count, codes,
                                            doubtful);
}

int step_codes(const StepCells& cells, const std::uint32_t* entries, const float* values,
               bool is_rounded, int count, std::uint16_t* codes, std::uint16_t* doubtful) {
    return HWY_DYNAMIC_DISPATCH(StepCodes16)(cells, entries, values, is_rounded, count, codes,
                                             doubtful);
}

bool all_finite(const float* values, int count) {
    return HWY_DYNAMIC_DISPATCH(AllFinite)(values, count);
}

}  // namespace etalon

#endif  // HWY_ONCE
