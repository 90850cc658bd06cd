// comparison.json: the whole result. What `--baseline` reads of it is in
// station/compare/compare_baseline.h.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "report/json_text.h"
#include "report/number_text.h"
#include "station/compare/comparison_report.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

ordered_json statistics_json(const ResidualStatistics& statistics) {
    ordered_json json = {{"pixels", statistics.pixels},
                         {"rms_gray", statistics.rms_gray},
                         {"mean_gray", statistics.mean_gray},
                         {"p99_gray", statistics.p99_gray},
                         {"worst_gray", statistics.worst_gray}};
    if (statistics.significant)
        json["significant"] = *statistics.significant;
    return json;
}

ordered_json parameter_json(const MatchParameter& parameter) {
    ordered_json json = {{"name", parameter.name}, {"value", parameter.value}};
    if (parameter.deviation)
        json["deviation"] = *parameter.deviation;
    json["unit"] = parameter.unit;
    json["source"] = parameter.source;
    return json;
}

// Roots of sums of squares, noise taken out of the shift; the parts' squares add up to the band's.
ordered_json edges_json(const EdgeSummary& summary) {
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
            {"parts",
             {{"shift_gray", summary.parts.shift_gray},
              {"blur_gray", summary.parts.blur_gray},
              {"photometric_gray", summary.parts.photometric_gray},
              {"rest_gray", summary.parts.rest_gray},
              {"residual_gray", summary.parts.residual_gray}}}};
}

ordered_json fit_json(const ComparedFit& fit) {
    ordered_json json = {
        {"camera_from_marker", pose_numbers(fit.camera_from_marker)},
        {"scored", statistics_json(fit.scored)},
        {"fitted", statistics_json(fit.fitted)},
        {"noise",
         {{"deviation_gray", fit.noise_gray},
          {"source", fit.noise_source == NoiseSource::camera ? "camera" : "residuals"}}},
        {"photometric_model",
         {{"black_gray", numbers_of(fit.model.black)},
          {"white_gray", numbers_of(fit.model.white)},
          {"psf_sigma_px", fit.model.psf_sigma_px},
          {"psf_anisotropy_px2", fit.model.psf_anisotropy_px2},
          {"tone", fit.model.tone}}}};
    if (fit.model.saturation)
        json["photometric_model"]["saturation"] = {{"level_gray", fit.model.saturation->level_gray},
                                                   {"knee_gray", fit.model.saturation->knee_gray}};
    if (fit.edge_summary.edges > 0)
        json["edges"] = edges_json(fit.edge_summary);
    json["parameters"] = json_list(fit.parameters, parameter_json);
    return json;
}

ordered_json finding_json(const Finding& finding) {
    return {{"name", finding.name},
            {"value", finding.value},
            {"limit", finding.limit},
            {"unit", finding.unit},
            {"refusal", finding.is_not_assessable},
            {"sentence", finding.sentence}};
}

void add_detection(const PoseEstimate& estimate, ordered_json& json) {
    json["reprojection_rms_px"] = estimate.reprojection_rms_px;
    if (!estimate.alternative)
        return;
    json["alternative"] = pose_numbers(*estimate.alternative);
    json["alternative_rms_px"] = estimate.alternative_rms_px;
}

// The covariance's order is that of the change: left perturbation, rotation then translation.
void add_refinement(const ComparedPhoto& photo, ordered_json& json) {
    json["refined"] = fit_json(*photo.refined);
    json["refined"]["converged"] = photo.photometric->converged;
    json["refined"]["covariance"] = row_numbers(photo.photometric->covariance);
    json["pose_change"] = numbers_of(
        left_difference(photo.calibrated->camera_from_marker, photo.refined->camera_from_marker));
}

ordered_json minimum_json(const WidthMinimum& minimum) {
    if (!minimum.is_determined)
        return {{"undetermined", minimum.undetermined}};
    return {{"focus_distance_mm", minimum.focus_distance_mm},
            {"standard_uncertainty_mm", minimum.standard_uncertainty_mm}};
}

// The bins are in defocus.csv.
ordered_json defocus_json(const DefocusProfile& profile) {
    return {{"edges", profile.edges},
            {"photograph", minimum_json(profile.photo)},
            {"rendering", minimum_json(profile.rendering)},
            {"file", "defocus.csv"}};
}

ordered_json photo_json(const ComparedPhoto& photo) {
    ordered_json json = {{"photo", photo.photo.string()}, {"outcome", photo.outcome()}};
    if (!photo.failure.empty())
        json["failure"] = photo.failure;
    json["findings"] = json_list(photo.findings, finding_json);
    if (photo.estimate)
        add_detection(*photo.estimate, json);
    if (!photo.calibrated)
        return json;
    json["calibrated"] = fit_json(*photo.calibrated);
    if (photo.refined)
        add_refinement(photo, json);
    if (photo.defocus)
        json["defocus"] = defocus_json(*photo.defocus);
    json["files"] = {{"overlay", photo.pictures.overlay_file},
                     {"residual_map", photo.pictures.residual_file},
                     {"significance_map", photo.pictures.significance_file},
                     {"rendering", photo.pictures.rendering_file}};
    if (!photo.pictures.edges_file.empty())
        json["files"]["edge_map"] = photo.pictures.edges_file;
    return json;
}

ordered_json profile_json(const ResidualProfile& profile) {
    ordered_json json = ordered_json::array();
    for (std::size_t i = 0; i < profile.pixels.size(); ++i)
        if (const auto rms = profile.rms(i))
            json.push_back(
                {{"at", profile.middle(i)}, {"rms_gray", *rms}, {"pixels", profile.pixels[i]}});
    return json;
}

// Of all photographs; every single edge is in edges.csv.
void add_edges(const Comparison& comparison, ordered_json& json) {
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

ordered_json change_json(const PairedChange& quantity) {
    ordered_json json = {{"quantity", quantity.quantity}, {"unit", quantity.unit},
                         {"pairs", quantity.pairs},       {"earlier", quantity.earlier},
                         {"now", quantity.now},           {"change", quantity.mean}};
    if (quantity.half_width)
        json["half_width"] = *quantity.half_width;
    return json;
}

ordered_json baseline_json(const BaselineChange& change) {
    return {{"folder", change.folder.string()},
            {"serial_numbers_known", change.serials_known},
            {"pairs", change.pairs.size()},
            {"only_now", change.only_now},
            {"only_earlier", change.only_earlier},
            {"ambiguous", change.ambiguous},
            {"confidence", baseline_confidence},
            {"quantities", json_list(change.quantities, change_json)}};
}

}  // namespace

std::string comparison_json(const Comparison& comparison) {
    ordered_json json = {
        {"etalon", "comparison/1"},
        {"camera", comparison.camera_file.string()},
        {"serial", comparison.camera.serial},
        {"image", {{"width", comparison.camera.width}, {"height", comparison.camera.height}}},
        {"marker", comparison.marker},
        {"poses", source_of_poses(comparison)},
        {"mean_residual_gray", comparison.mean_rms_gray()}};
    if (const auto refined = comparison.refined_mean_rms_gray())
        json["mean_refined_residual_gray"] = *refined;
    json["photos_compared"] = comparison.compared();
    json["photos_matched"] = comparison.matched();
    json["photos_refused"] = comparison.photos.size() - comparison.compared();
    if (comparison.is_chessboard)
        json["score_margin_squares"] = {comparison.margin.x, comparison.margin.y};
    json["not_seen"] = blind_spots(comparison);
    json["photos"] =
        json_list(comparison.photos, [](const ComparedPhoto& photo) { return photo_json(photo); });
    const ResidualProfiles& profiles = comparison.profiles;
    json["profiles"] = {{"radius_px", profile_json(profiles.radius)},
                        {"refined_radius_px", profile_json(profiles.refined_radius)},
                        {"depth_mm", profile_json(profiles.depth)},
                        {"refined_depth_mm", profile_json(profiles.refined_depth)}};
    add_edges(comparison, json);
    if (comparison.baseline)
        json["baseline"] = baseline_json(*comparison.baseline);
    json["software"] = software_json(software_versions());
    return text_of(json);
}

}  // namespace etalon
