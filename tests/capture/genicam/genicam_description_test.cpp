#include "capture/genicam/genicam_chunks.h"
#include "capture/genicam/genicam_device.h"
#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Bytes = std::vector<std::uint8_t>;

std::string described(const std::string& nodes) {
    return "<?xml version=\"1.0\"?>\n<RegisterDescription>\n" + nodes + "</RegisterDescription>\n";
}

constexpr const char* none = "no error";

std::string refusal(const std::string& xml) {
    return text_of_error<Error>([&] { require_sound_description(xml); });
}

// A chain of values, each made from the next one `times` times.
std::string chain(int values, int times) {
    std::string nodes;
    for (int i = 0; i < values; ++i) {
        nodes += fmt::format("<IntSwissKnife Name=\"N{}\">", i);
        for (int k = 0; k < times; ++k)
            nodes += fmt::format("<pVariable Name=\"V{}\">N{}</pVariable>", k, i + 1);
        nodes += "<Formula>1</Formula></IntSwissKnife>\n";
    }
    return described(nodes);
}

TEST(GenicamDescription, MayLimitValuesByOneAnother) {
    EXPECT_EQ(
        refusal(described(
            "<Integer Name=\"Width\"><pValue>WidthReg</pValue><pMax>WidthMax</pMax></Integer>\n"
            "<IntSwissKnife Name=\"WidthMax\"><pVariable "
            "Name=\"X\">OffsetX</pVariable></IntSwissKnife>\n"
            "<Integer Name=\"OffsetX\"><pValue>OffsetReg</pValue><pMax>OffsetMax</pMax></Integer>\n"
            "<IntSwissKnife Name=\"OffsetMax\"><pVariable "
            "Name=\"W\">Width</pVariable></IntSwissKnife>\n"
            "<Integer Name=\"Selector\"><Value>1</Value><pSelected>Width</pSelected></Integer>\n"
            "<IntReg Name=\"WidthReg\"><Length>4</Length><pAddress>Selector</pAddress></IntReg>\n"
            "<IntReg Name=\"OffsetReg\"><Length>0x4</Length></IntReg>\n")),
        none);
}

TEST(GenicamDescription, MayNotReferToItself) {
    EXPECT_EQ(
        refusal(described("<Integer Name=\"A\"><pValue>B</pValue></Integer>\n"
                          "<IntReg Name=\"B\"><Length>4</Length><pIndex>A</pIndex></IntReg>\n")),
        "line 4: 'B' refers to itself, or to more than 64 values one after another");
}

// Each way that the library follows, back to the node itself.
TEST(GenicamDescription, MayNotReferToItselfByAnyWay) {
    for (const char* way :
         {"<pValue>A</pValue>", "<pValue> A</pValue>", "<pVariable Name=\"V\">A</pVariable>",
          "<pAddress>A</pAddress>", "<pLength>A</pLength>", "<pValueDefault>A</pValueDefault>",
          "<pValueIndexed Index=\"1\">A</pValueIndexed>", "<pIndex pOffset=\"A\">B</pIndex>",
          "<pCommandValue>A</pCommandValue>", "<pValue>A<![CDATA[x]]></pValue>",
          "<IntSwissKnife Name=\"C\"><pVariable Name=\"V\">A</pVariable></IntSwissKnife>"})
        EXPECT_NE(refusal(described(fmt::format("<IntReg Name=\"A\">{}</IntReg>", way))), none)
            << way;
    EXPECT_NE(refusal(described("<StructReg Name=\"S\"><pAddress>A</pAddress>"
                                "<StructEntry Name=\"A\"><Bit>3</Bit></StructEntry></StructReg>")),
              "");
}

TEST(GenicamDescription, HasAnEndToItsReferences) {
    EXPECT_EQ(refusal(chain(65, 1)), none);
    EXPECT_NE(refusal(chain(66, 1)), none);
    EXPECT_EQ(refusal(chain(16, 2)), none);  // 2^16 - 1 values
    EXPECT_EQ(refusal(chain(17, 2)), "line 3: 'N0' takes more than 100000 other values");
}

TEST(GenicamDescription, HasRegistersThatFitMemory) {
    for (const char* length :
         {"-1", "1073741825", "0x7fffffffffffffff", "322222222222222222222222"})
        EXPECT_EQ(refusal(described(fmt::format(
                      "<StringReg Name=\"A\"><Length>{}</Length></StringReg>", length))),
                  fmt::format("line 3: a register of {} bytes", length));
    EXPECT_EQ(refusal(described("<Register Name=\"A\"><Length>1073741824</Length></Register>")),
              none);
}

TEST(GenicamDescription, IsWellFormed) {
    EXPECT_EQ(refusal("<?xml version=\"1.0\" ecription=\"x\"?>\n<RegisterDescription/>"),
              "line 1: not well-formed XML");
    EXPECT_EQ(refusal(described("<Integer Name=\"A\">\n<Float>\n</Integer>")),
              "line 6: not well-formed XML");
    EXPECT_NE(refusal(""), none);
}

// ---- chunk layout

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
