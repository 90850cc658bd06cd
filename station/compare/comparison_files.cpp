// comparison.json and the CSV tables of a comparison, numbers unrounded.
#include <fmt/format.h>

#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "station/compare/comparison.h"

namespace etalon {

ETALON_MEMBERS_TO_JSON(EdgeParts, shift_gray, blur_gray, photometric_gray, rest_gray, residual_gray)
ETALON_MEMBERS_TO_JSON(Saturation, level_gray, knee_gray)

namespace {

ColumnsOf<ComparedFit> fit_columns() {
    ColumnsOf<ComparedFit> columns;
    add_columns(columns, columns_of_pose(), &ComparedFit::camera_from_marker);
    const ColumnsOf<ResidualStatistics> scored = {{"rms_gray", &ResidualStatistics::rms_gray},
                                                  {"mean_gray", &ResidualStatistics::mean_gray},
                                                  {"p99_gray", &ResidualStatistics::p99_gray},
                                                  {"worst_gray", &ResidualStatistics::worst_gray},
                                                  {"scored_pixels", &ResidualStatistics::pixels}};
    add_columns(columns, scored, &ComparedFit::scored);
    columns.push_back(
        {"fitted_rms_gray", [](const ComparedFit& fit) { return fit.fitted.rms_gray; }});
    columns.push_back(
        {"significant", [](const ComparedFit& fit) { return fit.scored.significant; }});
    columns.push_back({"psf_sigma_px", &ComparedFit::psf_sigma_px});
    return columns;
}

// Of the scored half.
ColumnsOf<EdgeSummary> edge_summary_columns() {
    ColumnsOf<EdgeSummary> columns = {
        {"edges", &EdgeSummary::edges},
        {"edges_beyond_range", &EdgeSummary::beyond_range},
        {"edge_shift_rms_px", [](const EdgeSummary& edges) { return edges.shift.rms_px; }},
        {"edge_shift_rms_deviation_px",
         [](const EdgeSummary& edges) { return edges.shift.rms_deviation_px; }},
        {"edge_shift_mean_px", &EdgeSummary::mean_shift_px},
        {"edge_blur_px2", &EdgeSummary::mean_blur_px2}};
    const ColumnsOf<EdgeParts> parts = {{"residual_gray", &EdgeParts::residual_gray},
                                        {"shift_gray", &EdgeParts::shift_gray},
                                        {"blur_gray", &EdgeParts::blur_gray},
                                        {"photometric_gray", &EdgeParts::photometric_gray},
                                        {"rest_gray", &EdgeParts::rest_gray}};
    add_columns(columns, parts, &EdgeSummary::parts, "band_");
    return columns;
}

ColumnsOf<EdgeShift> edge_columns() {
    const auto of = [](Eigen::Vector2d EdgeShift::*vector, int axis) {
        return [=](const EdgeShift& edge) { return (edge.*vector)[axis]; };
    };
    return {
        {"x_px", of(&EdgeShift::middle_px, 0)},
        {"y_px", of(&EdgeShift::middle_px, 1)},
        {"normal_x", of(&EdgeShift::normal, 0)},
        {"normal_y", of(&EdgeShift::normal, 1)},
        {"length_px", &EdgeShift::length_px},
        {"depth_mm", &EdgeShift::depth_mm},
        {"radius_px", &EdgeShift::radius_px},
        {"half",
         [](const EdgeShift& edge) { return edge.use == pixel_scored ? "scored" : "fitted"; }},
        {"pixels", &EdgeShift::pixels},
        {"beyond_range", [](const EdgeShift& edge) { return edge.is_beyond_range ? "yes" : "no"; }},
        {"shift_px", &EdgeShift::shift_px},
        {"shift_deviation_px", &EdgeShift::shift_deviation_px},
        {"blur_variance_px2", &EdgeShift::blur_variance_px2},
        {"blur_deviation_px2", &EdgeShift::blur_deviation_px2},
        {"black_gray", &EdgeShift::black_gray},
        {"black_deviation_gray", &EdgeShift::black_deviation_gray},
        {"white_gray", &EdgeShift::white_gray},
        {"white_deviation_gray", &EdgeShift::white_deviation_gray},
        {"step_gray", &EdgeShift::step_gray},
        {"rendered_variance_px2", &EdgeShift::rendered_variance_px2},
        {"reduced_chi_square", &EdgeShift::reduced_chi_square}};
}

// `name_key`: CSV and JSON call it differently.
ColumnsOf<MatchParameter> parameter_columns(const char* name_key) {
    return {{name_key, &MatchParameter::name},
            {"value", &MatchParameter::value},
            {"deviation", &MatchParameter::deviation},
            {"unit", &MatchParameter::unit},
            {"source", [](const MatchParameter& parameter) { return parameter.source; }}};
}

// Something of a photograph, at the pose under test or at the refined one.
template <class Item>
struct ItemOfPhoto {
    std::string photo, pose;
    const Item* item = nullptr;
};

template <class Fit, class Item>
std::string items_csv(const Comparison& comparison, std::vector<Item> Fit::*items,
                      const ColumnsOf<Item>& item_columns) {
    ColumnsOf<ItemOfPhoto<Item>> columns = {{"photo", &ItemOfPhoto<Item>::photo},
                                            {"pose", &ItemOfPhoto<Item>::pose}};
    add_columns(columns, item_columns, &ItemOfPhoto<Item>::item);
    std::vector<ItemOfPhoto<Item>> rows;
    for (const ComparedPhoto& photo : comparison.photos)
        for (const auto& [pose, fit] :
             {std::pair("calibrated", &photo.calibrated), std::pair("refined", &photo.refined)})
            if (*fit)
                for (const Item& item : (**fit).*items)
                    rows.push_back({photo.photo.string(), pose, &item});
    return csv_of(table_of(columns, rows));
}

// ---- JSON: what is missing has no key -------------------------------------------------------

Json statistics_json(const ResidualStatistics& statistics) {
    const ColumnsOf<ResidualStatistics> columns = {
        {"pixels", &ResidualStatistics::pixels},
        {"rms_gray", &ResidualStatistics::rms_gray},
        {"mean_gray", &ResidualStatistics::mean_gray},
        {"p99_gray", &ResidualStatistics::p99_gray},
        {"worst_gray", &ResidualStatistics::worst_gray},
        {"significant", &ResidualStatistics::significant}};
    return json_object(columns, statistics, MissingFigure::left_out);
}

// Roots of sums of squares, noise taken out of the shift; the parts' squares add up to the band's.
Json edges_json(const EdgeSummary& summary) {
    return {{"edges", summary.edges},
            {"beyond_range", summary.beyond_range},
            {"shift_rms_px", summary.shift.rms_px},
            {"shift_rms_deviation_px", summary.shift.rms_deviation_px},
            {"shift_rms_with_noise_px", summary.shift.with_noise_px},
            {"shift_noise_px", summary.shift.noise_px},
            {"median_shift_px", summary.median_shift_px},
            {"mean_shift_px", summary.mean_shift_px},
            {"mean_shift_deviation_px", summary.mean_shift_deviation_px},
            {"mean_blur_px2", summary.mean_blur_px2},
            {"mean_blur_deviation_px2", summary.mean_blur_deviation_px2},
            {"parts", summary.parts}};
}

Json fit_json(const ComparedFit& fit) {
    const PhotometricModel& model = fit.state.photometry;
    Json json = {{"camera_from_marker", pose_numbers(fit.camera_from_marker())},
                 {"scored", statistics_json(fit.scored)},
                 {"fitted", statistics_json(fit.fitted)},
                 {"noise",
                  {{"deviation_gray", fit.noise_gray},
                   {"source", fit.noise_source == NoiseSource::camera ? "camera" : "residuals"}}},
                 {"photometric_model",
                  {{"black_gray", numbers_of(model.black)},
                   {"white_gray", numbers_of(model.white)},
                   {"psf_sigma_px", model.psf_sigma_px},
                   {"psf_anisotropy_px2", model.psf_anisotropy_px2},
                   {"tone", model.tone}}}};
    add_present(json["photometric_model"], "saturation", model.saturation);
    if (const EdgeSummary* edges = fit.edges_if_any())
        json["edges"] = edges_json(*edges);
    json["parameters"] =
        json_rows(table_of(parameter_columns("name"), fit.parameters), MissingFigure::left_out);
    return json;
}

Json finding_json(const Finding& finding) {
    return {{"name", finding.name},
            {"value", finding.value},
            {"limit", finding.limit},
            {"unit", finding.unit},
            {"refusal", finding.is_not_assessable},
            {"sentence", finding.sentence}};
}

Json minimum_json(const WidthMinimum& minimum) {
    if (!minimum.is_determined)
        return {{"undetermined", minimum.undetermined}};
    return {{"focus_distance_mm", minimum.focus_distance_mm},
            {"standard_uncertainty_mm", minimum.standard_uncertainty_mm}};
}

// The covariance's order is that of the change: left perturbation, rotation then translation.
void add_fits(const ComparedPhoto& photo, Json& json) {
    json["calibrated"] = fit_json(*photo.calibrated);
    json["refined"] = fit_json(*photo.refined);
    json["refined"]["converged"] = photo.photometric->converged;
    json["refined"]["covariance"] = row_numbers(photo.photometric->covariance);
    json["pose_change"] = numbers_of(left_difference(photo.calibrated->camera_from_marker(),
                                                     photo.refined->camera_from_marker()));
    if (photo.defocus)  // its bins are in defocus.csv
        json["defocus"] = {{"edges", photo.defocus->edges},
                           {"photograph", minimum_json(photo.defocus->photo)},
                           {"rendering", minimum_json(photo.defocus->rendering)},
                           {"file", "defocus.csv"}};
    json["files"] = {{"overlay", photo.pictures.overlay_file},
                     {"residual_map", photo.pictures.residual_file},
                     {"significance_map", photo.pictures.significance_file},
                     {"rendering", photo.pictures.rendering_file},
                     {"edge_map", photo.pictures.edges_file}};
}

Json photo_json(const ComparedPhoto& photo) {
    Json json = {{"photo", photo.photo.string()}, {"outcome", photo.outcome()}};
    if (!photo.failure.empty())
        json["failure"] = photo.failure;
    json["findings"] = json_list(photo.findings, finding_json);
    if (photo.estimate)
        json["reprojection_rms_px"] = photo.estimate->reprojection_rms_px;
    if (photo.estimate && photo.estimate->alternative) {
        json["alternative"] = pose_numbers(*photo.estimate->alternative);
        json["alternative_rms_px"] = photo.estimate->alternative_rms_px;
    }
    if (photo.calibrated)
        add_fits(photo, json);
    return json;
}

// Of all photographs; every single edge is in edges.csv.
void add_edges(const Comparison& comparison, Json& json) {
    if (const auto edges = comparison.edge_summaries())
        json["edges"] = {{"calibrated", edges_json(edges->first)},
                         {"refined", edges_json(edges->second)},
                         {"file", "edges.csv"}};
    if (const auto& board = comparison.board)
        json["edges"]["with_the_marker"] = {{"share", board->share},
                                            {"rms_mm", board->rms_mm},
                                            {"chance", board->chance},
                                            {"is_distorted", board->are_the_boards()}};
}

Json baseline_json(const BaselineChange& change) {
    return {{"folder", change.folder.string()},
            {"serial_numbers_known", change.serials_known},
            {"pairs", change.pairs.size()},
            {"only_now", change.only_now},
            {"only_earlier", change.only_earlier},
            {"ambiguous", change.ambiguous},
            {"confidence", baseline_confidence},
            {"quantities", json_rows(change_table(change), MissingFigure::left_out)}};
}

}  // namespace

std::string comparison_csv(const Comparison& comparison) {
    ColumnsOf<ComparedPhoto> columns = {
        {"photo", [](const ComparedPhoto& photo) { return photo.photo.string(); }},
        {"outcome", &ComparedPhoto::outcome},
        {"findings",
         [](const ComparedPhoto& photo) {
             return fmt::format("{}", fmt::join(photo.names_of_findings(), " "));
         }},
        {"failure", &ComparedPhoto::failure}};
    const ColumnsOf<PoseEstimate> estimate = {
        {"reprojection_rms_px", &PoseEstimate::reprojection_rms_px}};
    add_columns(columns, estimate, &ComparedPhoto::estimate);
    add_columns(columns, fit_columns(), &ComparedPhoto::calibrated);
    add_columns(columns, fit_columns(), &ComparedPhoto::refined, "refined_");
    for (int i = 0; const Column<Rigid>& component : columns_of_pose()) {
        const ColumnsOf<PhotometricPose> deviation = {
            {component.key,
             [i](const PhotometricPose& pose) { return std::sqrt(pose.covariance(i, i)); }}};
        add_columns(columns, deviation, &ComparedPhoto::photometric, "refined_deviation_");
        ++i;
    }
    for (const auto& [prefix, fit] : {std::pair("", &ComparedPhoto::calibrated),
                                      std::pair("refined_", &ComparedPhoto::refined)})
        add_columns(
            columns, edge_summary_columns(),
            [fit = fit](const ComparedPhoto& photo) {
                return photo.*fit ? (photo.*fit)->edges_if_any() : nullptr;
            },
            prefix);
    return csv_of(table_of(columns, comparison.photos));
}

std::string photometry_csv(const Comparison& comparison) {
    return items_csv(comparison, &ComparedFit::parameters, parameter_columns("parameter"));
}

std::string edges_csv(const Comparison& comparison) {
    return items_csv(comparison, &ComparedFit::edges, edge_columns());
}

std::string profiles_csv(const Comparison& comparison) {
    std::string text = "against,pose,middle,rms_gray,pixels\n";
    for (const ResidualProfile& profile : comparison.profiles)
        for (const auto& [middle, rms_gray, pixels] : profile.points())
            text += fmt::format("{},{},{},{},{}\n", profile.against, profile.pose, exact(middle),
                                exact(rms_gray), exact(pixels));
    return text;
}

std::string defocus_csv(const Comparison& comparison) {
    const ColumnsOf<DepthBin> bins = {{"low_mm", &DepthBin::low_mm},
                                      {"high_mm", &DepthBin::high_mm},
                                      {"depth_mm", &DepthBin::depth_mm},
                                      {"edges", &DepthBin::edges},
                                      {"measured_px2", &DepthBin::measured_px2},
                                      {"measured_deviation_px2", &DepthBin::measured_deviation_px2},
                                      {"rendered_px2", &DepthBin::rendered_px2},
                                      {"residual_rms_gray", &DepthBin::residual_rms_gray}};
    using Row = ItemOfPhoto<DepthBin>;
    ColumnsOf<Row> columns = {{"photo", &Row::photo}};
    add_columns(columns, bins, &Row::item);
    std::vector<Row> rows;
    for (const ComparedPhoto& photo : comparison.photos)
        if (photo.defocus)
            for (const DepthBin& bin : photo.defocus->bins)
                if (bin.edges > 0)
                    rows.push_back({photo.photo.string(), "", &bin});
    return csv_of(table_of(columns, rows));
}

std::string comparison_json(const Comparison& comparison) {
    Json json = {
        {"etalon", "comparison/1"},
        {"camera", comparison.camera_file.string()},
        {"serial", comparison.camera.serial},
        {"image", {{"width", comparison.camera.width}, {"height", comparison.camera.height}}},
        {"marker", comparison.marker.spec},
        {"poses", comparison.source_of_poses()},
        {"mean_residual_gray", comparison.mean_rms_gray()},
        {"mean_refined_residual_gray", comparison.refined_mean_rms_gray()},
        {"photos_compared", comparison.compared()},
        {"photos_matched", comparison.matched()},
        {"photos_refused", comparison.photos.size() - comparison.compared()}};
    if (comparison.marker.kind == Marker::Kind::chessboard)
        json["score_margin_squares"] = {comparison.margin.x, comparison.margin.y};
    json["not_seen"] = comparison.blind_spots();
    json["photos"] = json_list(comparison.photos, photo_json);
    for (const ResidualProfile& profile : comparison.profiles) {
        const std::string prefix = profile.pose == std::string("refined") ? "refined_" : "";
        json["profiles"][prefix + profile.against] =
            json_list(profile.points(), [](const ResidualProfile::Point& point) -> Json {
                return {
                    {"at", point.middle}, {"rms_gray", point.rms_gray}, {"pixels", point.pixels}};
            });
    }
    add_edges(comparison, json);
    add_present(json, "baseline", comparison.baseline, baseline_json);
    json["software"] = software_json(software_versions());
    return text_of(json);
}

}  // namespace etalon
