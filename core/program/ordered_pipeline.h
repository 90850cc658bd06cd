// Work on a sequence by all threads, with results in the order of the sequence, so that what was
// interrupted is a whole beginning of the full result.
#pragma once

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <cstddef>
#include <type_traits>

namespace etalon {

// Takes items from next(), one call at a time, until it returns an empty std::optional; calls
// make(item) on several threads and keep() with the results, one at a time, in order. At most two
// items a thread. Items are default constructible. Throws what these throw.
template <class Next, class Make, class Keep>
void process_in_order(const Next& next, const Make& make, const Keep& keep) {
    using Item = typename std::invoke_result_t<Next>::value_type;
    using Made = std::invoke_result_t<Make, const Item&>;
    const auto take = [&](tbb::flow_control& control) {
        auto item = next();
        if (!item)
            control.stop();
        return item ? *item : Item{};
    };
    const auto in_order = tbb::filter_mode::serial_in_order;
    tbb::parallel_pipeline(2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()),
                           tbb::make_filter<void, Item>(in_order, take) &
                               tbb::make_filter<Item, Made>(tbb::filter_mode::parallel, make) &
                               tbb::make_filter<Made, void>(in_order, keep));
}

}  // namespace etalon
