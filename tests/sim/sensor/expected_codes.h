// The codes of many radiances against a curve of codes.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "sim/sensor/sensor_steps.h"

namespace etalon::test {

// Each radiance as the nearest float of itself, and those that are floats as floats.
inline void expect_codes(const QuantizationThresholds& steps,
                         const std::function<double(double)>& code_of,
                         const std::vector<double>& radiances) {
    for (const bool is_rounded : {false, true})
        for (std::size_t first = 0; first < radiances.size();
             first += QuantizationThresholds::max_at_once) {
            std::vector<float> values;
            for (std::size_t i = first;
                 i < radiances.size() && std::ssize(values) < QuantizationThresholds::max_at_once;
                 ++i)
                values.push_back(static_cast<float>(radiances[i]));
            const auto radiance_at = [&](int i) {
                const auto place = static_cast<std::size_t>(i);
                return is_rounded ? radiances[first + place] : double(values[place]);
            };
            std::vector<std::uint16_t> codes(values.size());
            const int count = static_cast<int>(values.size());
            ASSERT_TRUE(
                steps.put_codes(values.data(), is_rounded, count, radiance_at, codes.data()));
            for (int i = 0; i < count; ++i)
                ASSERT_EQ(codes[static_cast<std::size_t>(i)], code_of(radiance_at(i)))
                    << radiance_at(i) << " rounded " << is_rounded;
        }
}

}  // namespace etalon::test
