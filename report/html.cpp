#include "report/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <string_view>

#include "core/errors.h"
#include "core/text.h"

namespace etalon {
namespace {

constexpr const char* style = R"css(
:root{--paper:#fbfbf9;--card:#fff;--text:#1d2329;--soft:#5a6570;--line:#dfe3e6;--pass:#0b7a4b;
--fail:#b3261e;--unsure:#9a6700;color-scheme:light dark}
@media(prefers-color-scheme:dark){:root{--paper:#14181b;--card:#1c2226;--text:#e4e8ea;
--soft:#9aa5ad;--line:#313a40;--pass:#3ccf8e;--fail:#ff8a80;--unsure:#f2c14e}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--text);font:16px/1.5 system-ui,sans-serif}
main{max-width:1120px;margin:0 auto;padding:24px 20px 64px}
header h1{font-size:1.5rem;margin:.2em 0 0}header p{color:var(--soft);margin:.1em 0 1em}
h2{font-size:1.15rem;margin:2.2em 0 .5em;padding-bottom:.25em;border-bottom:1px solid var(--line)}
p{max-width:75ch;margin:.5em 0}
.verdict{border-left:10px solid var(--tone);background:var(--card);padding:14px 20px;
border-radius:6px;box-shadow:0 1px 3px #0002}
.verdict strong{display:block;font-size:2rem;letter-spacing:.04em;color:var(--tone)}
.verdict p{margin:.1em 0}
.PASS{--tone:var(--pass)}.FAIL,.ERROR{--tone:var(--fail)}.verdict{--tone:var(--unsure)}
.verdict.PASS{--tone:var(--pass)}.verdict.FAIL,.verdict.ERROR{--tone:var(--fail)}
dl.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));gap:10px;margin:16px 0}
dl.facts div{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:8px 12px}
dt{color:var(--soft);font-size:.8rem}dd{margin:0;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.scroll{overflow-x:auto;margin:.8em 0;border:1px solid var(--line);border-radius:6px;background:var(--card)}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{padding:6px 12px;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--soft);font-weight:600;min-width:9ch}@media(min-width:700px){td:first-child{white-space:nowrap}}tr:last-child td{border-bottom:0}
@media(max-width:500px){th,td{padding:5px 7px}th{min-width:0}}
td.n,th.n{text-align:right;white-space:nowrap}td.PASS,td.FAIL{color:var(--tone);font-weight:700}
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,440px),1fr));gap:16px;margin:1em 0}
figure{margin:0;background:var(--card);border:1px solid var(--line);border-radius:6px;padding:10px}
figure img{width:100%;height:auto;image-rendering:pixelated;display:block}
figcaption{color:var(--soft);font-size:.85rem;margin-top:6px}
svg.plot{width:100%;height:auto;font:12px system-ui,sans-serif;display:block}
.plot text{fill:var(--text)}.plot .grid{stroke:var(--line)}.plot .axis{stroke:var(--soft);fill:none}
.blue{--ink:#0072b2}.orange{--ink:#e69f00}.green{--ink:#009e73}.red{--ink:#d55e00}
.purple{--ink:#cc79a7}.sky{--ink:#56b4e9}.gray{--ink:#8a949b}
.plot .mark{fill:var(--ink)}.plot .stroke{stroke:var(--ink);fill:none}.plot .area{fill:var(--ink);opacity:.2}
details{margin:1em 0}summary{cursor:pointer;font-weight:600}code{font-size:.92em}
@media print{body{background:#fff}.figures{break-inside:avoid}details>*{display:block}}
)css";

bool is_numeric(const std::string& cell) {
    return cell.empty() || cell == "–" || parse_number(cell).has_value();
}

// Which columns hold only numbers (and at least one).
std::vector<bool> numeric_columns(std::size_t columns, const TableRows& rows) {
    std::vector<bool> numeric(columns, !rows.empty());
    for (const auto& row : rows)
        for (std::size_t i = 0; i < columns && i < row.size(); ++i)
            numeric[i] = numeric[i] && is_numeric(row[i]);
    return numeric;
}

std::string base64(const std::vector<unsigned char>& bytes) {
    constexpr std::string_view letters =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    text.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const std::size_t present = std::min<std::size_t>(3, bytes.size() - i);
        unsigned word = 0;
        for (std::size_t k = 0; k < 3; ++k)
            word = (word << 8) | (k < present ? bytes[i + k] : 0u);
        for (std::size_t k = 0; k < 4; ++k)
            text += k <= present ? letters[(word >> (18 - 6 * k)) & 63u] : '=';
    }
    return text;
}

std::string data_uri(const cv::Mat& picture, const std::string& extension,
                     const std::string& media_type, const std::vector<int>& parameters) {
    std::vector<unsigned char> bytes;
    if (!cv::imencode(extension, picture, bytes, parameters))
        throw Error("a picture of the report cannot be encoded as " + media_type);
    return "data:" + media_type + ";base64," + base64(bytes);
}

std::string image_element(const cv::Mat& picture, const std::string& uri, const std::string& alt) {
    return fmt::format("<img alt=\"{}\" width=\"{}\" height=\"{}\" src=\"{}\">", escape_html(alt),
                       picture.cols, picture.rows, uri);
}

}  // namespace

HtmlPage::HtmlPage(std::string title, std::string subtitle)
    : title_(std::move(title)), subtitle_(std::move(subtitle)) {}

void HtmlPage::add_style(const std::string& css) {
    style_ += css;
}

void HtmlPage::add_verdict(const std::string& outcome, const std::string& sentence) {
    body_ += fmt::format("<section class=\"verdict {}\"><strong>{}</strong><p>{}</p></section>\n",
                         escape_html(outcome), escape_html(outcome), escape_html(sentence));
}

void HtmlPage::add_heading(const std::string& text) {
    body_ += "<h2>" + escape_html(text) + "</h2>\n";
}

void HtmlPage::add_paragraph(const std::string& text) {
    body_ += "<p>" + escape_html(text) + "</p>\n";
}

void HtmlPage::add_html(std::string html) {
    body_ += std::move(html);
}

void HtmlPage::add_facts(const Facts& facts) {
    body_ += "<dl class=\"facts\">";
    for (const auto& [label, value] : facts)
        body_ += fmt::format("<div><dt>{}</dt><dd>{}</dd></div>", escape_html(label),
                             escape_html(value));
    body_ += "</dl>\n";
}

void HtmlPage::add_table(const std::vector<std::string>& header, const TableRows& rows) {
    body_ += table_html(header, rows) + "\n";
}

std::string table_html(const std::vector<std::string>& header, const TableRows& rows) {
    const std::vector<bool> numeric = numeric_columns(header.size(), rows);
    std::string text = "<div class=\"scroll\"><table><thead><tr>";
    for (std::size_t i = 0; i < header.size(); ++i)
        text +=
            fmt::format("<th{}>{}</th>", numeric[i] ? " class=\"n\"" : "", escape_html(header[i]));
    text += "</tr></thead><tbody>";
    for (const auto& row : rows) {
        text += "<tr>";
        for (std::size_t i = 0; i < row.size(); ++i) {
            const bool outcome = row[i] == "PASS" || row[i] == "FAIL";
            const std::string css = i < numeric.size() && numeric[i] ? "n" : outcome ? row[i] : "";
            text += fmt::format("<td{}>{}</td>", css.empty() ? "" : " class=\"" + css + "\"",
                                escape_html(row[i]));
        }
        text += "</tr>";
    }
    return text + "</tbody></table></div>";
}

void HtmlPage::add_software(const std::vector<SoftwareVersion>& software) {
    TableRows rows;
    for (const SoftwareVersion& each : software)
        rows.push_back({each.name, each.version});
    add_table({"software", "version"}, rows);
}

void HtmlPage::add_figures(const Figures& figures) {
    body_ += "<div class=\"figures\">";
    for (const Figure& figure : figures)
        body_ += figure_html(figure.html, escape_html(figure.caption));
    body_ += "</div>\n";
}

std::string figure_html(const std::string& html, const std::string& caption_html) {
    return fmt::format("<figure>{}<figcaption>{}</figcaption></figure>", html, caption_html);
}

void HtmlPage::begin_details(const std::string& summary) {
    body_ += "<details><summary>" + escape_html(summary) + "</summary>\n";
}

void HtmlPage::end_details() {
    body_ += "</details>\n";
}

std::string HtmlPage::finish() const {
    return fmt::format(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
        "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">"
        "<title>{}</title><style>{}{}</style></head>\n<body><main><header><h1>{}</h1><p>{}</p></"
        "header>\n"
        "{}</main></body></html>\n",
        escape_html(title_), style, style_, escape_html(title_), escape_html(subtitle_), body_);
}

std::string png_data_uri(const cv::Mat& picture) {
    return data_uri(picture, ".png", "image/png", {});
}

std::string embedded_png(const cv::Mat& picture, const std::string& alt) {
    return image_element(picture, png_data_uri(picture), alt);
}

std::string embedded_jpeg(const cv::Mat& picture, int quality, const std::string& alt) {
    return image_element(
        picture, data_uri(picture, ".jpg", "image/jpeg", {cv::IMWRITE_JPEG_QUALITY, quality}), alt);
}

}  // namespace etalon
