#include "station/serve/page_json.h"

#include <gtest/gtest.h>

#include "core/file/text.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

// A record may have been written by anybody: what is of another type is left out, and no word of it
// keeps the rest of the state from the page.
TEST(PageJson, TakesFromADamagedRecordWhatIsWhole) {
    const TemporaryFolder folder;
    write_text(folder / "run.json",
               R"({"outcome": "FAIL", "reasons": 7, "measurements": {}, "pixels": [],
                   "causes": {"ranked": [{"text": "k1", "probability": "0.9"}]}})");
    const nlohmann::ordered_json result = result_json(folder.path());
    EXPECT_EQ(result["outcome"], "FAIL");
    for (const char* list : {"reasons", "quantities", "findings"})
        EXPECT_EQ(result[list], nlohmann::ordered_json::array()) << list;
    EXPECT_TRUE(result["cause"].is_null());
    for (const char* text : {"[]", "{", ""}) {
        write_text(folder / "run.json", text);
        EXPECT_TRUE(result_json(folder.path()).is_null()) << text;
    }
}

}  // namespace
}  // namespace etalon
