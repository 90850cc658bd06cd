// A schema says what the reader asked: keys, types, ranges, words, names that files give.
#include "core/config/file_schema.h"

#include <nlohmann/json.hpp>

#include "tests/test.h"

namespace etalon {
namespace {

using nlohmann::json;

// A reader with one of everything.
void read_toy(const std::string& text) {
    const StrictFile file = StrictFile::from_text("etalon: toy/1\n" + text, "toy.yaml", "toy/1");
    const Value root = file.root();
    root.at("id").text();
    if (root.find("on"))
        root.at("on").flag();
    for (const Value& axis : root.at("axes").items()) {
        if (axis.at("kind").one_of({"linear", "rotary"}) == "rotary")
            axis.at("deg").number({-180.0, 180.0, false, "deg"});
        axis.at("count").integer(1, 9);
        axis.at("sign").one_of({"1", "-1"});
    }
    const Value volume = root.at("volume").with_names();
    for (const std::string& name : volume.keys())
        volume.at(name).numbers(2, positive);
    file.finish();
}

json schema_of_toy() {
    ReadTrace trace;
    read_toy("id: a\naxes: [{kind: rotary, deg: 3, count: 1, sign: 1}]\nvolume: {x: [1, 2]}\n");
    read_toy(
        "id: b\non: true\naxes: [{kind: linear, count: 2, sign: -1}]\nvolume: {tilt: [1, 2]}\n");
    return json::parse(file_schemas(trace).at("toy/1"));
}

TEST(FileSchema, RequiresWhatTheReaderAlwaysWants) {
    const json schema = schema_of_toy();
    EXPECT_EQ(schema.at("required"), json({"etalon", "id", "axes", "volume"}));
    const json axis = schema.at("/properties/axes/items"_json_pointer);
    EXPECT_EQ(axis.at("required"), json({"kind", "count", "sign"}));  // deg only of rotary ones
    EXPECT_EQ(axis.at("additionalProperties"), false);
    EXPECT_TRUE(axis.at("properties").contains("deg"));
}

TEST(FileSchema, SaysTypesRangesAndWords) {
    const json schema = schema_of_toy();
    EXPECT_EQ(schema.at("/properties/etalon/const"_json_pointer), "toy/1");
    const json axis = schema.at("/properties/axes/items/properties"_json_pointer);
    EXPECT_EQ(axis.at("kind"), json({{"enum", {"linear", "rotary"}}}));
    EXPECT_EQ(axis.at("sign"), json({{"enum", {"1", "-1", 1, -1}}}));
    EXPECT_EQ(axis.at("count"), json({{"type", "integer"}, {"minimum", 1.0}, {"maximum", 9.0}}));
    EXPECT_EQ(axis.at("deg").at("maximum"), 180.0);
    EXPECT_EQ(axis.at("deg").at("description"), "in deg");
}

// What a profile leaves to the one it extends is not missing, and ~ takes a key of that one away.
TEST(FileSchema, OfFilesThatExtendOthersRequiresNothingButInLists) {
    ReadTrace trace;
    const StrictFile file =
        StrictFile::from_text("etalon: toy/1\nspeed: 3\npoll: [{count: 2}]\n", "toy.yaml", "toy/1");
    file.root().find("extends");
    file.root().at("speed").integer(1, 9);
    file.root().at("poll").items().front().at("count").integer(1, 9);
    file.finish();
    const json schema = json::parse(file_schemas(trace).at("toy/1"));
    EXPECT_FALSE(schema.contains("required"));
    EXPECT_EQ(schema.at("/properties/speed/anyOf/1/type"_json_pointer), "null");
    EXPECT_EQ(schema.at("/properties/poll/anyOf/0/items/required"_json_pointer), json({"count"}));
}

TEST(FileSchema, LeavesNamesThatFilesGiveToThem) {
    const json volume = schema_of_toy().at("/properties/volume"_json_pointer);
    EXPECT_EQ(volume.at("properties"), json::object());
    EXPECT_EQ(volume.at("/additionalProperties/items/exclusiveMinimum"_json_pointer), 0.0);
}

TEST(ReadTrace, NotesNothingWhenItIsGone) {
    { const ReadTrace trace; }
    read_toy("id: a\naxes: []\nvolume: {}\n");
    const ReadTrace later;
    EXPECT_TRUE(later.files.empty());
}

}  // namespace
}  // namespace etalon
