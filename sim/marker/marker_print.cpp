#include "sim/marker/marker_print.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <map>
#include <set>

#include "core/file/text.h"
#include "core/image/picture_codec.h"

namespace etalon {
namespace {

constexpr double a4_short_mm = 210.0, a4_long_mm = 297.0;  // ISO 216
constexpr double margin_mm = 5.0;                          // what common printers leave blank
constexpr double footer_mm = 12.0;                         // below the grid: gap, bar, gap, caption
constexpr double bar_gap_mm = 3.0;                         // from the grid to the bar
constexpr double bar_height_mm = 1.5;
constexpr double max_font_mm = 3.5;
constexpr double letter_width = 0.6;  // of the em, on average and generously
constexpr double points_per_mm = 72.0 / 25.4;
constexpr double max_pixels = 400e6;
constexpr std::size_t max_printed_cells = 4'000'000, max_corners = 2'000'000;

// IEC 61966-2-1.
double srgb_encoded(double radiance) {
    if (radiance <= 0.0031308)
        return 12.92 * radiance;
    return 1.055 * std::pow(radiance, 1.0 / 2.4) - 0.055;
}

// An A4 sheet on which it has room, or else the page itself.
cv::Size2d sheet_for(const cv::Size2d& needed) {
    for (const cv::Size2d a4 :
         {cv::Size2d(a4_short_mm, a4_long_mm), cv::Size2d(a4_long_mm, a4_short_mm)})
        if (needed.width <= a4.width && needed.height <= a4.height)
            return a4;
    return needed;
}

// Directed edges of the boundary with the inside on their right (y down), by starting corner.
using Edges = std::map<std::pair<int, int>, std::vector<cv::Point>>;

Edges boundary_edges(const cv::Mat& mask) {
    const auto inside = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < mask.cols && y < mask.rows &&
               mask.at<std::uint8_t>(y, x) != 0;
    };
    Edges edges;
    const auto add = [&](bool is_forward, cv::Point a, cv::Point b) {
        const cv::Point from = is_forward ? a : b;
        edges[{from.y, from.x}].push_back(is_forward ? b : a);
    };
    for (int y = 0; y <= mask.rows; ++y)
        for (int x = 0; x <= mask.cols; ++x) {
            const bool here = inside(x, y);
            if (here != inside(x, y - 1))
                add(here, {x, y}, {x + 1, y});
            if (here != inside(x - 1, y))
                add(here, {x, y + 1}, {x, y});
        }
    return edges;
}

// Follows edges from corner to corner until back at the start; straight runs become one edge.
std::vector<cv::Point> take_loop(Edges& edges) {
    std::vector<cv::Point> loop;
    const cv::Point start(edges.begin()->first.second, edges.begin()->first.first);
    cv::Point at = start;
    do {
        const auto leaving = edges.find({at.y, at.x});
        const cv::Point next = leaving->second.back();
        leaving->second.pop_back();
        if (leaving->second.empty())
            edges.erase(leaving);
        if (loop.empty() || (at - loop.back()).cross(next - at) != 0)
            loop.push_back(at);
        at = next;
    } while (at != start);
    return loop;
}

}  // namespace

PrintPage lay_out_page(const Marker& marker, bool own_size) {
    const CellGrid& grid = marker.grid;
    const double grid_width = grid.columns() * grid.cell_mm.x();
    const double grid_height = grid.rows() * grid.cell_mm.y();
    const cv::Size2d needed(std::max(grid_width + 2.0 * margin_mm, 50.0 + 2.0 * margin_mm),
                            grid_height + 2.0 * margin_mm + footer_mm);
    const cv::Size2d size = own_size ? needed : sheet_for(needed);
    PrintPage page;
    page.width_mm = size.width;
    page.height_mm = size.height;
    page.grid_mm = {(size.width - grid_width) / 2.0, (size.height - footer_mm - grid_height) / 2.0};
    const double bar_mm = size.width >= 100.0 + 2.0 * margin_mm ? 100.0 : 50.0;
    const double footer_top = size.height - margin_mm - footer_mm;
    page.scale_bar_mm = {margin_mm, footer_top + bar_gap_mm, bar_mm, bar_height_mm};
    page.caption = fmt::format("{}   (bar: {} mm)", marker.spec, bar_mm);
    page.caption_mm = {margin_mm, size.height - margin_mm - 1.0};
    page.font_mm = std::min(
        max_font_mm, (size.width - 2.0 * margin_mm) / (letter_width * double(page.caption.size())));
    return page;
}

Outline outline_of(const cv::Mat& mask) {
    Edges edges = boundary_edges(mask);
    Outline outline;
    while (!edges.empty())
        outline.push_back(take_loop(edges));
    return outline;
}

namespace {

// The cells as 8-bit shades, CV_8UC1, sRGB-encoded.
cv::Mat printed_shades(const Marker& marker) {
    cv::Mat shades(marker.grid.cells.size(), CV_8UC1);
    std::transform(
        marker.grid.cells.begin<float>(), marker.grid.cells.end<float>(),
        shades.begin<std::uint8_t>(), [](float radiance) {
            return static_cast<std::uint8_t>(std::floor(srgb_encoded(radiance) * 255.0 + 0.5));
        });
    return shades;
}

// To be painted in this order: each layer covers every cell at most as light as itself, the darker
// ones over the lighter ones, so that nothing shows between two shades. White is the paper.
struct PrintLayer {
    int gray;  // 0..254
    Outline outline;
};

std::vector<PrintLayer> print_layers(const Marker& marker) {
    const auto refuse = [&] {
        throw ConfigError({marker.spec},
                          "has too many cells and shades to be drawn as outlines: "
                          "write a .png");
    };
    if (marker.grid.cells.total() > max_printed_cells)
        refuse();
    const cv::Mat shades = printed_shades(marker);
    const std::set<int, std::greater<>> grays(shades.begin<std::uint8_t>(),
                                              shades.end<std::uint8_t>());
    std::vector<PrintLayer> layers;
    std::size_t corners = 0;
    for (const int gray : grays) {
        if (gray == 255)
            continue;
        layers.push_back({gray, outline_of(shades <= gray)});
        for (const auto& loop : layers.back().outline)
            corners += loop.size();
        if (corners > max_corners)
            refuse();
    }
    return layers;
}

cv::Point2d on_page(const Marker& marker, const PrintPage& page, cv::Point corner) {
    return {page.grid_mm.x + corner.x * marker.grid.cell_mm.x(),
            page.grid_mm.y + corner.y * marker.grid.cell_mm.y()};
}

// The loops with the given words for "start at", "line to" and "close", in mm.
std::string path_of(const Marker& marker, const PrintPage& page, const Outline& outline,
                    const char* start, const char* line, const char* close) {
    std::string path;
    for (const auto& loop : outline) {
        for (std::size_t i = 0; i < loop.size(); ++i) {
            const cv::Point2d p = on_page(marker, page, loop[i]);
            path += fmt::format(fmt::runtime(i == 0 ? start : line), p.x, p.y);
        }
        path += close;
    }
    return path;
}

// UTF-8 to the bytes of a PDF string (ISO 32000-1) in Latin-1, escaped.
std::string pdf_string(std::string_view text) {
    std::string bytes = "(";
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto c = static_cast<unsigned char>(text[i]);
        const auto next = i + 1 < text.size() ? static_cast<unsigned char>(text[i + 1]) : 0u;
        if (c == '(' || c == ')' || c == '\\')
            bytes += {'\\', static_cast<char>(c)};
        else if (c >= 0x20 && c < 0x7f)
            bytes += static_cast<char>(c);
        else if ((c == 0xc2 || c == 0xc3) && (next & 0xc0) == 0x80)  // U+0080..U+00FF
            bytes += fmt::format("\\{:03o}", ((c & 3u) << 6) | (next & 0x3fu));
        else if ((c & 0xc0) != 0x80)  // once per character
            bytes += '?';
    }
    return bytes + ")";
}

// What is painted: y is turned to point down and the unit to mm first.
std::string pdf_content(const Marker& marker, const PrintPage& page) {
    std::string content = fmt::format("{:.9g} 0 0 {:.9g} 0 {:.9g} cm\n", points_per_mm,
                                      -points_per_mm, page.height_mm * points_per_mm);
    for (const PrintLayer& layer : print_layers(marker))
        content += fmt::format(
            "{:.6g} g\n{}f*\n", layer.gray / 255.0,
            path_of(marker, page, layer.outline, "{:.9g} {:.9g} m\n", "{:.9g} {:.9g} l\n", "h\n"));
    const cv::Rect2d& bar = page.scale_bar_mm;
    content +=
        fmt::format("0 g\n{:.9g} {:.9g} {:.9g} {:.9g} re f\n", bar.x, bar.y, bar.width, bar.height);
    content += fmt::format("BT /F1 {:.9g} Tf 1 0 0 -1 {:.9g} {:.9g} Tm {} Tj ET\n", page.font_mm,
                           page.caption_mm.x, page.caption_mm.y, pdf_string(page.caption));
    return content;
}

std::string pdf_file(const std::vector<std::string>& objects) {
    std::string file = "%PDF-1.6\n%\xe2\xe3\xcf\xd3\n";  // four high bytes: not a text file
    std::string table = fmt::format("xref\n0 {}\n0000000000 65535 f \n", objects.size() + 1);
    for (std::size_t i = 0; i < objects.size(); ++i) {
        table += fmt::format("{:010} 00000 n \n", file.size());
        file += fmt::format("{} 0 obj\n{}\nendobj\n", i + 1, objects[i]);
    }
    const std::size_t table_at = file.size();
    return file + table +
           fmt::format("trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{}\n%%EOF\n",
                       objects.size() + 1, table_at);
}

cv::Mat draw_page(const Marker& marker, const PrintPage& page, double dots_per_mm) {
    const auto dot = [&](double mm) { return static_cast<int>(std::lround(mm * dots_per_mm)); };
    cv::Mat image(dot(page.height_mm), dot(page.width_mm), CV_8UC1, cv::Scalar::all(255));
    const auto fill = [&](cv::Point2d a, cv::Point2d b, int gray) {
        image(cv::Rect(cv::Point(dot(a.x), dot(a.y)), cv::Point(dot(b.x), dot(b.y))))
            .setTo(cv::Scalar::all(gray));
    };
    const cv::Mat shades = printed_shades(marker);
    for (int row = 0; row < shades.rows; ++row) {
        for (int column = 0; column < shades.cols; ++column)
            fill(on_page(marker, page, {column, row}), on_page(marker, page, {column + 1, row + 1}),
                 shades.at<std::uint8_t>(row, column));
    }
    fill(page.scale_bar_mm.tl(), page.scale_bar_mm.br(), 0);
    const int letters = std::max(1, dot(page.font_mm * 0.7));  // height of the capitals
    cv::putText(image, page.caption, {dot(page.caption_mm.x), dot(page.caption_mm.y)},
                cv::FONT_HERSHEY_SIMPLEX,
                cv::getFontScaleFromHeight(cv::FONT_HERSHEY_SIMPLEX, letters, 1),
                cv::Scalar::all(0), std::max(1, letters / 10), cv::LINE_AA);
    return image;
}

void check_resolution(const Marker& marker, const PrintPage& page, double dots_per_mm) {
    const auto refuse = [&](const std::string& message) {
        throw ConfigError({"dots per mm"}, fmt::format("{}: {}", dots_per_mm, message));
    };
    if (!(dots_per_mm >= 0.001 && std::isfinite(dots_per_mm)))
        refuse("is not a resolution of at least a dot per metre");
    const double smallest_mm =
        marker.detail_mm > 0.0 ? marker.detail_mm : marker.grid.cell_mm.minCoeff();
    if (smallest_mm * dots_per_mm < 2.0)
        refuse(fmt::format("a cell of {:.4g} mm would be smaller than 2 dots", smallest_mm));
    if (page.width_mm * page.height_mm * dots_per_mm * dots_per_mm > max_pixels)
        refuse(fmt::format("a page of {:.4g} x {:.4g} mm would have more than {:.0f} megapixels",
                           page.width_mm, page.height_mm, max_pixels / 1e6));
}

}  // namespace

std::string marker_svg(const Marker& marker, const PrintPage& page) {
    std::string svg = fmt::format(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.9g}mm\" height=\"{1:.9g}mm\" "
        "viewBox=\"0 0 {0:.9g} {1:.9g}\">\n"
        "<rect width=\"{0:.9g}\" height=\"{1:.9g}\" fill=\"#ffffff\"/>\n",
        page.width_mm, page.height_mm);
    for (const PrintLayer& layer : print_layers(marker))
        svg += fmt::format(
            "<path fill=\"#{0:02x}{0:02x}{0:02x}\" fill-rule=\"evenodd\" d=\"{1}\"/>\n", layer.gray,
            path_of(marker, page, layer.outline, "M{:.9g} {:.9g}", "L{:.9g} {:.9g}", "Z"));
    const cv::Rect2d& bar = page.scale_bar_mm;
    svg += fmt::format("<rect x=\"{:.9g}\" y=\"{:.9g}\" width=\"{:.9g}\" height=\"{:.9g}\"/>\n",
                       bar.x, bar.y, bar.width, bar.height);
    std::string caption = page.caption;
    std::replace_if(
        caption.begin(), caption.end(), [](unsigned char c) { return c < 0x20; },
        '?');  // XML allows no control characters
    return svg + fmt::format(
                     "<text x=\"{:.9g}\" y=\"{:.9g}\" font-family=\"Helvetica, Arial, "
                     "sans-serif\" font-size=\"{:.9g}\">{}</text>\n</svg>\n",
                     page.caption_mm.x, page.caption_mm.y, page.font_mm, escape_html(caption));
}

std::string marker_pdf(const Marker& marker, const PrintPage& page) {
    const std::string content = pdf_content(marker, page);
    return pdf_file({
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        fmt::format("<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.9g} {:.9g}] /Contents 5 0 R "
                    "/Resources << /Font << /F1 4 0 R >> >> >>",
                    page.width_mm * points_per_mm, page.height_mm * points_per_mm),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        fmt::format("<< /Length {} >>\nstream\n{}endstream", content.size(), content),
    });
}

std::vector<unsigned char> marker_png(const Marker& marker, const PrintPage& page,
                                      double dots_per_mm) {
    check_resolution(marker, page, dots_per_mm);
    const auto dots_per_metre = static_cast<std::uint32_t>(std::lround(dots_per_mm * 1000.0));
    const cv::Mat image = draw_page(marker, page, dots_per_metre / 1000.0);
    return encode_png(image, dots_per_metre);
}

PrintPage print_marker(const Marker& marker, const std::filesystem::path& path,
                       double dots_per_mm) {
    const std::string extension = path.extension().string();
    const PrintPage page = lay_out_page(marker, extension == ".png");
    if (extension == ".svg") {
        write_text(path, marker_svg(marker, page));
    } else if (extension == ".pdf") {
        write_text(path, marker_pdf(marker, page));
    } else if (extension == ".png") {
        const auto png = marker_png(marker, page, dots_per_mm);
        write_text(path, {reinterpret_cast<const char*>(png.data()), png.size()});
    } else {
        throw ConfigError({path.string()}, "a marker is printed to .svg, .pdf or .png");
    }
    return page;
}

}  // namespace etalon
