#include "report/html.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <map>

#include "core/file/text.h"
#include "core/image/picture_codec.h"
#include "report/number_text.h"
#include "report/page.css.h"

namespace etalon {
namespace {

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
    std::vector<unsigned char> text(4 * ((bytes.size() + 2) / 3) + 1);
    const int length = EVP_EncodeBlock(text.data(), bytes.data(), static_cast<int>(bytes.size()));
    return {text.begin(), text.begin() + length};
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
        escape_html(title_), page_css, style_, escape_html(title_), escape_html(subtitle_), body_);
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
