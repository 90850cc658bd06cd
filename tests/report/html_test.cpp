#include "report/html.h"

#include <opencv2/imgcodecs.hpp>

#include "tests/test.h"

namespace etalon {
namespace {

TEST(HtmlPage, EscapesWhateverTextItIsGiven) {
    HtmlPage page("<b>title", "sub & title");
    page.add_paragraph("<script>alert(1)</script>");
    page.add_table({"<th>"}, {{"<td>"}});
    EXPECT_THAT(page.finish(), AllOf(Not(HasSubstr("<script>")), Not(HasSubstr("<b>title")),
                                     HasSubstr("&lt;td&gt;")));
}

TEST(HtmlPage, NeedsNothingFromOutside) {
    HtmlPage page("title", "subtitle");
    page.add_figures({{embedded_png(cv::Mat::eye(3, 5, CV_8U) * 255, "eye"), "an eye"}});
    EXPECT_THAT(page.finish(), AllOf(Not(HasSubstr("http:")), Not(HasSubstr("https:")),
                                     HasSubstr("src=\"data:image/png;base64,")));
}

// The PNG signature 89 50 4E 47 0D 0A 1A 0A and the IHDR length 00 00 00 0D in base64, by hand.
TEST(HtmlPage, EmbedsPicturesAsBase64AndLoadsThemWhenTheyComeIntoView) {
    EXPECT_THAT(embedded_png(cv::Mat::zeros(2, 3, CV_8U), "dark"),
                AllOf(HasSubstr("base64,iVBORw0KGgoAAAAN"), HasSubstr("loading=\"lazy\"")));
}

TEST(HtmlPage, AlignsOnlyColumnsOfNumbersToTheRight) {
    EXPECT_THAT(table_html({"name", "value"}, {{"rms", "0.5"}, {"max", "-7"}}),
                HasSubstr("<td>rms</td><td class=\"n\">0.5</td>"));
    EXPECT_THAT(table_html({"name", "value"}, {{"rms", "below 0.037"}, {"max", "7"}}),
                HasSubstr("<td class=\"n\">below 0.037</td>"));
}

TEST(HtmlPage, FoldsWhatIsLong) {
    HtmlPage page("t", "s");
    page.add_table({"pose"}, TableRows(100, {"7"}));
    EXPECT_EQ(page.finish().find("<details>"), std::string::npos);
    page.add_table({"pose"}, TableRows(101, {"7"}));
    page.add_notes(std::vector<std::string>(21, "note"));
    EXPECT_THAT(page.finish(), HasSubstr("<details><summary>101 rows</summary>"));
    EXPECT_THAT(page.finish(), HasSubstr("<details><summary>21 notes</summary>"));
}

// Rows become paragraphs on narrow screens: each value then says what it is.
TEST(HtmlPage, LabelsTheCellsOfWideTables) {
    const std::string html =
        table_html({"name", "outcome", "value", "<unit>"}, {{"rms", "NOT_OBSERVABLE", "7", "mm"}});
    EXPECT_THAT(html, HasSubstr("class=\"stack\""));
    EXPECT_THAT(html,
                HasSubstr("<td class=\"tone unsure\" data-label=\"outcome\">NOT_OBSERVABLE</td>"
                          "<td class=\"n\" data-label=\"value\">7</td>"
                          "<td data-label=\"&lt;unit&gt;\">mm</td>"));
}

TEST(HtmlPage, AnswersBehindTheVerdictAreParagraphsOrLists) {
    HtmlPage page("t", "s");
    page.add_verdict("FAIL", "too large",
                     {{"Cause", {"k1 & k4"}}, {"Do", {"one", "two"}}, {"No", {}}});
    EXPECT_THAT(
        page.finish(),
        HasSubstr("<section class=\"verdict bad\"><div><strong>FAIL</strong><p>too large</p></div>"
                  "<div class=\"answers\"><div><h2>Cause</h2><p>k1 &amp; k4</p></div>"
                  "<div><h2>Do</h2><ul><li>one</li><li>two</li></ul>\n</div></div></section>"));
}

}  // namespace
}  // namespace etalon
