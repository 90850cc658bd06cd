// What the station does with a frame of 5 megapixels from the library's buffer to the caller's
// image (copy, unpack, checks), beside a plain copy of the bytes that arrived: the counter
// `x_memcpy`. Promised: at most 4 for Mono8, at most 8 for Mono12p.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <memory>
#include <vector>

#include "capture/frame/frame_checks.h"
#include "capture/frame/pixel_formats.h"

namespace etalon {
namespace {

constexpr int width = 2592, height = 1944;

double seconds_of(const auto& call) {
    const auto start = std::chrono::steady_clock::now();
    call();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The median is what a frame costs; fresh memory each time, as for frames that are handed on.
double median_seconds(const auto& call) {
    std::vector<double> seconds(31);
    for (double& each : seconds)
        each = seconds_of(call);
    std::nth_element(seconds.begin(), seconds.begin() + 15, seconds.end());
    return seconds[15];
}

void receive_frame(benchmark::State& state, const std::string& name) {
    const PixelFormat& format = *find_pfnc_format(name);
    std::vector<std::uint8_t> bytes(image_bytes(format, width, height, 0));
    for (std::size_t i = 0; i < bytes.size(); ++i)
        bytes[i] = static_cast<std::uint8_t>(i * 7 >> 3);
    const auto receive = [&] {
        CodeImage image;
        benchmark::DoNotOptimize(unpack(format, {bytes, width, height, 0}, image));
        if (can_exceed_full_scale(format, format.bits))
            benchmark::DoNotOptimize(exceeds_full_scale(image));
    };
    const auto copy = [&] {
        const std::unique_ptr<std::uint8_t[]> bytes_again(new std::uint8_t[bytes.size()]);
        std::memcpy(bytes_again.get(), bytes.data(), bytes.size());
        benchmark::DoNotOptimize(bytes_again.get());
        benchmark::ClobberMemory();
    };
    for (auto _ : state)
        receive();
    state.counters["x_memcpy"] = median_seconds(receive) / median_seconds(copy);
}
BENCHMARK_CAPTURE(receive_frame, Mono8, "Mono8")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(receive_frame, Mono12, "Mono12")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(receive_frame, Mono12p, "Mono12p")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(receive_frame, Mono12Packed, "Mono12Packed")->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace etalon
