#include "sim/marker/marker_print.h"

#include <apriltag/tag36h11.h>

#include <opencv2/imgcodecs.hpp>

#include "tests/sim/marker/marker_checks.h"

namespace etalon {
namespace {

const char* const tag_name = "apriltag:36h11:7@50mm";

std::filesystem::path temporary(const std::string& name) {
    static const TemporaryFolder folder;
    return folder / name;
}

// The tag's black square must lie where the page says, at this many pixels a mm.
void expect_tag_on_page(const cv::Mat& image, const PrintPage& page, double px_per_mm) {
    apriltag_family_t* family = tag36h11_create();
    const auto found = seen_apriltags(family, image);
    tag36h11_destroy(family);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_EQ(found[0].id, 7);
    const std::vector<cv::Point2d>& corners = found[0].corners;
    const cv::Point2d first = (page.grid_mm + cv::Point2d(6.25, 6.25)) * px_per_mm;
    const double side = 50.0 * px_per_mm;
    const cv::Point2d half_pixel(0.5, 0.5);
    EXPECT_LT(cv::norm(corners[0] + half_pixel - first), 0.6);
    EXPECT_LT(cv::norm(corners[1] + half_pixel - first - cv::Point2d(side, 0)), 0.6);
    EXPECT_LT(cv::norm(corners[2] + half_pixel - first - cv::Point2d(side, side)), 0.6);
}

// Fills loops of horizontal and vertical edges by the even-odd rule: a pixel is black when an odd
// number of vertical edges lies left of its centre.
template <class Loops>
cv::Mat filled(const Loops& loops, const cv::Size2d& size, double scale) {
    cv::Mat image(cvRound(size.height * scale), cvRound(size.width * scale), CV_8UC1,
                  cv::Scalar::all(255));
    for (const auto& loop : loops) {
        for (std::size_t i = 0; i < loop.size(); ++i) {
            const cv::Point2d a = scale * cv::Point2d(loop[i]);
            const cv::Point2d b = scale * cv::Point2d(loop[(i + 1) % loop.size()]);
            const cv::Range rows(cvRound(std::min(a.y, b.y)), cvRound(std::max(a.y, b.y)));
            const cv::Mat right_of_it = image(rows, cv::Range(cvRound(a.x), image.cols));
            if (a.x == b.x && rows.size() > 0)
                cv::bitwise_not(right_of_it, right_of_it);
        }
    }
    return image;
}

TEST(PrintPage, IsA4UprightOrLyingWhenTheMarkerFitsAndElseItsOwnSize) {
    const auto size = [](const char* spec) {
        const PrintPage page = lay_out_page(parse_marker(spec, "--marker"), false);
        return std::pair(page.width_mm, page.height_mm);
    };
    EXPECT_EQ(size(tag_name), std::pair(210.0, 297.0));
    EXPECT_EQ(size("chessboard:9x6@20mm"), std::pair(297.0, 210.0));  // 240 x 180 mm
    EXPECT_EQ(size("chessboard:6x9@20mm"), std::pair(210.0, 297.0));
    EXPECT_EQ(size("chessboard:9x6@40mm"), std::pair(12 * 40.0 + 10.0, 9 * 40.0 + 22.0));
}

TEST(PrintPage, KeepsScaleBarAndCaptionOffTheQuietZoneAndOnThePage) {
    for (const char* spec :
         {tag_name, "apriltag:36h11:7@160mm", "chessboard:9x6@40mm", "aruco:4X4_50:7@5mm"}) {
        for (const bool own_size : {false, true}) {
            const Marker marker = parse_marker(spec, "--marker");
            const PrintPage page = lay_out_page(marker, own_size);
            const double grid_end = page.grid_mm.y + marker.grid.rows() * marker.grid.cell_mm.y();
            EXPECT_GE(page.grid_mm.x, 0.0) << spec;
            EXPECT_GE(page.grid_mm.y, 0.0) << spec;
            EXPECT_GT(page.scale_bar_mm.y, grid_end + 1.0) << spec;
            EXPECT_GT(page.caption_mm.y - page.font_mm, page.scale_bar_mm.br().y) << spec;
            EXPECT_LT(page.caption_mm.y, page.height_mm) << spec;
            EXPECT_LT(page.scale_bar_mm.br().x, page.width_mm) << spec;
            EXPECT_TRUE(page.scale_bar_mm.width == 50.0 || page.scale_bar_mm.width == 100.0);
            EXPECT_THAT(page.caption, HasSubstr(spec));
        }
    }
}

TEST(Outline, HoldsOnlyTheOuterEdgesWithHolesAndTouchingCorners) {
    // A ring of 8 cells: outer and inner square.
    const cv::Mat ring = (cv::Mat_<std::uint8_t>(3, 3) << 1, 1, 1, 1, 0, 1, 1, 1, 1);
    const Outline loops = outline_of(ring);
    ASSERT_EQ(loops.size(), 2u);
    EXPECT_EQ(loops[0].size(), 4u);
    EXPECT_EQ(loops[1].size(), 4u);
    // Cells that touch at a corner: 8 corners in all, in one loop or two.
    std::size_t corners = 0;
    for (const auto& loop : outline_of((cv::Mat_<std::uint8_t>(2, 2) << 1, 0, 0, 1)))
        corners += loop.size();
    EXPECT_EQ(corners, 8u);
    EXPECT_TRUE(outline_of(cv::Mat::zeros(5, 7, CV_8UC1)).empty());
}

TEST(Outline, FillsBackToTheSameCells) {
    const Marker marker = parse_marker("aruco:7X7_50:5@45mm", "--marker");
    const cv::Mat black = marker.grid.cells < 0.5f;
    const Outline loops = outline_of(black);
    for (const auto& loop : loops)
        for (std::size_t i = 0; i < loop.size(); ++i) {
            const cv::Point step = loop[(i + 1) % loop.size()] - loop[i];
            ASSERT_TRUE((step.x == 0) != (step.y == 0));
        }
    const cv::Mat white = filled(loops, black.size(), 1.0);
    EXPECT_EQ(cv::countNonZero((white == 0) != black), 0);
}

// The page at 8 px a mm, of the steps that a pattern finds: x and y in mm, y down, and before or
// behind them M or m where a loop begins.
cv::Mat painted(const std::string& text, const char* pattern, const PrintPage& page) {
    std::vector<std::vector<cv::Point2d>> loops;
    const std::regex step(pattern);
    for (std::sregex_iterator it(text.begin(), text.end(), step), end; it != end; ++it) {
        const bool letter_first = std::isalpha(static_cast<unsigned char>(*(*it)[1].first)) != 0;
        const std::string letter = (*it)[letter_first ? 1 : 3];
        if (letter == "M" || letter == "m")
            loops.emplace_back();
        const std::size_t x = letter_first ? 2 : 1;
        loops.back().emplace_back(std::stod((*it)[x]), std::stod((*it)[x + 1]));
    }
    return filled(loops, {page.width_mm, page.height_mm}, 8.0);
}

TEST(MarkerSvg, HasItsSizeInMillimetresAndATagThatIsFound) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const PrintPage page = lay_out_page(marker, false);
    const std::string svg = marker_svg(marker, page);
    EXPECT_THAT(svg, HasSubstr("width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\""));
    EXPECT_THAT(svg, HasSubstr("width=\"100\" height=\"1.5\""));  // the scale bar
    EXPECT_THAT(svg, HasSubstr(tag_name));
    std::smatch path;
    ASSERT_TRUE(std::regex_search(svg, path, std::regex("fill=\"#000000\"[^>]* d=\"([^\"]*)\"")));
    expect_tag_on_page(painted(path[1], "([ML])([-0-9.e]+) ([-0-9.e]+)", page), page, 8.0);
}

TEST(MarkerSvg, EscapesTheNameOfABitmapAndPaintsDarkerShadesOverLighterOnes) {
    const auto path = temporary("a<b>&\"c.png");
    cv::imwrite(path.string(), cv::Mat((cv::Mat_<std::uint8_t>(1, 3) << 0, 128, 255)));
    const Marker marker = parse_marker("bitmap:" + path.string() + "@30x20mm", "--marker");
    const std::string svg = marker_svg(marker, lay_out_page(marker, false));
    EXPECT_THAT(svg, HasSubstr("a&lt;b&gt;&amp;&quot;c.png"));
    EXPECT_THAT(svg, Not(HasSubstr("a<b>")));
    // Radiance 128/255 = 0.502 is sRGB 188 = bc.
    const auto gray = svg.find("#bcbcbc"), black = svg.find("#000000");
    ASSERT_NE(gray, std::string::npos);
    EXPECT_LT(gray, black);
}

TEST(MarkerPdf, HasItsSizeInPointsAndATagThatIsFound) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const PrintPage page = lay_out_page(marker, false);
    const std::string pdf = marker_pdf(marker, page);
    // A4 in points: 210 / 25.4 * 72 = 595.2756, 297 / 25.4 * 72 = 841.8898.
    EXPECT_THAT(pdf, HasSubstr("/MediaBox [0 0 595.275591 841.889764]"));
    EXPECT_THAT(pdf, HasSubstr("\n2.83464567 0 0 -2.83464567 0 841.889764 cm\n"));
    EXPECT_THAT(pdf, HasSubstr(" 100 1.5 re f"));
    expect_tag_on_page(painted(pdf, "\n([-0-9.e]+) ([-0-9.e]+) ([ml])(?=\n)", page), page, 8.0);
}

TEST(MarkerPdf, HasACrossReferenceTableWhoseOffsetsAreRight) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const std::string pdf = marker_pdf(marker, lay_out_page(marker, false));
    const std::size_t trailer = pdf.find("startxref\n");
    const std::size_t table = std::stoul(pdf.substr(trailer + 10));
    ASSERT_EQ(pdf.substr(table, 9), "xref\n0 6\n");
    for (std::size_t object = 1; object <= 5; ++object) {
        const std::string entry = pdf.substr(table + 9 + 20 * object, 20);
        EXPECT_EQ(entry.substr(10), " 00000 n \n");
        const std::string head = fmt::format("{} 0 obj\n", object);
        EXPECT_EQ(pdf.substr(std::stoul(entry), head.size()), head);
    }
    const std::size_t stream = pdf.find("stream\n") + 7;
    const std::size_t length = std::stoul(pdf.substr(pdf.find("/Length ") + 8));
    EXPECT_EQ(pdf.substr(stream + length, 9), "endstream");
}

TEST(MarkerPdf, WritesNamesInLatin1AndEscapesBrackets) {
    Marker marker = parse_marker(tag_name, "--marker");
    marker.spec = "a(b)\\ \xc3\xa9 \xe2\x82\xac";  // e acute, euro sign
    const std::string pdf = marker_pdf(marker, lay_out_page(marker, false));
    EXPECT_THAT(pdf, HasSubstr("(a\\(b\\)\\\\ \\351 ?   \\(bar: 100 mm\\))"));
}

TEST(MarkerPdf, IsRenderedByAnIndependentProgram) {
    if (std::system("pdftoppm -v > /dev/null 2>&1") != 0)
        GTEST_SKIP() << "pdftoppm (poppler-utils) is not installed";
    const auto pdf = temporary("page.pdf"), out = temporary("page");
    const PrintPage page = print_marker(parse_marker(tag_name, "--marker"), pdf, 40.0);
    const std::string command =
        fmt::format("pdftoppm -r 127 -gray -singlefile -png '{}' '{}'", pdf.string(), out.string());
    ASSERT_EQ(std::system(command.c_str()), 0);
    const cv::Mat image = cv::imread(out.string() + ".png", cv::IMREAD_GRAYSCALE);
    // 210 x 297 mm at 5 px/mm; renderers differ in how they round a fraction of a pixel up.
    EXPECT_NEAR(image.cols, 1050, 1);
    EXPECT_NEAR(image.rows, 1485, 1);
    expect_tag_on_page(image, page, 5.0);
}

TEST(MarkerPng, HoldsTheTagAtItsResolution) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const PrintPage page = lay_out_page(marker, true);
    EXPECT_EQ(page.width_mm, 72.5);  // 62.5 mm and two margins of 5
    const cv::Mat image =
        cv::imdecode(marker_png(marker, page, 7.3), cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
    EXPECT_EQ(image.size(), cv::Size(529, 617));  // 72.5 and 84.5 mm at 7.3
    expect_tag_on_page(image, page, 7.3);
}

// 72 dots per inch are 2835 per metre: the chunk as countless image programs write it.
TEST(MarkerPng, SaysItsResolutionInAChunkWithTheRightChecksum) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const auto png = marker_png(marker, lay_out_page(marker, true), 2.8349);
    const std::vector<unsigned char> expected{0,    0,    0x00, 9,    'p',  'H',  'Y',
                                              's',  0,    0,    0x0b, 0x13, 0,    0,
                                              0x0b, 0x13, 1,    0x00, 0x9a, 0x9c, 0x18};
    EXPECT_EQ(std::vector(png.begin() + 33, png.begin() + 54), expected);
}

TEST(MarkerPng, RefusesAResolutionThatCannotShowTheCells) {
    const Marker marker = parse_marker(tag_name, "--marker");
    const PrintPage page = lay_out_page(marker, true);
    for (const double bad : {0.0, -5.0, std::nan(""), HUGE_VAL, 1e-9, 0.3, 500.0})
        EXPECT_THROW(marker_png(marker, page, bad), ConfigError) << bad;
}

TEST(PrintMarker, WritesEveryKindOfBoardInEveryFormat) {
    for (const char* spec :
         {"chessboard:9x6@25mm", "charuco:4X4_50:9x6@30mm/22mm", "aprilgrid:36h11:6x5@40mm/12mm",
          "circles:7x6@20mm/12mm", "acircles:4x11@20mm/12mm"}) {
        const Marker board = parse_marker(spec, "--marker");
        for (const char* file : {"b.svg", "b.pdf", "b.png"}) {
            EXPECT_NO_THROW(print_marker(board, temporary(file), 12.0)) << spec << ' ' << file;
            EXPECT_GT(std::filesystem::file_size(temporary(file)), 1000u);
        }
        EXPECT_THROW(print_marker(board, temporary("c.png"), 0.07), ConfigError) << spec;
    }
}

TEST(PrintMarker, WritesByExtensionAndLeavesNothingBehindWhenItCannot) {
    const Marker marker = parse_marker(tag_name, "--marker");
    EXPECT_THROW(print_marker(marker, temporary("x.jpg"), 40.0), ConfigError);
    EXPECT_FALSE(std::filesystem::exists(temporary("x.jpg")));
    EXPECT_THROW(print_marker(marker, "/nowhere/at/all.svg", 40.0), ConfigError);
    EXPECT_THROW(print_marker(marker, temporary("x.png"), 0.1), ConfigError);
    EXPECT_FALSE(std::filesystem::exists(temporary("x.png")));
    print_marker(marker, temporary("x.svg"), 40.0);
    EXPECT_THAT(read_text(temporary("x.svg")), StartsWith("<?xml"));
}

}  // namespace
}  // namespace etalon
