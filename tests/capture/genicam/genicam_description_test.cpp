#include "capture/genicam/genicam_device.h"
#include "tests/test.h"

namespace etalon {
namespace {

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

}  // namespace
}  // namespace etalon
