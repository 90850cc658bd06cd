// What every page that the program writes must be, as far as no browser is needed.
#pragma once

#include <regex>

#include "tests/test.h"

namespace etalon::test {

// Every figure's caption is a sentence or more; an outcome stands beside the name of what it is
// about; nothing is loaded from outside.
inline void expect_readable_page(const std::string& page) {
    EXPECT_THAT(page, Not(testing::ContainsRegex("(src|href)=\"?https?:")));
    const auto all = [&](const std::string& pattern) {
        const std::regex expression(pattern);
        return std::vector<std::smatch>(std::sregex_iterator(page.begin(), page.end(), expression),
                                        {});
    };
    const auto captions = all("<figcaption>(?:<div.*?</div>)?([^<]*)</figcaption>");
    EXPECT_EQ(captions.size(), all("<figure").size());
    for (const std::smatch& caption : captions)
        EXPECT_THAT(caption.str(1), testing::MatchesRegex(".+ .+\\.")) << "as a caption";
    EXPECT_THAT(page, Not(testing::ContainsRegex("</th><th[^>]*>[^<]*</th><th>outcome<")));
}

}  // namespace etalon::test
