// Unpacking frames of 5 megapixels, beside a plain copy of the same bytes. Fresh memory for every
// frame on both sides, as a camera needs it that hands its frames on.
#include <benchmark/benchmark.h>

#include <cstring>
#include <memory>
#include <vector>

#include "capture/frame/pixel_formats.h"

namespace etalon {
namespace {

constexpr int width = 2592, height = 1944;

std::vector<std::uint8_t> frame_bytes(const PixelFormat& format) {
    std::vector<std::uint8_t> bytes(image_bytes(format, width, height, 0));
    for (std::size_t i = 0; i < bytes.size(); ++i)
        bytes[i] = static_cast<std::uint8_t>(i * 7 >> 3);
    return bytes;
}

void copy_frame(benchmark::State& state, const std::string& name) {
    const std::vector<std::uint8_t> bytes = frame_bytes(*find_pfnc_format(name));
    for (auto _ : state) {
        const std::unique_ptr<std::uint8_t[]> copy(new std::uint8_t[bytes.size()]);
        std::memcpy(copy.get(), bytes.data(), bytes.size());
        benchmark::DoNotOptimize(copy.get());
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * width * height);
}
BENCHMARK_CAPTURE(copy_frame, Mono8, "Mono8")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(copy_frame, Mono12p, "Mono12p")->Unit(benchmark::kMillisecond);

void unpack_frame(benchmark::State& state, const PixelFormat* format) {
    const std::vector<std::uint8_t> bytes = frame_bytes(*format);
    for (auto _ : state) {
        CodeImage image;
        benchmark::DoNotOptimize(unpack(*format, {bytes, width, height, 0}, image));
    }
    state.SetItemsProcessed(state.iterations() * width * height);
}
BENCHMARK_CAPTURE(unpack_frame, Mono8, find_pfnc_format("Mono8"))->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Mono16, find_pfnc_format("Mono16"))->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Mono10p, find_pfnc_format("Mono10p"))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Mono12p, find_pfnc_format("Mono12p"))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Mono12Packed, find_pfnc_format("Mono12Packed"))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Y10P, find_v4l2_format("Y10P"))->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, Y12P, find_v4l2_format("Y12P"))->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(unpack_frame, YUYV, find_v4l2_format("YUYV"))->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace etalon
