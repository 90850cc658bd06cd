#include "report/json_text.h"

#include <nlohmann/json.hpp>

#include "tests/test.h"

namespace etalon {
namespace {

std::filesystem::path written(const TemporaryFolder& folder, const std::string& text) {
    std::ofstream(folder / "file.json") << text;
    return folder / "file.json";
}

std::string lists(std::size_t depth) {
    return std::string(depth, '[') + std::string(depth, ']');
}

TEST(JsonText, IsReadBackWithItsKeysInTheirOrder) {
    const TemporaryFolder folder;
    const std::string text = R"({"b":1,"a":[2.5,null]})";
    EXPECT_EQ(text_of(read_json(written(folder, text)), -1), text);
    EXPECT_TRUE(read_json(written(folder, "{\"b\":")).is_discarded());
}

// 200 000 lists in each other took all of the stack when they were written again.
TEST(JsonText, IsRefusedWhereItIsDeeperThanTheStack) {
    const TemporaryFolder folder;
    EXPECT_TRUE(read_json(written(folder, lists(50))).is_array());
    EXPECT_THROW(read_json(written(folder, lists(52))), ConfigError);
    EXPECT_THROW(read_json(written(folder, lists(200'000))), ConfigError);
}

}  // namespace
}  // namespace etalon
