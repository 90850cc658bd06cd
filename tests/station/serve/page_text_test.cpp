// The page's files as texts: what no browser is needed for.

#include <regex>

#include "station/serve/page_server.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Texts = std::map<std::string, std::string>;

const std::filesystem::path web = std::filesystem::path(ETALON_SOURCE_DIR) / "web";

std::vector<std::smatch> all(const std::string& text, const std::string& pattern) {
    const std::regex expression(pattern);
    return {std::sregex_iterator(text.begin(), text.end(), expression), {}};
}

// The entries `key: 'text'` of one language.
Texts texts_of(const std::string& language) {
    static const std::string file = read_text(web / "strings.js");
    const std::size_t begin = file.find("\n  " + language + ": {");
    const std::string part = file.substr(begin, file.find("\n  },", begin) - begin);
    Texts texts;
    for (const std::smatch& entry : all(part, "(\\w+): '([^']*)'"))
        EXPECT_TRUE(texts.emplace(entry[1], entry[2]).second) << entry[1] << " is there twice";
    return texts;
}

std::multiset<std::string> places_in(const std::string& text) {
    std::multiset<std::string> places;
    for (const std::smatch& place : all(text, "\\{(\\w+)\\}"))
        places.insert(place[1]);
    return places;
}

TEST(PageText, IsThereInBothLanguagesWithTheSamePlaces) {
    const Texts english = texts_of("en"), german = texts_of("de");
    ASSERT_GT(english.size(), 100u);
    for (const auto& [key, text] : english) {
        ASSERT_TRUE(german.contains(key)) << key << " is not there in German";
        EXPECT_EQ(places_in(text), places_in(german.at(key))) << key;
        EXPECT_FALSE(text.empty() || german.at(key).empty()) << key;
    }
    EXPECT_EQ(english.size(), german.size());
}

TEST(PageText, HasEveryTextThatThePageShowsAndNoOther) {
    const Texts english = texts_of("en");
    std::string page;
    for (const auto& file : std::filesystem::directory_iterator(web))
        if (file.path().filename() != "strings.js")
            page += read_text(file.path());
    std::set<std::string> shown;
    for (const char* pattern : {"text\\('(\\w+)'", "data-(?:text|label)=\"(\\w+)\"",
                                "text\\([^()]* \\? '(\\w+)'", "text\\([^()]* : '(\\w+)'"})
        for (const std::smatch& use : all(page, pattern))
            shown.insert(use[1]);
    for (const std::string& key : shown)
        EXPECT_TRUE(english.contains(key)) << key << " is shown";
    // Made from a word: text(`phase_${...}`).
    std::vector<std::string> beginnings;
    for (const std::smatch& use : all(page, "text\\(`(\\w+_)\\$\\{"))
        beginnings.push_back(use[1]);
    for (const auto& [key, text] : english) {
        const bool is_made = std::any_of(beginnings.begin(), beginnings.end(),
                                         [&](const auto& begin) { return key.starts_with(begin); });
        EXPECT_TRUE(is_made || shown.contains(key)) << key << " is shown nowhere";
    }
}

// What comes from a file, a device or a person must never become part of the page's code.
TEST(PageText, NothingIsParsedAsHtmlOrLoadedFromElsewhere) {
    for (const auto& file : std::filesystem::directory_iterator(web)) {
        const std::string text = read_text(file.path());
        EXPECT_THAT(text, Not(testing::ContainsRegex(
                              "innerHTML|outerHTML|insertAdjacentHTML|document\\.write|eval\\(|"
                              "new Function|style=|srcdoc|javascript:")))
            << file.path();
        for (const std::smatch& address : all(text, "https?://[^\"' )]*"))
            EXPECT_TRUE(address.str().starts_with("http://www.w3.org/")) << address.str();
    }
}

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
