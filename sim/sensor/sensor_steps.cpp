#include "sim/sensor/sensor_steps.h"

#include <bit>
#include <limits>

namespace etalon {
namespace {

// Doubles in their order as integers in theirs, and back: the bits below the sign fall with a
// negative number's value.
double in_order(std::int64_t place) {
    return std::bit_cast<double>(place < 0 ? std::numeric_limits<std::int64_t>::min() - place
                                           : place);
}

constexpr std::int64_t last_place = std::bit_cast<std::int64_t>(std::numeric_limits<double>::max());

// The least double for which `is_above` holds, by bisection; infinity when it never does.
template <class Predicate>
double least_above(const Predicate& is_above) {
    std::int64_t low = -last_place, high = last_place + 1;  // the place behind is infinity's
    while (low < high) {
        const std::int64_t middle = (low & high) + ((low ^ high) >> 1);
        if (is_above(in_order(middle)))
            high = middle;
        else
            low = middle + 1;
    }
    return in_order(low);
}

}  // namespace

SensorSteps::SensorSteps(int bits, const std::function<double(double)>& code_of) {
    const std::size_t codes = std::size_t{1} << bits;
    for (std::size_t code = 0; code + 1 < codes; ++code)
        steps_.push_back(
            least_above([&](double radiance) { return code_of(radiance) > double(code); }));
    steps_.push_back(std::numeric_limits<double>::infinity());

    // Rec. 709, of slope 4.5 at most, has a step in each other.
    const auto cells = static_cast<std::ptrdiff_t>(8 * codes);
    cells_ = static_cast<double>(cells);
    std::size_t code = 0;
    for (std::ptrdiff_t cell = -cells - 1; cell <= cells; ++cell) {
        while (double(cell) / cells_ >= steps_[code])
            ++code;
        code_of_cell_.push_back(static_cast<std::uint16_t>(code));
    }
}

std::uint16_t SensorSteps::code_below_cells(double radiance) const {
    return static_cast<std::uint16_t>(std::upper_bound(steps_.begin(), steps_.end(), radiance) -
                                      steps_.begin());
}

}  // namespace etalon
