// A frame's bytes as a camera sends them: parted into image and chunks, and the image unpacked.
// Input: format, width, height, padding of a line and byte order, a byte each, then the payload.
#include <algorithm>

#include "capture/frame/frame_checks.h"
#include "capture/genicam/genicam_chunks.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

constexpr std::size_t head = 5;

void check(const PixelFormat& format, const RawImage& raw) {
    CodeImage image;
    const std::string fault = unpack(format, raw, image);
    require(fault.empty() != image.pixels.empty(), "an image with a fault, or none without");
    if (!fault.empty())
        return;
    require(image.pixels.cols == raw.width && image.pixels.rows == raw.height, "another size");
    if (exceeds_full_scale(image))
        require(can_exceed_full_scale(format, image.bits) && !code_fault(image, format).empty(),
                "codes above the full scale");
}

// Copied to its own size, so that the sanitizer sees the first byte beyond it.
void read(std::span<const std::uint8_t> input) {
    const PixelFormat& format = pixel_formats()[input[0] % pixel_formats().size()];
    const std::vector<std::uint8_t> payload(input.begin() + head, input.end());
    RawImage raw{payload, input[1], input[2], 0};
    if (input[3] != 0)
        raw.bytes_per_line = line_bytes(format, raw.width) + input[3] - 1U;
    check(format, raw);
    const std::size_t expected =
        raw.width > 0 && raw.height > 0 ? image_bytes(format, raw.width, raw.height, 0) : 0;
    PayloadParts parts;
    const auto order = input[4] % 2 == 0 ? std::endian::big : std::endian::little;
    if (!split_payload(payload, expected, order, parts).empty())
        return;
    std::size_t bytes = parts.image.size();
    for (const Chunk& chunk : parts.chunks)
        bytes += chunk.data.size() + 8;
    require(bytes == payload.size() || bytes + 8 == payload.size(), "parts of another size");
    raw.data = parts.image;
    check(format, raw);
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    if (size >= head)
        read({data, size});
    return 0;
}
