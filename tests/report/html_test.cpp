#include "report/html.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

namespace etalon {
namespace {

TEST(HtmlPage, EscapesWhateverTextItIsGiven) {
    HtmlPage page("<b>title", "sub & title");
    page.add_paragraph("<script>alert(1)</script>");
    page.add_table({"<th>"}, {{"<td>"}});
    const std::string html = page.finish();
    EXPECT_EQ(html.find("<script>"), std::string::npos);
    EXPECT_EQ(html.find("<b>title"), std::string::npos);
    EXPECT_NE(html.find("&lt;td&gt;"), std::string::npos);
}

TEST(HtmlPage, NeedsNothingFromOutside) {
    HtmlPage page("title", "subtitle");
    page.add_figures({{embedded_png(cv::Mat::eye(3, 5, CV_8U) * 255, "eye"), "an eye"}});
    const std::string html = page.finish();
    EXPECT_EQ(html.find("http:"), std::string::npos);
    EXPECT_EQ(html.find("https:"), std::string::npos);
    EXPECT_NE(html.find("src=\"data:image/png;base64,"), std::string::npos);
}

// The PNG signature 89 50 4E 47 0D 0A 1A 0A and the IHDR length 00 00 00 0D in base64, by hand.
TEST(HtmlPage, EmbedsPicturesAsBase64) {
    EXPECT_NE(embedded_png(cv::Mat::zeros(2, 3, CV_8U), "dark").find("base64,iVBORw0KGgoAAAAN"),
              std::string::npos);
}

TEST(HtmlPage, AlignsOnlyColumnsOfNumbersToTheRight) {
    HtmlPage page("t", "s");
    page.add_table({"name", "value"}, {{"rms", "0.5"}, {"max", "-7"}});
    const std::string html = page.finish();
    EXPECT_NE(html.find("<td>rms</td><td class=\"n\">0.5</td>"), std::string::npos);
}

}  // namespace
}  // namespace etalon
