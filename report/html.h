// The building blocks of reports: one self-contained HTML page that opens offline, prints, follows
// the reader's dark mode and fits a phone as well as a wide screen.
#pragma once

#include <opencv2/core.hpp>

#include "report/result_table.h"
#include "report/software_versions.h"

namespace etalon {

using TableRows = std::vector<std::vector<std::string>>;
using Facts = std::vector<std::pair<std::string, std::string>>;  // (label, value)

// Text in: everything that is not named `html` is escaped.
class HtmlPage {
public:
    HtmlPage(std::string title, std::string subtitle);

    // Rules of one report only, after those of every page.
    void add_style(const std::string& css);

    // What a reader asks behind the verdict, and the answer; several sentences make a list.
    struct Answer {
        std::string question;
        std::vector<std::string> sentences;  // none: left out
    };
    // The large banner on top: an outcome (PASS, FAIL, ... in its colour) or the page's figure.
    void add_verdict(const std::string& outcome, const std::string& sentence,
                     const std::vector<Answer>& answers = {});

    void add_heading(const std::string& text);
    void add_paragraph(const std::string& text);
    // A list in small letters, for what does not fit into a table; nothing without notes.
    void add_notes(const std::vector<std::string>& notes);
    void add_html(std::string html);

    // Short facts side by side.
    void add_facts(const Facts& facts);

    // Columns that hold only numbers are aligned right, outcomes have their colour. On a narrow
    // screen each row of more than three columns becomes a paragraph: nothing is scrolled away, and
    // an outcome in the second column stays beside the name. Cells are text. A table of more than
    // 100 rows is folded away until the reader opens it, as are more than 20 notes.
    void add_table(const std::vector<std::string>& header, const TableRows& rows);
    void add_table(const ResultTable& table);
    // The versions of what made the page or its record.
    void add_software(const std::vector<SoftwareVersion>& software);

    // <svg> or <img> elements in full rows: three, two or one beside each other.
    struct Figure {
        std::string html;
        std::string caption;  // also what to look at
    };
    using Figures = std::vector<Figure>;
    void add_figures(const Figures& figures);

    // The part that is folded away until the reader opens it.
    void begin_details(const std::string& summary);
    void end_details();

    std::string finish() const;

private:
    std::string title_, subtitle_, style_, body_;
};

// What add_table() and add_figures() add, for pages that put it into elements of their own.
std::string table_html(const std::vector<std::string>& header, const TableRows& rows);
std::string figure_html(const std::string& html, const std::string& caption_html);

// An <img> with the picture inside, as PNG or as JPEG of this quality; `alt` says what is seen.
// Decoded when it comes into view, shown without smoothing when it is enlarged.
std::string embedded_png(const cv::Mat& picture, const std::string& alt);
std::string embedded_jpeg(const cv::Mat& picture, int quality, const std::string& alt);

// The picture as "data:image/png;base64,...", for the <image> of an <svg>.
std::string png_data_uri(const cv::Mat& picture);

}  // namespace etalon
