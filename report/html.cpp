#include "report/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string_view>

#include "core/file/text.h"
#include "core/image/picture_codec.h"
#include "report/number_text.h"

namespace etalon {
namespace {

// Tables of more than three columns become paragraphs on narrow screens (`stack`): what a row is
// about and its outcome, then what the header says before each value.
constexpr const char* style = R"css(
:root{--paper:#f7f8f8;--card:#fff;--text:#1b2127;--soft:#56616b;--line:#dce1e5;--good:#0b7a4b;
--bad:#b3261e;--unsure:#8a5a00;color-scheme:light dark}
.blue{--ink:#0072b2}.orange{--ink:#e69f00}.green{--ink:#009e73}.red{--ink:#d55e00}
.purple{--ink:#aa4f8b}.sky{--ink:#3f9fd8}.gray{--ink:#8a949b}
@media screen and (prefers-color-scheme:dark){:root{--paper:#14181b;--card:#1c2226;--text:#e4e8ea;
--soft:#9aa5ad;--line:#343d44;--good:#3ccf8e;--bad:#ff8a80;--unsure:#f2c14e}
.blue{--ink:#4aa9e6}.orange{--ink:#f0b52e}.green{--ink:#2cc79c}.red{--ink:#ff8450}
.purple{--ink:#dd8fc3}.sky{--ink:#8fd0f7}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--text);
font:16px/1.5 system-ui,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
main{max-width:1160px;margin:0 auto;padding:24px 20px 64px}
main>header h1{font-size:1.5rem;line-height:1.25;margin:.2em 0 0}
main>header p{max-width:none;color:var(--soft);margin:.2em 0 1.2em;overflow-wrap:anywhere}
h2{font-size:1.2rem;margin:2.2em 0 .6em;padding-bottom:.3em;border-bottom:1px solid var(--line)}
p,li{max-width:75ch}p{margin:.5em 0}ul{margin:.5em 0;padding-left:1.2em}li{margin:.2em 0}
.good{--tone:var(--good)}.bad{--tone:var(--bad)}.unsure{--tone:var(--unsure)}.plain{--tone:var(--soft)}
.verdict{background:var(--card);border:1px solid var(--line);border-left:8px solid var(--tone,var(--soft));
border-radius:8px;overflow:hidden;margin:0 0 20px}
.verdict>div:first-child{display:flex;flex-wrap:wrap;align-items:baseline;gap:2px 24px;padding:14px 22px;
background:color-mix(in srgb,var(--tone,var(--soft)) 9%,var(--card))}
.verdict strong{font-size:clamp(1.5rem,8vw,2.4rem);line-height:1.2;letter-spacing:.02em;color:var(--tone,var(--text))}
.verdict>div:first-child p{flex:1 1 320px;max-width:none;font-size:1.05rem}
.answers{display:flex;flex-wrap:wrap}
.answers>div{flex:1 1 380px;padding:12px 22px;border-top:1px solid var(--line)}
.answers h2{font-size:.85rem;color:var(--soft);border:0;padding:0;margin:0}
.answers p,.answers ul{margin:.2em 0}
dl.facts{display:flex;flex-wrap:wrap;gap:1px;margin:16px 0;
background:var(--line);border:1px solid var(--line);border-radius:8px;overflow:hidden}
dl.facts div{flex:1 1 150px;background:var(--card);padding:8px 12px}
dt{color:var(--soft);font-size:.8rem}dd{margin:0;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.table{overflow-x:auto;margin:.8em 0;border:1px solid var(--line);border-radius:8px;background:var(--card)}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{padding:6px 12px;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
th{color:var(--soft);font-weight:600;vertical-align:bottom}tr:last-child td{border-bottom:0}
td{overflow-wrap:break-word}td.n,th.n{text-align:right}td.n,td.tone{white-space:nowrap}
td.tone{color:var(--tone);font-weight:700}td.plain{font-weight:400}
.notes{color:var(--soft);font-size:.9rem}.notes li{max-width:95ch}
.figures{display:grid;grid-template-columns:minmax(0,1fr);gap:16px;margin:1em 0}
figure{margin:0;background:var(--card);border:1px solid var(--line);border-radius:8px;padding:10px}
figure img{width:100%;height:auto;image-rendering:pixelated;display:block}
figcaption{color:var(--soft);font-size:.85rem;margin-top:6px;max-width:80ch}
svg.plot{width:100%;height:auto;font:12px system-ui,"Segoe UI",Roboto,Arial,sans-serif;display:block}
.plot text{fill:var(--text)}.plot .grid{stroke:var(--line)}.plot .axis{stroke:var(--soft);fill:none}
.plot g>text{paint-order:stroke;stroke:var(--card);stroke-width:3px;stroke-linejoin:round}
.plot .mark{fill:var(--ink)}.plot .stroke{stroke:var(--ink);fill:none}.plot .area{fill:var(--ink);opacity:.2}
details{margin:1em 0}summary{cursor:pointer;font-weight:600}code{font-size:.92em}
@media print,(min-width:760px){.figures{grid-template-columns:repeat(2,minmax(0,1fr))}
.figures>figure:last-child:nth-child(odd){grid-column:1/-1;display:grid;align-items:center;
grid-template-columns:3fr 2fr;column-gap:24px}}
@media screen and (min-width:1000px){.figures.three{grid-template-columns:repeat(3,minmax(0,1fr))}
.figures.three>figure:last-child:nth-child(odd){grid-column:auto;display:block}}
@media print,(max-width:1000px){table{font-size:.84rem}th,td{padding:5px 6px}}
@media screen and (max-width:760px){table:not(.stack) td{overflow-wrap:anywhere}
.stack,.stack tbody,.stack td{display:block}.stack thead{display:none}
.stack tr{display:flex;flex-wrap:wrap;gap:0 16px;padding:8px 12px;border-bottom:1px solid var(--line)}
.stack tr:last-child{border-bottom:0}.stack td{border:0;padding:0;text-align:left;white-space:normal}
.stack td::before{content:attr(data-label) " ";color:var(--soft)}.stack td:first-child{flex:1 1 65%;font-weight:600}
.stack td:first-child::before,.stack td.tone::before{content:""}.stack td:empty{display:none}}
@media print{@page{size:A4;margin:14mm}body{background:#fff;font-size:10pt}main{max-width:none;padding:0}
h2,h2+p{break-after:avoid}p{break-inside:avoid}h2{margin-top:1.4em}.verdict,.table,figure,tr,dl.facts{break-inside:avoid}
details::details-content{content-visibility:visible;height:auto}summary{list-style:none}}
)css";

// What a word says of what it stands beside; empty for words that are no outcome.
std::string tone_of(const std::string& word) {
    static const std::map<std::string_view, const char*> tones{
        {"PASS", "good"},           {"met", "good"},
        {"matched", "good"},        {"STABLE", "good"},
        {"used", "good"},           {"FAIL", "bad"},
        {"ERROR", "bad"},           {"NOT MET", "bad"},
        {"DRIFT", "bad"},           {"refused", "bad"},
        {"INCONCLUSIVE", "unsure"}, {"NOT_OBSERVABLE", "unsure"},
        {"SKIPPED", "unsure"},      {"ABORTED", "unsure"},
        {"NOT STABLE", "unsure"},   {"not checked", "unsure"},
        {"no limit", "plain"},      {"not asked for", "plain"},
        {"not matched", "unsure"}};
    const auto found = tones.find(word);
    return found == tones.end() ? "" : found->second;
}

bool is_numeric(std::string_view cell) {
    if (cell.starts_with(below))
        cell.remove_prefix(std::string_view(below).size());
    return cell.empty() || cell == dash || cell == "-" || cell == "unknown" ||
           parse_number(cell).has_value();
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

std::string list_html(const std::vector<std::string>& items, const char* css) {
    std::string text = fmt::format("<ul{}>", css);
    for (const std::string& item : items)
        text += "<li>" + escape_html(item) + "</li>";
    return text + "</ul>\n";
}

std::string cell_html(const std::string& cell, const std::string& label, bool is_number) {
    const std::string tone = tone_of(cell);
    const std::string css = is_number ? "n" : tone.empty() ? "" : "tone " + tone;
    return fmt::format("<td{}{}>{}</td>", css.empty() ? "" : " class=\"" + css + "\"",
                       label.empty() ? "" : " data-label=\"" + escape_html(label) + "\"",
                       escape_html(cell));
}

std::string image_element(const cv::Mat& picture, const std::string& uri, const std::string& alt) {
    return fmt::format(
        "<img loading=\"lazy\" decoding=\"async\" alt=\"{}\" width=\"{}\" height=\"{}\" "
        "src=\"{}\">",
        escape_html(alt), picture.cols, picture.rows, uri);
}

}  // namespace

HtmlPage::HtmlPage(std::string title, std::string subtitle)
    : title_(std::move(title)), subtitle_(std::move(subtitle)) {}

void HtmlPage::add_style(const std::string& css) {
    style_ += css;
}

void HtmlPage::add_verdict(const std::string& outcome, const std::string& sentence,
                           const std::vector<Answer>& answers) {
    body_ += fmt::format(
        "<section class=\"verdict {}\"><div><strong>{}</strong><p>{}</p></div><div "
        "class=\"answers\">",
        tone_of(outcome), escape_html(outcome), escape_html(sentence));
    for (const auto& [question, sentences] : answers)
        if (!sentences.empty())
            body_ +=
                fmt::format("<div><h2>{}</h2>{}</div>", escape_html(question),
                            sentences.size() == 1 ? "<p>" + escape_html(sentences.front()) + "</p>"
                                                  : list_html(sentences, ""));
    body_ += "</div></section>\n";
}

void HtmlPage::add_heading(const std::string& text) {
    body_ += "<h2>" + escape_html(text) + "</h2>\n";
}

void HtmlPage::add_paragraph(const std::string& text) {
    body_ += "<p>" + escape_html(text) + "</p>\n";
}

void HtmlPage::add_notes(const std::vector<std::string>& notes) {
    constexpr std::size_t most = 20;
    if (notes.size() > most)
        begin_details(fmt::format("{} notes", notes.size()));
    if (!notes.empty())
        body_ += list_html(notes, " class=\"notes\"");
    if (notes.size() > most)
        end_details();
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
    constexpr std::size_t most = 100;
    if (rows.size() > most)
        begin_details(fmt::format("{} rows", rows.size()));
    body_ += table_html(header, rows) + "\n";
    if (rows.size() > most)
        end_details();
}

void HtmlPage::add_table(const ResultTable& table) {
    add_table(headings_of(table), texts_of(table));
}

std::string table_html(const std::vector<std::string>& header, const TableRows& rows) {
    const std::vector<bool> numeric = numeric_columns(header.size(), rows);
    const bool is_stacked = header.size() > 3;
    std::string text = fmt::format("<div class=\"table\"><table{}><thead><tr>",
                                   is_stacked ? " class=\"stack\"" : "");
    for (std::size_t i = 0; i < header.size(); ++i)
        text +=
            fmt::format("<th{}>{}</th>", numeric[i] ? " class=\"n\"" : "", escape_html(header[i]));
    text += "</tr></thead><tbody>";
    for (const auto& row : rows) {
        text += "<tr>";
        for (std::size_t i = 0; i < row.size() && i < header.size(); ++i)
            text += cell_html(row[i], is_stacked ? header[i] : "", numeric[i]);
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
    body_ += fmt::format("<div class=\"figures{}\">", figures.size() % 3 == 0 ? " three" : "");
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
    return "data:image/png;base64," + base64(encode_png(picture));
}

std::string embedded_png(const cv::Mat& picture, const std::string& alt) {
    return image_element(picture, png_data_uri(picture), alt);
}

std::string embedded_jpeg(const cv::Mat& picture, int quality, const std::string& alt) {
    return image_element(picture, "data:image/jpeg;base64," + base64(encode_jpeg(picture, quality)),
                         alt);
}

}  // namespace etalon
