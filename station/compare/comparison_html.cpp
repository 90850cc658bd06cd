// The report of a comparison: the figure and what it could not see first, evidence below.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "station/compare/comparison_cards.h"
#include "station/compare/comparison_pictures.h"
#include "station/compare/comparison_report.h"

namespace etalon {
namespace {

std::string verdict_sentence(const Comparison& comparison) {
    const std::size_t compared = comparison.compared(), matched = comparison.matched();
    std::string text = "mean residual over " + counted(compared, "photograph") +
                       ", where the calibration puts the marker. ";
    text += matched == compared ? (compared == 1 ? "It matches its rendering."
                                                 : "All of them match their renderings.")
                                : fmt::format(
                                      "{} of {} match their renderings; what was found on "
                                      "the others stands with them.",
                                      matched, compared);
    if (const std::size_t refused = comparison.photos.size() - compared; refused > 0)
        text += fmt::format(" {} could not be compared.", counted(refused, "more photograph"));
    if (const std::string board = board_in_words(comparison); !board.empty())
        text += " " + board;
    return text;
}

// What was found, each with the photographs that it was found on.
std::vector<std::string> found_by_name(const Comparison& comparison) {
    std::map<std::string, std::vector<std::string>> photos;
    for (const ComparedPhoto& photo : comparison.photos) {
        const std::string name = photo.photo.filename().string();
        if (!photo.has_figures())
            photos["could not be compared"].push_back(name + " (" + photo.reason() + ")");
        for (const Finding& finding : photo.findings)
            if (photo.has_figures())
                photos[finding.name].push_back(name);
    }
    std::vector<std::string> found;
    for (const auto& [what, names] : photos)
        found.push_back(fmt::format("{}: {}", what, fmt::join(names, ", ")));
    return found;
}

void add_summary(HtmlPage& page, const Comparison& comparison) {
    page.add_verdict(fmt::format("{:.1f} gray", comparison.mean_rms_gray()),
                     verdict_sentence(comparison),
                     {{"Found", found_by_name(comparison)},
                      {"Not seen by this comparison", blind_spots(comparison)}});
    Facts facts = {{"photographs that match",
                    fmt::format("{} of {}", comparison.matched(), comparison.photos.size())}};
    if (const auto refined = comparison.refined_mean_rms_gray())
        facts.emplace_back("at the refined poses", fmt::format("{:.1f} gray", *refined));
    if (const auto edges = comparison.edge_summaries())
        facts.emplace_back("edge shift, refined",
                           fmt::format("{:.3f} → {:.3f} px", edges->first.shift.rms_px,
                                       edges->second.shift.rms_px));
    if (!comparison.camera.lens)
        facts.emplace_back("fitted blur σ, mean",
                           fmt::format("{:.2f} px", comparison.mean_psf_sigma_px()));
    facts.emplace_back("poses under test", source_of_poses(comparison));
    page.add_facts(facts);
}

void add_method(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Method");
    page.add_paragraph(
        "Each photograph is set against a rendering of the marker, made from the calibration "
        "alone. "
        "Black and white level, each a surface of second order over the image" +
        std::string(comparison.camera.lens ? ", " : ", the widths of a Gaussian blur, ") +
        "and, where the white comes near full scale, its saturation are fitted to the photograph "
        "on "
        "one half of the cells (blocks of 2 × 2 take turns); every figure here is of the other "
        "half. Scored: " +
        scored_region(comparison) +
        ". The residual is the RMS of photograph minus rendering in gray = code value / full scale "
        "× 255.");
    page.add_paragraph(
        "Twice: at the pose under test (" + source_of_poses(comparison) +
        "), and at the refined pose, where the rendering's pose is fitted to the pixels too. What "
        "the second removes was the pose's; what it leaves is the camera's, the lens's, the "
        "print's "
        "and the file's.");
    page.add_paragraph("From the calibration, not fitted: intrinsics, distortion" +
                       std::string(comparison.camera.lens ? ", defocus and diffraction" : "") +
                       std::string(comparison.camera.sensor ? ", transfer curve, shading" : "") +
                       ".");
}

std::string edge_shift(const std::optional<ComparedFit>& fit) {
    return fit && fit->edge_summary.edges > 0 ? fixed(fit->edge_summary.shift.rms_px, 3) : dash;
}

std::vector<std::string> table_row(const ComparedPhoto& photo) {
    std::vector<std::string> row = {photo.photo.filename().string(), photo.outcome()};
    if (!photo.calibrated) {
        row.insert(row.end(), 7, dash);
        return row;
    }
    const ComparedFit& fit = *photo.calibrated;
    row.push_back(fixed(fit.scored.rms_gray, 2));
    row.push_back(photo.refined ? fixed(photo.refined->scored.rms_gray, 2) : dash);
    row.push_back(edge_shift(photo.calibrated));
    row.push_back(edge_shift(photo.refined));
    row.push_back(fixed(fit.model.psf_sigma_px, 2));
    const auto change = pose_change_of(photo);
    row.push_back(change ? fixed(change->translation_mm, 3) : dash);
    row.push_back(change ? fixed(change->rotation_mrad, 2) : dash);
    std::vector<std::string> names;
    for (const Finding& finding : photo.findings)
        names.push_back(finding.name);
    row.push_back(fmt::format("{}", fmt::join(names, ", ")));
    return row;
}

void add_photo_table(HtmlPage& page, const Comparison& comparison) {
    TableRows rows;
    for (const ComparedPhoto& photo : comparison.photos)
        rows.push_back(table_row(photo));
    page.add_table({"photograph", "outcome", "residual gray", "refined", "edge shift px", "refined",
                    "blur σ px", "pose mm", "pose mrad", "findings"},
                   rows);
}

void add_baseline(HtmlPage& page, const BaselineChange& change) {
    page.add_heading("Change since the baseline");
    std::string text = fmt::format(
        "Against {}: {} paired by name. Differences are now minus then; the intervals of all "
        "quantities hold together at {:.0f} % (Student's t, paired, Bonferroni).",
        change.folder.string(), counted(change.pairs.size(), "photograph"),
        100.0 * baseline_confidence);
    if (!change.serials_known)
        text += " Whether it was the same camera is not known: a serial number is missing.";
    page.add_paragraph(text);
    const auto add_names = [&](const char* what, const std::vector<std::string>& names) {
        if (!names.empty())
            page.add_paragraph(fmt::format("{}{}.", what, fmt::join(names, ", ")));
    };
    add_names("Only in this comparison: ", change.only_now);
    add_names("Only in the baseline: ", change.only_earlier);
    add_names("Not paired, because a name occurs twice: ", change.ambiguous);
    TableRows rows;
    for (const PairedChange& quantity : change.quantities)
        rows.push_back({quantity.quantity,
                        quantity.changed()    ? "changed"
                        : quantity.half_width ? "not significant"
                                              : "one pair says nothing",
                        std::to_string(quantity.pairs), fixed(quantity.earlier, 4),
                        fixed(quantity.now, 4), fmt::format("{:+.4f}", quantity.mean),
                        fixed(quantity.half_width, 4), quantity.unit});
    page.add_table({"quantity", "outcome", "pairs", "then", "now", "change", "±", "unit"}, rows);
}

void add_plots(HtmlPage& page, const std::vector<ComparisonPlot>& plots) {
    page.add_heading("Where the residual is");
    HtmlPage::Figures figures;
    for (const ComparisonPlot& plot : plots)
        figures.push_back({plot.svg, plot.caption});
    page.add_figures(figures);
}

// The viewer of the photograph with the largest residual starts moving.
std::size_t worst_photo(const Comparison& comparison) {
    std::size_t worst = comparison.photos.size();
    double largest = -1.0;
    for (std::size_t i = 0; i < comparison.photos.size(); ++i) {
        const ComparedPhoto& photo = comparison.photos[i];
        if (photo.calibrated && photo.calibrated->scored.rms_gray > largest) {
            largest = photo.calibrated->scored.rms_gray;
            worst = i;
        }
    }
    return worst;
}

void add_cards(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Photograph by photograph");
    const std::size_t worst = worst_photo(comparison);
    for (std::size_t i = 0; i < comparison.photos.size(); ++i)
        page.add_html(card_html(comparison, i + 1, i == worst));
}

std::string projection_text(const LensProjection& projection) {
    std::string text = name_of(projection.kind).name;
    for (const auto& [name, value] : named_parameters(projection))
        text += fmt::format(", {} {:.6g}", name, value);
    return text;
}

void add_provenance(HtmlPage& page, const Comparison& comparison) {
    const CameraModel& camera = comparison.camera;
    const Intrinsics& k = camera.intrinsics;
    std::string coefficients;
    for (const double value : camera.distortion.coefficients())
        coefficients += fmt::format("{}{:.6g}", coefficients.empty() ? "" : ", ", value);
    page.begin_details("Camera and software");
    page.add_table({"calibration", comparison.camera_file.string()},
                   {{"serial number", camera.serial.empty() ? "not known" : camera.serial},
                    {"image", fmt::format("{} x {} px", camera.width, camera.height)},
                    {"fx, fy", fmt::format("{:.3f}, {:.3f} px", k.fx, k.fy)},
                    {"cx, cy", fmt::format("{:.3f}, {:.3f} px", k.cx, k.cy)},
                    {"skew", fmt::format("{:.6g} px", k.skew)},
                    {"projection", projection_text(camera.projection)},
                    {"k1 k2 p1 p2 k3 k4 k5 k6 s1..s4 tau_x tau_y k7", coefficients},
                    {"rendering", comparison.render_plan}});
    page.add_software(software_versions());
    page.end_details();
}

}  // namespace

std::string comparison_html(const Comparison& comparison,
                            const std::vector<ComparisonPlot>& plots) {
    HtmlPage page(
        "Photographs against their renderings",
        fmt::format("{}, {}", comparison.camera_file.filename().string(), comparison.marker));
    page.add_style(comparison_style);
    add_summary(page, comparison);
    page.add_heading("Photographs");
    page.add_html(contact_sheet_html(comparison));
    add_photo_table(page, comparison);
    if (comparison.baseline)
        add_baseline(page, *comparison.baseline);
    add_plots(page, plots);
    add_cards(page, comparison);
    add_method(page, comparison);
    add_provenance(page, comparison);
    return page.finish();
}

}  // namespace etalon
