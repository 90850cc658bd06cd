// The tables of a comparison, numbers unrounded. Cells without a figure are empty.
#include <fmt/format.h>

#include <cmath>

#include "core/file/text.h"
#include "report/csv.h"
#include "station/compare/comparison_report.h"

namespace etalon {
namespace {

std::string joined_names(const Findings& findings) {
    std::string text;
    for (const Finding& finding : findings)
        text += (text.empty() ? "" : " ") + finding.name;
    return text;
}

// A cell of what `take` gives of `from`; empty where that is missing.
template <class Type, class Function>
void add_figure(const std::string& column, const Type* from, Function take, CsvTable& table) {
    table.number(column, from ? std::optional<double>(take(*from)) : std::nullopt);
}

void add_fit(const std::string& prefix, const std::optional<ComparedFit>& fit, CsvTable& table) {
    table.pose(prefix, fit ? std::optional(fit->camera_from_marker) : std::nullopt);
    const auto number = [&](const char* column, auto take) {
        add_figure(prefix + column, fit ? &*fit : nullptr, take, table);
    };
    number("rms_gray", [](const ComparedFit& f) { return f.scored.rms_gray; });
    number("mean_gray", [](const ComparedFit& f) { return f.scored.mean_gray; });
    number("p99_gray", [](const ComparedFit& f) { return f.scored.p99_gray; });
    number("worst_gray", [](const ComparedFit& f) { return f.scored.worst_gray; });
    number("scored_pixels", [](const ComparedFit& f) { return f.scored.pixels; });
    number("fitted_rms_gray", [](const ComparedFit& f) { return f.fitted.rms_gray; });
    table.number(prefix + "significant", fit ? fit->scored.significant : std::nullopt);
    number("psf_sigma_px", [](const ComparedFit& f) { return f.model.psf_sigma_px; });
}

// Figures of edges, of the scored half; nothing where there are no edges.
void add_edge_summary(const std::string& prefix, const std::optional<ComparedFit>& fit,
                      CsvTable& table) {
    const EdgeSummary* summary = fit && fit->edge_summary.edges > 0 ? &fit->edge_summary : nullptr;
    const auto number = [&](const char* column, auto take) {
        add_figure(prefix + column, summary, take, table);
    };
    number("edges", [](const EdgeSummary& s) { return s.edges; });
    number("edges_beyond_range", [](const EdgeSummary& s) { return s.beyond_range; });
    number("edge_shift_rms_px", [](const EdgeSummary& s) { return s.shift.rms_px; });
    number("edge_shift_rms_deviation_px",
           [](const EdgeSummary& s) { return s.shift.rms_deviation_px; });
    number("edge_shift_mean_px", [](const EdgeSummary& s) { return s.mean_shift_px; });
    number("edge_blur_px2", [](const EdgeSummary& s) { return s.mean_blur_px2; });
    number("band_residual_gray", [](const EdgeSummary& s) { return s.parts.residual_gray; });
    number("band_shift_gray", [](const EdgeSummary& s) { return s.parts.shift_gray; });
    number("band_blur_gray", [](const EdgeSummary& s) { return s.parts.blur_gray; });
    number("band_photometric_gray", [](const EdgeSummary& s) { return s.parts.photometric_gray; });
    number("band_rest_gray", [](const EdgeSummary& s) { return s.parts.rest_gray; });
}

void add_edge(const EdgeShift& edge, CsvTable& table) {
    table.number("x_px", edge.middle_px.x());
    table.number("y_px", edge.middle_px.y());
    table.number("normal_x", edge.normal.x());
    table.number("normal_y", edge.normal.y());
    table.number("length_px", edge.length_px);
    table.number("depth_mm", edge.depth_mm);
    table.number("radius_px", edge.radius_px);
    table.text("half", edge.use == pixel_scored ? "scored" : "fitted");
    table.number("pixels", edge.pixels);
    table.text("beyond_range", edge.is_beyond_range ? "yes" : "no");
    table.number("shift_px", edge.shift_px);
    table.number("shift_deviation_px", edge.shift_deviation_px);
    table.number("blur_variance_px2", edge.blur_variance_px2);
    table.number("blur_deviation_px2", edge.blur_deviation_px2);
    table.number("black_gray", edge.black_gray);
    table.number("black_deviation_gray", edge.black_deviation_gray);
    table.number("white_gray", edge.white_gray);
    table.number("white_deviation_gray", edge.white_deviation_gray);
    table.number("step_gray", edge.step_gray);
    table.number("rendered_variance_px2", edge.rendered_variance_px2);
    table.number("reduced_chi_square", edge.reduced_chi_square);
}

void add_pose_deviations(const ComparedPhoto& photo, CsvTable& table) {
    constexpr const char* components[] = {"rx", "ry", "rz", "tx", "ty", "tz"};
    for (int i = 0; i < 6; ++i)
        table.number(std::string("refined_deviation_") + components[i],
                     photo.photometric
                         ? std::optional(std::sqrt(photo.photometric->covariance(i, i)))
                         : std::nullopt);
}

void add_profile(const std::string& what, const std::string& pose, const ResidualProfile& profile,
                 CsvTable& table) {
    for (std::size_t i = 0; i < profile.pixels.size(); ++i) {
        const auto rms = profile.rms(i);
        if (!rms)
            continue;
        table.text("against", what);
        table.text("pose", pose);
        table.number("middle", profile.middle(i));
        table.number("rms_gray", rms);
        table.number("pixels", profile.pixels[i]);
        table.end_row();
    }
}

void add_parameter(const MatchParameter& parameter, CsvTable& table) {
    table.text("parameter", parameter.name);
    table.number("value", parameter.value);
    table.number("deviation", parameter.deviation);
    table.text("unit", parameter.unit);
    table.text("source", parameter.source);
}

// A row for each of these items of each fit: photograph and pose, then what `add` adds.
template <class Item>
std::string rows_of_fits(const Comparison& comparison, std::vector<Item> ComparedFit::*items,
                         void (*add)(const Item&, CsvTable&)) {
    CsvTable table;
    for (const ComparedPhoto& photo : comparison.photos)
        for (const auto& [pose, fit] :
             {std::pair("calibrated", &photo.calibrated), std::pair("refined", &photo.refined)})
            for (const Item& item : *fit ? (**fit).*items : std::vector<Item>()) {
                table.text("photo", photo.photo.string());
                table.text("pose", pose);
                add(item, table);
                table.end_row();
            }
    return table.finish();
}

}  // namespace

std::string comparison_csv(const Comparison& comparison) {
    CsvTable table;
    for (const ComparedPhoto& photo : comparison.photos) {
        table.text("photo", photo.photo.string());
        table.text("outcome", photo.outcome());
        table.text("findings", joined_names(photo.findings));
        table.text("failure", photo.failure);
        table.number("reprojection_rms_px", photo.estimate
                                                ? std::optional(photo.estimate->reprojection_rms_px)
                                                : std::nullopt);
        add_fit("", photo.calibrated, table);
        add_fit("refined_", photo.refined, table);
        add_pose_deviations(photo, table);
        add_edge_summary("", photo.calibrated, table);
        add_edge_summary("refined_", photo.refined, table);
        table.end_row();
    }
    return table.finish();
}

std::string photometry_csv(const Comparison& comparison) {
    return rows_of_fits(comparison, &ComparedFit::parameters, add_parameter);
}

std::string edges_csv(const Comparison& comparison) {
    return rows_of_fits(comparison, &ComparedFit::edges, add_edge);
}

std::string profiles_csv(const Comparison& comparison) {
    CsvTable table;
    add_profile("radius_px", "calibrated", comparison.profiles.radius, table);
    add_profile("radius_px", "refined", comparison.profiles.refined_radius, table);
    add_profile("depth_mm", "calibrated", comparison.profiles.depth, table);
    add_profile("depth_mm", "refined", comparison.profiles.refined_depth, table);
    return table.finish();
}

std::string defocus_csv(const Comparison& comparison) {
    CsvTable table;
    for (const ComparedPhoto& photo : comparison.photos)
        for (const DepthBin& bin : photo.defocus ? photo.defocus->bins : std::vector<DepthBin>()) {
            if (bin.edges == 0)
                continue;
            table.text("photo", photo.photo.string());
            table.number("low_mm", bin.low_mm);
            table.number("high_mm", bin.high_mm);
            table.number("depth_mm", bin.depth_mm);
            table.number("edges", bin.edges);
            table.number("measured_px2", bin.measured_px2);
            table.number("measured_deviation_px2", bin.measured_deviation_px2);
            table.number("rendered_px2", bin.rendered_px2);
            table.number("residual_rms_gray", bin.residual_rms_gray);
            table.end_row();
        }
    return table.finish();
}

}  // namespace etalon
