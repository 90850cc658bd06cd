#include "capture/genicam/genicam_chunks.h"

#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t image_size = 35;

void append(Bytes& out, std::uint32_t value, std::endian order) {
    for (int i = 0; i < 4; ++i)
        out.push_back(
            static_cast<std::uint8_t>(value >> 8 * (order == std::endian::big ? 3 - i : i)));
}

void append_chunk(Bytes& out, std::uint32_t id, const Bytes& data,
                  std::endian order = std::endian::big) {
    out.insert(out.end(), data.begin(), data.end());
    append(out, id, order);
    append(out, static_cast<std::uint32_t>(data.size()), order);
}

Bytes as_bytes(std::span<const std::uint8_t> data) {
    return {data.begin(), data.end()};
}

const Bytes image(image_size, 75);

TEST(ChunkLayout, IsReadBackwardsInBothByteOrders) {
    for (const std::endian order : {std::endian::big, std::endian::little}) {
        Bytes payload;
        append_chunk(payload, 0x75, image, order);
        append_chunk(payload, 0x1001, {7, 5, 3}, order);
        append_chunk(payload, 0xA0000002, {}, order);
        PayloadParts parts;
        ASSERT_EQ(split_payload(payload, image_size, order, parts), "");
        EXPECT_EQ(as_bytes(parts.image), image);
        ASSERT_EQ(parts.chunks.size(), 2u);
        EXPECT_EQ(as_bytes(parts.find(0x1001)->data), (Bytes{7, 5, 3}));
        EXPECT_TRUE(parts.find(0xA0000002)->data.empty());
        EXPECT_EQ(parts.find(0x75), nullptr);
    }
}

TEST(ChunkLayout, KnowsAnImageWithoutIdAndLengthByItsSize) {
    Bytes payload = image;
    PayloadParts parts;
    ASSERT_EQ(split_payload(payload, image_size, std::endian::big, parts), "");
    EXPECT_EQ(as_bytes(parts.image), image);
    EXPECT_TRUE(parts.chunks.empty());
    append_chunk(payload, 7, {5});
    ASSERT_EQ(split_payload(payload, image_size, std::endian::big, parts), "");
    EXPECT_EQ(as_bytes(parts.image), image);
    EXPECT_EQ(as_bytes(parts.find(7)->data), Bytes{5});
}

TEST(ChunkLayout, LeavesTheSizeOfTheImageToTheCaller) {
    Bytes payload;
    append_chunk(payload, 1, Bytes(image_size + 1, 7));
    PayloadParts parts;
    ASSERT_EQ(split_payload(payload, image_size, std::endian::big, parts), "");
    EXPECT_EQ(parts.image.size(), image_size + 1);
    ASSERT_EQ(split_payload({}, image_size, std::endian::big, parts), "");
    EXPECT_TRUE(parts.image.empty());
}

TEST(ChunkLayout, SaysWhatIsWrong) {
    const auto fault = [](const Bytes& payload) {
        PayloadParts parts;
        return split_payload(payload, image_size, std::endian::big, parts);
    };
    Bytes long_chunk;
    append_chunk(long_chunk, 0x75, image);
    long_chunk.back() = image_size + 1;
    EXPECT_THAT(fault(long_chunk), HasSubstr("chunk 0x75 has a length of 36 bytes, 35 are there"));
    long_chunk[long_chunk.size() - 4] = 0xff;  // nearly 4 GiB
    EXPECT_THAT(fault(long_chunk), HasSubstr("has a length of"));
    Bytes left_over(5, 0);
    append_chunk(left_over, 1, image);
    EXPECT_THAT(fault(left_over), HasSubstr("5 bytes are left over"));
    EXPECT_THAT(fault(Bytes(5'000'000, 0)), HasSubstr("more than 256 chunks"));
}

// What it finds without complaint, put together again, is the payload.
TEST(ChunkLayout, StaysInsideRandomPayloads) {
    RandomStream random(7, 5);
    int accepted = 0;
    for (int i = 0; i < 20000; ++i) {
        Bytes payload(random.bits() % 60, 0);
        for (std::uint8_t& byte : payload)  // small numbers, so that some lengths are possible
            byte = random.bits() % 8 ? 0 : static_cast<std::uint8_t>(random.bits() % 40);
        PayloadParts parts;
        if (!split_payload(payload, image_size, std::endian::big, parts).empty())
            continue;
        std::size_t size = parts.image.size();
        for (const Chunk& chunk : parts.chunks)
            size += chunk.data.size() + 8;
        EXPECT_TRUE(size == payload.size() || size + 8 == payload.size());
        accepted += !parts.chunks.empty();
    }
    EXPECT_GT(accepted, 100);
}

}  // namespace
}  // namespace etalon
