#include "station/compare/comparison_cards.h"

#include <fmt/format.h>

#include <cmath>

#include "core/file/text.h"
#include "report/html.h"
#include "report/number_text.h"
#include "station/compare/comparison_pictures.h"
#include "station/compare/edge_plots.h"

namespace etalon {
namespace {

// A picture that fills the card's width when it is chosen.
std::string zoomable(const std::string& content) {
    return "<label class=\"zoom\"><input type=\"checkbox\" aria-label=\"large\">" + content +
           "</label>";
}

std::string outcome_tag(const ComparedPhoto& photo) {
    const char* css = !photo.has_figures() ? " no" : is_matched(photo.findings) ? " ok" : "";
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
    std::string text = fmt::format("Residual {:.2f} gray", fit.scored.rms_gray);
    if (photo.refined)
        text += fmt::format(" → {:.2f} at the refined pose", photo.refined->scored.rms_gray);
    text += fmt::format("; 99 % within {:.0f} gray.", fit.scored.p99_gray);
    if (const auto change = pose_change_of(photo))
        text += fmt::format(" Pose change {:.2g} mm (σ {:.1g}), {:.2g} mrad (σ {:.1g}).",
                            change->translation_mm, change->translation_deviation_mm,
                            change->rotation_mrad, change->rotation_deviation_mrad);
    return "<p>" + text + "</p>";
}

// The residual along edges, taken apart; squares add up, a minus is a part that cancels others.
std::string edges_line(const ComparedPhoto& photo) {
    if (!photo.refined || photo.refined->edge_summary.edges == 0)
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
    const std::vector<MatchParameter>& parameters = photo.calibrated->parameters;
    if (parameters.empty())
        return "";
    TableRows rows;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const MatchParameter& one = parameters[i];
        const MatchParameter* refined = photo.refined && i < photo.refined->parameters.size()
                                            ? &photo.refined->parameters[i]
                                            : nullptr;
        rows.push_back({one.name, significant(one.value, 4), significant(one.deviation, 2),
                        refined ? significant(refined->value, 4) : dash,
                        refined ? significant(refined->deviation, 2) : dash, one.unit,
                        one.source});
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
    std::vector<NamedPicture> shown = {{"photograph", pictures.photo},
                                       {"rendering", pictures.rendering}};
    if (!pictures.refined_rendering.empty())
        shown.push_back({"refined pose", pictures.refined_rendering});
    std::string text =
        "<div class=\"pictures\"><figure class=\"wide\">" +
        viewer_html(fmt::format("view-{}", number), shown, starts_in_turn) +
        "<figcaption>In turn: what moves or changes is the difference. Press to hold "
        "the photograph. Pale in the rendering: the photograph, where nothing is rendered."
        "</figcaption></figure>";
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
    if (!pictures.refined_residual.empty())
        text +=
            figure_html(zoomable(pictures.refined_residual),
                        scale + "Residual at the refined pose. What is left is not the pose's.");
    if (photo.refined && !photo.refined->edges.empty())
        text +=
            figure_html(zoomable(edge_map_svg(photo.refined->edges, pictures.part, magnification)),
                        fmt::format("Edge shifts at the refined pose × {:.0f}; red: over 3 σ. "
                                    "Neighbours that agree are distortion or the print.",
                                    magnification));
    if (photo.calibrated)
        text +=
            figure_html(zoomable(pictures.significance),
                        significance_caption(photo.refined ? *photo.refined : *photo.calibrated));
    return text + "</div>";
}

}  // namespace

std::optional<PoseChange> pose_change_of(const ComparedPhoto& photo) {
    if (!photo.calibrated || !photo.refined || !photo.photometric)
        return std::nullopt;
    const Vector6d change =
        left_difference(photo.calibrated->camera_from_marker, photo.refined->camera_from_marker);
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

std::string card_html(const Comparison& comparison, std::size_t number, bool starts_in_turn) {
    const ComparedPhoto& photo = comparison.photos[number - 1];
    std::string text =
        fmt::format("<article class=\"photo\" id=\"photo-{}\"><h3>{} {}</h3>", number,
                    escape_html(photo.photo.filename().string()), outcome_tag(photo));
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
                            photo.pictures.thumbnail, escape_html(photo.photo.filename().string()),
                            figure, outcome_tag(photo));
    }
    return text + "</div>\n";
}

}  // namespace etalon
