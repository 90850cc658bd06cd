#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sim/sensor/sensor_simd.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "sim/sensor/sensor_simd.h"

HWY_BEFORE_NAMESPACE();
namespace etalon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// LinearSensor::code_of() of as many signals as D has lanes.
template <class D, class Code>
HWY_ATTR HWY_INLINE void store_codes(D d, LinearSensor sensor, hn::Vec<D> p, Code* codes) {
    const hn::Rebind<std::int32_t, D> integers;
    const hn::Rebind<Code, D> narrow;
    const auto signal = hn::Mul(hn::Set(d, sensor.range), hn::Min(p, hn::Set(d, 1.0)));
    const auto code = hn::Add(signal, hn::Set(d, sensor.offset));
    const auto whole = hn::DemoteTo(integers, code);  // towards 0; the next step limits it to 0
    hn::StoreU(hn::DemoteTo(narrow, whole), narrow, codes);
}

// As many pixels as D has lanes of doubles; returns 0 or, where one is not finite, NaN: what 0
// times the pixel is. The product of two floats is exact in double.
template <class D, class Code>
HWY_ATTR HWY_INLINE hn::Vec<D> linear_vector(D d, LinearSensor sensor, const float* radiance,
                                             const float* response, Code* codes) {
    const hn::Rebind<float, D> floats;
    auto p = hn::PromoteTo(d, hn::LoadU(floats, radiance));
    const auto nothing = hn::Mul(p, hn::Zero(d));
    if (response)
        p = hn::Mul(p, hn::PromoteTo(d, hn::LoadU(floats, response)));
    store_codes(d, sensor, p, codes);
    return nothing;
}

// Single precision gives the same code unless the signal is this close to a step: range and black
// level, below 256, and their sum are each rounded by less than a sixth of it.
constexpr float step_margin = 1e-4f;

// As many pixels as whole vectors hold, up to the first that needs double precision or is not
// finite; returns where they end.
HWY_ATTR HWY_INLINE int linear_in_single(LinearSensor sensor, const float* radiance, int x,
                                         int count, std::uint8_t* codes) {
    const hn::ScalableTag<float> d;
    const hn::RebindToUnsigned<decltype(d)> bits;
    const hn::Rebind<std::uint8_t, decltype(d)> narrow;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto range = hn::Set(d, static_cast<float>(sensor.range));
    const auto black = hn::Set(d, static_cast<float>(sensor.offset - 0.5));
    // Above it a float has no fraction: the sum is rounded, and its last bits are the code.
    const auto whole = hn::Set(d, 0x1.8p23f);
    for (; x + n <= count; x += n) {
        const auto p = hn::LoadU(d, radiance + x);
        const auto signal = hn::MulAdd(range, hn::Min(p, hn::Set(d, 1.0f)), black);
        const auto code = hn::Max(signal, hn::Zero(d));
        const auto rounded = hn::Add(code, whole);
        const auto from_code = hn::Abs(hn::Sub(code, hn::Sub(rounded, whole)));
        const auto surely = hn::Lt(from_code, hn::Set(d, 0.5f - step_margin));
        const auto finite = hn::Lt(hn::Abs(p), hn::Set(d, 1e30f));
        if (!hn::AllTrue(d, hn::And(surely, finite)))
            break;
        hn::StoreU(hn::TruncateTo(narrow, hn::BitCast(bits, rounded)), narrow, codes + x);
    }
    return x;
}
HWY_ATTR HWY_INLINE int linear_in_single(LinearSensor, const float*, int x, int, std::uint16_t*) {
    return x;
}

// Whether all of them are finite.
template <class Code>
HWY_ATTR HWY_INLINE bool linear_pixels(LinearSensor sensor, const float* radiance,
                                       const float* response, int count, Code* codes) {
    const hn::ScalableTag<double> d;
    const int n = static_cast<int>(hn::Lanes(d));
    auto nothing = hn::Zero(d);
    int x = 0;
    if (!response)
        x = linear_in_single(sensor, radiance, x, count, codes);
    for (; x + n <= count; x += n)
        nothing = hn::Add(nothing, linear_vector(d, sensor, radiance + x,
                                                 response ? response + x : nullptr, codes + x));
    bool finite = hn::AllTrue(d, hn::Eq(nothing, hn::Zero(d)));
    for (; x < count; ++x) {
        finite = finite && std::isfinite(radiance[x]);
        codes[x] = static_cast<Code>(
            sensor.code_of(response ? double(radiance[x]) * response[x] : double(radiance[x])));
    }
    return finite;
}

constexpr int stretch = 64;

HWY_ATTR HWY_INLINE bool is_even(const float* values) {
    const hn::CappedTag<float, stretch> d;
    const int n = static_cast<int>(hn::Lanes(d));
    const auto first = hn::Set(d, values[0]);
    auto even = hn::Eq(first, hn::LoadU(d, values));
    for (int x = n; x < stretch; x += n)
        even = hn::And(even, hn::Eq(first, hn::LoadU(d, values + x)));
    return hn::AllTrue(d, even);
}

// Most of a rendered image is an even background: a stretch of it needs one code and one look at
// whether it is finite. (A NaN equals nothing: a stretch of them is not even.)
template <class Code>
HWY_ATTR HWY_INLINE bool linear_row(LinearSensor sensor, const float* radiance,
                                    const float* response, int count, Code* codes) {
    bool finite = true;
    int x = 0;
    for (; x + stretch <= count; x += stretch)
        if (!response && is_even(radiance + x)) {
            finite = finite && std::isfinite(radiance[x]);
            std::fill_n(codes + x, stretch, static_cast<Code>(sensor.code_of(radiance[x])));
        } else {
            finite &= linear_pixels(sensor, radiance + x, response ? response + x : nullptr,
                                    stretch, codes + x);
        }
    finite &= linear_pixels(sensor, radiance + x, response ? response + x : nullptr, count - x,
                            codes + x);
    return finite;
}

HWY_ATTR bool LinearCodes8(LinearSensor sensor, const float* radiance, const float* response,
                           int count, std::uint8_t* codes) {
    return linear_row(sensor, radiance, response, count, codes);
}

HWY_ATTR bool LinearCodes16(LinearSensor sensor, const float* radiance, const float* response,
                            int count, std::uint16_t* codes) {
    return linear_row(sensor, radiance, response, count, codes);
}

template <class Code>
HWY_ATTR HWY_INLINE void signal_codes(LinearSensor sensor, const double* signals, int count,
                                      Code* codes) {
    const hn::ScalableTag<double> d;
    const int n = static_cast<int>(hn::Lanes(d));
    int x = 0;
    for (; x + n <= count; x += n)
        store_codes(d, sensor, hn::LoadU(d, signals + x), codes + x);
    for (; x < count; ++x)
        codes[x] = static_cast<Code>(sensor.code_of(signals[x]));
}

HWY_ATTR void SignalCodes8(LinearSensor sensor, const double* signals, int count,
                           std::uint8_t* codes) {
    signal_codes(sensor, signals, count, codes);
}

HWY_ATTR void SignalCodes16(LinearSensor sensor, const double* signals, int count,
                            std::uint16_t* codes) {
    signal_codes(sensor, signals, count, codes);
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

HWY_EXPORT(LinearCodes8);
HWY_EXPORT(LinearCodes16);
HWY_EXPORT(SignalCodes8);
HWY_EXPORT(SignalCodes16);
HWY_EXPORT(AllFinite);

bool linear_codes(LinearSensor sensor, const float* radiance, const float* response, int count,
                  std::uint8_t* codes) {
    return HWY_DYNAMIC_DISPATCH(LinearCodes8)(sensor, radiance, response, count, codes);
}

bool linear_codes(LinearSensor sensor, const float* radiance, const float* response, int count,
                  std::uint16_t* codes) {
    return HWY_DYNAMIC_DISPATCH(LinearCodes16)(sensor, radiance, response, count, codes);
}

void linear_codes(LinearSensor sensor, const double* signals, int count, std::uint8_t* codes) {
    HWY_DYNAMIC_DISPATCH(SignalCodes8)(sensor, signals, count, codes);
}

void linear_codes(LinearSensor sensor, const double* signals, int count, std::uint16_t* codes) {
    HWY_DYNAMIC_DISPATCH(SignalCodes16)(sensor, signals, count, codes);
}

bool all_finite(const float* values, int count) {
    return HWY_DYNAMIC_DISPATCH(AllFinite)(values, count);
}

}  // namespace etalon

#endif  // HWY_ONCE
