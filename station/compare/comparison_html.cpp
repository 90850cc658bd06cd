// The report of a comparison: the figure and what it could not see first, evidence below.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "station/compare/comparison.css.h"
#include "station/compare/comparison.h"

namespace etalon {
namespace {

// From the pose under test to the photometric pose, with the latter's deviation in this direction.
struct PoseChange {
    double translation_mm = 0.0, translation_deviation_mm = 0.0;
    double rotation_mrad = 0.0, rotation_deviation_mrad = 0.0;
};

std::optional<PoseChange> pose_change_of(const ComparedPhoto& photo) {
    if (!photo.calibrated)
        return std::nullopt;
    const Vector6d change = left_difference(photo.calibrated->camera_from_marker(),
                                            photo.refined->camera_from_marker());
    const Matrix6d& covariance = photo.photometric->covariance;
    const auto deviation = [](const Eigen::Vector3d& along, const Eigen::Matrix3d& of) {
        const double length = along.norm();
        const Eigen::Vector3d unit =
            length > 0.0 ? Eigen::Vector3d(along / length) : Eigen::Vector3d::UnitZ();
        return std::sqrt(unit.dot(of * unit));
    };
    const Eigen::Vector3d rotation = change.head<3>(), translation = change.tail<3>();
    return PoseChange{
        translation.norm(), deviation(translation, covariance.bottomRightCorner<3, 3>()),
        1e3 * rotation.norm(), 1e3 * deviation(rotation, covariance.topLeftCorner<3, 3>())};
}

// One place for several pictures of the same size: side by side, in turn, or one of them, by radio
// buttons; pressing holds the first one. Nothing moves for readers who want less motion, and no
// script is needed. `id` is unique in the page; pictures are names and <img> elements.
std::string viewer_html(const std::string& id,
                        const std::vector<std::pair<std::string, std::string>>& pictures,
                        bool starts_in_turn) {
    std::string text = "<fieldset class=\"viewer\">";
    const auto choice = [&](const std::string& key, const std::string& css,
                            const std::string& label, bool is_checked) {
        text += fmt::format(
            "<input type=\"radio\" name=\"{0}\" id=\"{0}-{1}\" class=\"{2}\"{3}><label "
            "for=\"{0}-{1}\">{4}</label>",
            id, key, css, is_checked ? " checked" : "", escape_html(label));
    };
    choice("both", "both", "side by side", !starts_in_turn);
    choice("turn", "one turn", "in turn", starts_in_turn);
    for (std::size_t i = 0; i < pictures.size(); ++i)
        choice(std::to_string(i + 1), fmt::format("one m{}", i + 1), pictures[i].first, false);
    text += "<div class=\"stage\">";
    for (const auto& [name, html] : pictures)
        text += fmt::format("<div>{}<span>{}</span></div>", html, escape_html(name));
    return text + "</div></fieldset>";
}

// The colours of residual and significance maps with their ends, "-30" and "+30 gray".
std::string colour_scale_html(double end, const std::string& unit) {
    return fmt::format("<div class=\"scale\">−{0:.0f}<i></i>+{0:.0f} {1}</div>", end,
                       escape_html(unit));
}

// A picture that fills the card's width when it is chosen.
std::string zoomable(const std::string& content) {
    return "<label class=\"zoom\"><input type=\"checkbox\" aria-label=\"large\">" + content +
           "</label>";
}

std::string outcome_tag(const ComparedPhoto& photo) {
    const char* css = !photo.has_figures() ? " no" : photo.is_matched() ? " ok" : "";
    return fmt::format("<span class=\"tag{}\">{}</span>", css, photo.outcome());
}

std::string findings_html(const ComparedPhoto& photo) {
    if (photo.failure.empty() && photo.findings.empty())
        return "";
    std::string text = "<ul class=\"findings\">";
    if (!photo.failure.empty())
        text += "<li>" + escape_html(photo.failure) + "</li>";
    for (const Finding& finding : photo.findings)
        text +=
            fmt::format("<li><strong>{}</strong>: {} <small>({:.3g}{}, limit {:.3g})</small></li>",
                        escape_html(finding.name), escape_html(finding.sentence), finding.value,
                        escape_html(finding.unit.empty() ? "" : " " + finding.unit), finding.limit);
    return text + "</ul>";
}

std::string figures_line(const ComparedPhoto& photo) {
    const ComparedFit& fit = *photo.calibrated;
    const PoseChange change = *pose_change_of(photo);
    return fmt::format(
        "<p>Residual {:.2f} gray → {:.2f} at the refined pose; 99 % within {:.0f} gray. Pose "
        "change {:.2g} mm (σ {:.1g}), {:.2g} mrad (σ {:.1g}).</p>",
        fit.scored.rms_gray, photo.refined->scored.rms_gray, fit.scored.p99_gray,
        change.translation_mm, change.translation_deviation_mm, change.rotation_mrad,
        change.rotation_deviation_mrad);
}

// The residual along edges, taken apart; squares add up, a minus is a part that cancels others.
std::string edges_line(const ComparedPhoto& photo) {
    if (photo.refined->edge_summary.edges == 0)
        return "";
    const EdgeSummary &before = photo.calibrated->edge_summary,
                      &after = photo.refined->edge_summary;
    const EdgeParts& parts = after.parts;
    return fmt::format(
        "<p>Edge shift {:.3f} px (σ {:.1g}) → {:.3f} px (σ {:.1g}) at the refined pose, {} edges. "
        "Along them {:.1f} gray: shift {:.1f}, blur {:.1f}, photometric {:.1f}, rest {:.1f}.</p>",
        before.shift.rms_px, before.shift.rms_deviation_px, after.shift.rms_px,
        after.shift.rms_deviation_px, after.edges, parts.residual_gray, parts.shift_gray,
        parts.blur_gray, parts.photometric_gray, parts.rest_gray);
}

std::string minimum_in_words(const WidthMinimum& minimum) {
    return minimum.is_determined
               ? fmt::format("sharpest at {:.2f} mm (σ {:.2f})", minimum.focus_distance_mm,
                             minimum.standard_uncertainty_mm)
               : "without a sharpest depth: " + minimum.undetermined;
}

std::string defocus_line(const ComparedPhoto& photo) {
    if (!photo.defocus)
        return "";
    return fmt::format("<p>Photograph {}; rendering {}.</p>",
                       escape_html(minimum_in_words(photo.defocus->photo)),
                       escape_html(minimum_in_words(photo.defocus->rendering)));
}

std::string parameters_html(const ComparedPhoto& photo) {
    TableRows rows;
    for (std::size_t i = 0; i < photo.calibrated->parameters.size(); ++i) {
        const MatchParameter& here = photo.calibrated->parameters[i];
        const MatchParameter& refined = photo.refined->parameters.at(i);
        rows.push_back({here.name, significant(here.value, 4), significant(here.deviation, 2),
                        significant(refined.value, 4), significant(refined.deviation, 2), here.unit,
                        here.source});
    }
    return "<details><summary>Photometric parameters</summary>" +
           table_html({"parameter", "pose under test", "σ", "refined pose", "σ", "unit", "from"},
                      rows) +
           "</details>";
}

std::string significance_caption(const ComparedFit& fit) {
    const std::string scale = colour_scale_html(significance_map_scale, "σ");
    if (fit.noise_source == NoiseSource::camera)
        return scale + fmt::format(
                           "Significance: residual over the camera's noise (RMS {:.2f} "
                           "gray){}. Noise alone looks even.",
                           fit.noise_gray,
                           fit.scored.significant ? fmt::format("; {:.1f} % of the pixels over 3 σ",
                                                                100.0 * *fit.scored.significant)
                                                  : "");
    return scale + fmt::format(
                       "Significance against this photograph's own scatter, {:.2f} gray: "
                       "the camera's noise is not known. Noise alone looks even.",
                       fit.noise_gray);
}

std::string pictures_html(const ComparedPhoto& photo, std::size_t number, bool starts_in_turn,
                          double magnification) {
    const PhotoPictures& pictures = photo.pictures;
    std::string text = "<div class=\"pictures\"><figure class=\"wide\">" +
                       viewer_html(fmt::format("view-{}", number),
                                   {{"photograph", pictures.photo},
                                    {"rendering", pictures.rendering},
                                    {"refined pose", pictures.refined_rendering}},
                                   starts_in_turn) +
                       "<figcaption>In turn: what moves or changes is the difference. Press to "
                       "hold the photograph. Pale in the rendering: the photograph, where nothing "
                       "is rendered.</figcaption></figure>";
    text += figure_html(zoomable(pictures.overlay),
                        fmt::format("Red: the photograph is brighter, cyan: the rendering is; "
                                    "differences × {:.0f}. A coloured rim is an edge out of "
                                    "place.",
                                    overlay_gain));
    const std::string scale = colour_scale_html(residual_map_scale_gray, "gray");
    text += figure_html(zoomable(pictures.residual),
                        scale +
                            "Residual at the pose under test. Stripes along edges are pose or "
                            "blur, patches are light.");
    text += figure_html(zoomable(pictures.refined_residual),
                        scale + "Residual at the refined pose. What is left is not the pose's.");
    if (photo.refined && !photo.refined->edges.empty())
        text += figure_html(zoomable(edge_map_svg(photo, magnification)),
                            fmt::format("Edge shifts at the refined pose × {:.0f}; red: over 3 σ. "
                                        "Neighbours that agree are distortion or the print.",
                                        magnification));
    if (photo.refined)
        text += figure_html(zoomable(pictures.significance), significance_caption(*photo.refined));
    return text + "</div>";
}

// One photograph, numbered from 1: findings, photograph and rendering in one place, maps, fitted
// parameters. With `starts_in_turn` its viewer starts moving.
std::string card_html(const Comparison& comparison, std::size_t number, bool starts_in_turn) {
    const ComparedPhoto& photo = comparison.photos[number - 1];
    std::string text = fmt::format("<article class=\"photo\" id=\"photo-{}\"><h3>{} {}</h3>",
                                   number, escape_html(photo.name()), outcome_tag(photo));
    text += findings_html(photo);
    if (photo.calibrated)
        text += figures_line(photo) + edges_line(photo) + defocus_line(photo);
    if (!photo.pictures.overlay.empty())
        text += pictures_html(photo, number, starts_in_turn, arrow_magnification(comparison));
    else if (!photo.pictures.photo.empty())
        text += "<div class=\"pictures\">" +
                figure_html(zoomable(photo.pictures.photo), "The photograph as it is.") + "</div>";
    if (photo.calibrated)
        text += parameters_html(photo);
    return text + "</article>\n";
}

std::string contact_sheet_html(const Comparison& comparison) {
    std::string text = "<div class=\"sheet\">";
    for (std::size_t i = 0; i < comparison.photos.size(); ++i) {
        const ComparedPhoto& photo = comparison.photos[i];
        if (photo.pictures.thumbnail.empty())
            continue;
        const std::string figure =
            photo.calibrated ? fmt::format("{:.1f} gray ", photo.calibrated->scored.rms_gray) : "";
        text += fmt::format("<a href=\"#photo-{}\">{}<p>{}<br>{}{}</p></a>", i + 1,
                            photo.pictures.thumbnail, escape_html(photo.name()), figure,
                            outcome_tag(photo));
    }
    return text + "</div>\n";
}

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
    if (const std::string board = comparison.board_in_words(); !board.empty())
        text += " " + board;
    return text;
}

std::vector<std::string> found_by_name(const Comparison& comparison) {
    std::map<std::string, std::vector<std::string>> photos;
    for (const ComparedPhoto& photo : comparison.photos) {
        const std::string name = photo.name();
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
                      {"Not seen by this comparison", comparison.blind_spots()}});
    Facts facts = {
        {"photographs that match",
         fmt::format("{} of {}", comparison.matched(), comparison.photos.size())},
        {"at the refined poses", fmt::format("{:.1f} gray", comparison.refined_mean_rms_gray())}};
    if (const auto edges = comparison.edge_summaries())
        facts.emplace_back("edge shift, refined",
                           fmt::format("{:.3f} → {:.3f} px", edges->first.shift.rms_px,
                                       edges->second.shift.rms_px));
    if (!comparison.camera.lens)
        facts.emplace_back("fitted blur σ, mean",
                           fmt::format("{:.2f} px", comparison.mean_psf_sigma_px()));
    facts.emplace_back("poses under test", comparison.source_of_poses());
    page.add_facts(facts);
}

void add_method(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Method");
    const std::string scored =
        comparison.marker.kind == Marker::Kind::chessboard
            ? fmt::format("the inner corners and {} squares around them in x, {} in y",
                          comparison.margin.x, comparison.margin.y)
            : "the whole marker with its white border";
    page.add_paragraph(
        "Each photograph is set against a rendering of the marker, made from the calibration "
        "alone. Black and white level, each a surface of second order over the image" +
        std::string(comparison.camera.lens ? ", " : ", the widths of a Gaussian blur, ") +
        "and, where the white comes near full scale, its saturation are fitted to the photograph "
        "on one half of the cells (blocks of 2 × 2 take turns); every figure here is of the other "
        "half. Scored: " +
        scored +
        ". The residual is the RMS of photograph minus rendering in gray = code value / full scale "
        "× 255.");
    page.add_paragraph("Twice: at the pose under test (" + comparison.source_of_poses() +
                       "), and at the refined pose, where the rendering's pose is fitted to the "
                       "pixels too. What the second removes was the pose's; what it leaves is the "
                       "camera's, the lens's, the print's and the file's.");
    page.add_paragraph("From the calibration, not fitted: intrinsics, distortion" +
                       std::string(comparison.camera.lens ? ", defocus and diffraction" : "") +
                       std::string(comparison.camera.sensor ? ", transfer curve, shading" : "") +
                       ".");
}

void add_photo_table(HtmlPage& page, const std::vector<ComparedPhoto>& photos) {
    const auto edge_shift = [](const ComparedFit& fit) {
        return fit.edges_if_any() ? fixed(fit.edge_summary.shift.rms_px, 3) : dash;
    };
    TableRows rows;
    for (const ComparedPhoto& photo : photos) {
        auto& row = rows.emplace_back(10, dash);
        row[0] = photo.name();
        row[1] = photo.outcome();
        if (!photo.calibrated) {
            row.pop_back();
            continue;
        }
        const ComparedFit &fit = *photo.calibrated, &refined = *photo.refined;
        const PoseChange change = *pose_change_of(photo);
        row = {row[0],
               row[1],
               fixed(fit.scored.rms_gray, 2),
               fixed(refined.scored.rms_gray, 2),
               edge_shift(fit),
               edge_shift(refined),
               fixed(fit.psf_sigma_px(), 2),
               fixed(change.translation_mm, 3),
               fixed(change.rotation_mrad, 2),
               fmt::format("{}", fmt::join(photo.names_of_findings(), ", "))};
    }
    page.add_table({"photograph", "outcome", "residual / gray", "refined", "edge shift / px",
                    "refined", "blur σ / px", "pose / mm", "pose / mrad", "findings"},
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
    page.add_table(change_table(change));
}

// The viewer of the photograph with the largest residual starts moving.
void add_cards(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Photograph by photograph");
    const auto residual = [](const ComparedPhoto& photo) {
        return photo.calibrated ? photo.calibrated->scored.rms_gray : -1.0;
    };
    const auto worst = std::ranges::max_element(comparison.photos, {}, residual);
    for (std::size_t i = 0; i < comparison.photos.size(); ++i)
        page.add_html(card_html(comparison, i + 1, &comparison.photos[i] == &*worst));
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
        fmt::format("{}, {}", comparison.camera_file.filename().string(), comparison.marker.spec));
    page.add_style(comparison_css);
    add_summary(page, comparison);
    page.add_heading("Photographs");
    page.add_html(contact_sheet_html(comparison));
    add_photo_table(page, comparison.photos);
    if (comparison.baseline)
        add_baseline(page, *comparison.baseline);
    page.add_heading("Where the residual is");
    HtmlPage::Figures figures;
    for (const ComparisonPlot& plot : plots)
        figures.push_back({plot.svg, plot.caption});
    page.add_figures(figures);
    add_cards(page, comparison);
    add_method(page, comparison);
    add_provenance(page, comparison);
    return page.finish();
}

}  // namespace etalon
