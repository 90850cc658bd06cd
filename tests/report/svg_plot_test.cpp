#include "report/svg_plot.h"

#include <opencv2/imgcodecs.hpp>

#include "report/html.h"
#include "tests/test.h"

namespace etalon {
namespace {

// All values of one attribute, in order.
std::vector<double> attribute(const std::string& svg, const std::string& element,
                              const std::string& name) {
    std::vector<double> values;
    const std::regex pattern("<" + element + "[^>]* " + name + "='([-0-9.]+)'");
    for (std::sregex_iterator it(svg.begin(), svg.end(), pattern), end; it != end; ++it)
        values.push_back(std::stod((*it)[1]));
    return values;
}

// Where the points of the plot, or the tails of its arrows, are in the picture.
struct Drawn {
    std::string svg;
    std::vector<double> cx, cy;
    explicit Drawn(const SvgPlot& plot)
        : svg(plot.svg()), cx(attribute(svg, "circle", "cx")), cy(attribute(svg, "circle", "cy")) {}
};

Drawn points(SvgPlot plot, const Series& series) {
    plot.add_points(series, Color::blue, "points");
    return Drawn(plot);
}

TEST(SvgPlot, KeepsOrderAndProportionOfThePoints) {
    const auto [svg, cx, cy] = points(SvgPlot("x / mm", "y / mm"), {{0, 7, 14}, {5, 0, 10}});
    ASSERT_EQ(cx.size(), 3u);
    EXPECT_NEAR(cx[1] - cx[0], cx[2] - cx[1], 0.11);  // one decimal in the picture
    EXPECT_NEAR(cy[1] - cy[0], cy[0] - cy[2], 0.11);  // larger y is higher up
    EXPECT_GT(cy[1], cy[0]);
}

TEST(SvgPlot, ImageAxesHaveOneScaleAndYDown) {
    SvgPlot plot("x / px", "y / px");
    plot.set_image_axes();
    const auto [svg, cx, cy] = points(plot, {{0, 100, 0}, {0, 0, 30}});
    EXPECT_NEAR((cx[1] - cx[0]) * 0.3, cy[2] - cy[0], 0.2);
}

TEST(SvgPlot, LeavesOutWhatIsNotFinite) {
    SvgPlot plot("x", "y");
    const std::vector<double> xs{1, std::numeric_limits<double>::quiet_NaN(), 3},
        ys{2, 5, std::numeric_limits<double>::infinity()};
    plot.add_points({xs, ys}, Color::blue, "points");
    plot.add_line({xs, ys}, Color::red, "line");
    const std::string svg = plot.svg();
    EXPECT_EQ(attribute(svg, "circle", "cx").size(), 1u);
    EXPECT_EQ(svg.find("nan"), std::string::npos);
    EXPECT_EQ(svg.find("inf"), std::string::npos);
}

// 1, 10 and 100 at equal distances, named as they are.
TEST(SvgPlot, PlacesALogarithmicAxisByRatios) {
    SvgPlot plot("x", "y");
    plot.set_log_y_axis();
    const auto [svg, cx, cy] = points(plot, {{1, 2, 3}, {1, 10, 100}});
    EXPECT_NEAR(cy[0] - cy[1], cy[1] - cy[2], 0.11);
    EXPECT_NEAR(cx[1] - cx[0], cx[2] - cx[1], 0.11);
    EXPECT_NE(svg.find(">20</text>"), std::string::npos);
}

TEST(SvgPlot, BreaksALegendThatIsTooLong) {
    SvgPlot plot("x", "y");
    plot.set_size(300, 200);
    const std::vector<double> xs{1, 2}, ys{3, 4};
    for (const char* name : {"the first of them", "the second of them", "the third"})
        plot.add_line({xs, ys}, Color::blue, name);
    const std::vector<double> x = attribute(plot.svg(), "rect class='mark'", "x");
    ASSERT_EQ(x.size(), 3u);
    EXPECT_EQ(x[0], x[1]);  // one below the other
    for (const double each : x)
        EXPECT_LT(each, 300.0 - 15.0);
}

TEST(SvgPlot, DrawsAnEmptyPlotWithoutData) {
    EXPECT_NE(SvgPlot("x", "y").svg().find("<svg"), std::string::npos);
}

TEST(SvgPlot, ShowsTheNoteOfEachPoint) {
    const Drawn drawn =
        points(SvgPlot("x", "y"), {{1, 2}, {3, 4}, {}, {}, {"pose 7 <b>", "pose 5"}});
    EXPECT_NE(drawn.svg.find("<title>pose 7 &lt;b&gt;</title>"), std::string::npos);
}

TEST(SvgPlot, RoundScalesAreOneTwoOrFiveAndNotAboveTheValue) {
    EXPECT_DOUBLE_EQ(round_scale(1.7), 1.0);
    EXPECT_DOUBLE_EQ(round_scale(43.0), 20.0);
    EXPECT_DOUBLE_EQ(round_scale(0.0077), 0.005);
}

TEST(SvgPlot, ArrowsAreDrawnMagnified) {
    Series arrows;
    arrows.add({3.0, 5.0}, {0.3, -0.4}, "first");
    arrows.add({7.0, 5.0}, {0.0, 0.2});
    EXPECT_DOUBLE_EQ(arrows.longest(), 0.5);
    SvgPlot plot("x / px", "y / px");
    plot.set_image_axes();
    plot.add_arrows(arrows, 10.0, Color::blue, "arrows");
    const auto [svg, cx, cy] = Drawn(plot);
    ASSERT_EQ(cx.size(), 2u);
    const std::regex path("M([0-9.]+) ([0-9.]+)L([0-9.]+) ([0-9.]+)");
    std::smatch found;
    ASSERT_TRUE(std::regex_search(svg, found, path));
    const double scale = (cx[1] - cx[0]) / 4.0;  // px of the picture per plot unit
    EXPECT_NEAR(std::stod(found[3]) - std::stod(found[1]), 3.0 * scale, 0.2);
    EXPECT_NEAR(std::stod(found[4]) - std::stod(found[2]), -4.0 * scale, 0.2);
}

// A cloud of 2000 points in a tenth of the picture, and two that stand alone.
TEST(SvgPlot, OfManyPointsDrawsWhatCanBeToldApartAndSaysSo) {
    Series cloud;
    for (int i = 0; i < 2000; ++i)
        cloud.add(std::fmod(0.618034 * i, 1.0), std::fmod(0.754878 * i, 1.0));
    cloud.add(10.0, 0.5);
    cloud.add(3.0, 10.0);
    const auto [svg, cx, cy] = points(SvgPlot("x", "y", 560, 400), cloud);
    // 44 x 29 px of 6 x 6 px, cut at any place.
    EXPECT_GE(cx.size(), 7u * 4u + 2u);
    EXPECT_LE(cx.size(), 9u * 7u + 2u);
    EXPECT_NEAR(cx[cx.size() - 2], *std::ranges::max_element(cx), 0.0);
    EXPECT_NEAR(cy.back(), *std::ranges::min_element(cy), 0.0);
    EXPECT_NE(svg.find("2002 points, one a 6 px square"), std::string::npos);
}

TEST(SvgPlot, OfManyArrowsDrawsTheLongestOfASquare) {
    Series arrows;
    for (int i = 0; i < 500; ++i)
        arrows.add({std::fmod(0.618034 * i, 1.0), std::fmod(0.754878 * i, 1.0)}, {0.001, 0.0},
                   i == 377 ? "kept" : "");
    arrows.us[377] = 0.02;
    SvgPlot plot("x", "y");
    plot.add_arrows(arrows, 1.0, Color::blue, "arrows");
    EXPECT_NE(plot.svg().find("<title>kept</title>"), std::string::npos);
    EXPECT_LT(attribute(plot.svg(), "circle", "cx").size(), 500u);
}

// ---- html

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
