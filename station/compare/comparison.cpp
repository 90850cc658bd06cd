#include "station/compare/comparison.h"

#include <fmt/format.h>

namespace etalon {
namespace {

// Mean over the compared photographs of whatever `value` takes from each.
template <class Function>
double mean_over(const Comparison& comparison, Function value) {
    double sum = 0.0;
    for (const ComparedPhoto& photo : comparison.photos)
        if (photo.has_figures())
            sum += value(photo);
    return sum / static_cast<double>(std::max<std::size_t>(comparison.compared(), 1));
}

void summarise_fit(const std::optional<ComparedFit>& fit, std::optional<Rigid>& pose,
                   std::optional<double>& residual_gray, std::optional<double>& edge_shift_px) {
    if (!fit)
        return;
    pose = fit->camera_from_marker();
    residual_gray = fit->scored.rms_gray;
    if (const EdgeSummary* edges = fit->edges_if_any())
        edge_shift_px = edges->shift.rms_px;
}

}  // namespace

const char* ComparedPhoto::outcome() const {
    return !has_figures() ? "refused" : is_matched() ? "matched" : "not matched";
}

std::string ComparedPhoto::reason() const {
    std::string text = failure;
    for (const Finding& finding : findings)
        text += (text.empty() ? "" : " ") + finding.sentence;
    return text;
}

std::vector<std::string> ComparedPhoto::names_of_findings() const {
    std::vector<std::string> names;
    for (const Finding& finding : findings)
        names.push_back(finding.name);
    return names;
}

void ResidualProfile::add(double place, double residual) {
    const auto count = static_cast<double>(steps.size());
    const double share = high > low ? (place - low) / (high - low) : 0.0;
    Step& step = steps[static_cast<std::size_t>(std::clamp(share * count, 0.0, count - 1.0))];
    step.squares += residual * residual;
    step.pixels += 1.0;
}

std::vector<ResidualProfile::Point> ResidualProfile::points() const {
    constexpr double min_pixels = 100;
    std::vector<Point> points;
    for (std::size_t i = 0; i < steps.size(); ++i)
        if (const auto& [squares, pixels] = steps[i]; pixels >= min_pixels)
            points.push_back({low + (static_cast<double>(i) + 0.5) /
                                        static_cast<double>(steps.size()) * (high - low),
                              std::sqrt(squares / pixels), pixels});
    return points;
}

std::size_t Comparison::compared() const {
    return static_cast<std::size_t>(std::ranges::count_if(photos, &ComparedPhoto::has_figures));
}

std::size_t Comparison::matched() const {
    return static_cast<std::size_t>(std::ranges::count_if(photos, &ComparedPhoto::is_matched));
}

double Comparison::mean_rms_gray() const {
    return mean_over(*this, [](const auto& photo) { return photo.calibrated->scored.rms_gray; });
}

double Comparison::refined_mean_rms_gray() const {
    return mean_over(*this, [](const auto& photo) { return photo.refined->scored.rms_gray; });
}

std::vector<EdgeShift> Comparison::edges(std::optional<ComparedFit> ComparedPhoto::*fit,
                                         bool only_scored) const {
    std::vector<EdgeShift> all;
    for (const ComparedPhoto& photo : photos)
        if (photo.has_figures())
            std::ranges::copy_if(
                (photo.*fit)->edges, std::back_inserter(all),
                [&](const EdgeShift& edge) { return !only_scored || edge.use == pixel_scored; });
    return all;
}

double Comparison::mean_psf_sigma_px() const {
    return mean_over(*this, [](const auto& photo) { return photo.calibrated->psf_sigma_px(); });
}

std::optional<std::pair<EdgeSummary, EdgeSummary>> Comparison::edge_summaries() const {
    const std::vector<EdgeShift> before = edges(&ComparedPhoto::calibrated, true);
    const std::vector<EdgeShift> after = edges(&ComparedPhoto::refined, true);
    if (before.empty() || after.empty())
        return std::nullopt;
    return std::pair(edge_summary(before), edge_summary(after));
}

std::vector<std::string> Comparison::blind_spots() const {
    std::vector<std::string> spots;
    if (!detector.empty()) {
        spots.push_back(
            "The size of the marker: one printed 1 % larger, 1 % farther away, gives the same "
            "photographs. Only a stage or a ruler tells them apart.");
        spots.push_back(
            "Errors of the calibration that a pose can imitate: each pose was found in its own "
            "photograph with the same calibration. A run with a stage (etalon qualify) sees them.");
    }
    if (!camera.sensor || camera.sensor->gain_e_per_dn == 0.0)
        spots.push_back(
            "Noise: the camera's file states none. Significance is against the residuals' own "
            "scatter in each photograph. The command etalon characterise measures the noise.");
    if (!camera.lens)
        spots.push_back(
            "The lens's blur: the camera's file has no lens section. A Gaussian's widths are "
            "fitted to "
            "each photograph, so that a wrong focus shows as a width and not as a residual.");
    if (std::ranges::any_of(photos, &ComparedPhoto::is_jpeg))
        spots.push_back(
            "What JPEG did to the photographs: it is part of the residual, and its blocks make "
            "neighbouring pixels depend on each other. Stated uncertainties take them as "
            "independent.");
    spots.push_back(
        "Exposure and smooth shading: black and white levels are fitted to each photograph, as "
        "surfaces of second order.");
    if (camera.serial.empty())
        spots.push_back("Which camera this was: its file has no serial number.");
    return spots;
}

std::string Comparison::board_in_words() const {
    if (!board || !board->are_the_boards())
        return "";
    return fmt::format(
        "{:.0f} % of what displaces edges comes back at the same place of the marker in other "
        "photographs ({:.2f} mm RMS): it is not flat, or not printed true. etalon calibrate "
        "--fit-board measures a board's shape.",
        100.0 * board->share, board->rms_mm);
}

std::string Comparison::source_of_poses() const {
    if (detector.empty())
        return "given in " + std::filesystem::path(poses).filename().string();
    return "estimated from corners (" + detector + ")";
}

ComparisonSummary Comparison::summary() const {
    ComparisonSummary summary{camera.serial, camera.width, camera.height, marker.spec, {}};
    for (const ComparedPhoto& photo : photos) {
        PhotoSummary& entry = summary.photos.emplace_back();
        entry.name = photo.name();
        entry.outcome = photo.outcome();
        summarise_fit(photo.calibrated, entry.camera_from_marker, entry.residual_gray,
                      entry.edge_shift_px);
        summarise_fit(photo.refined, entry.refined_from_marker, entry.refined_residual_gray,
                      entry.refined_edge_shift_px);
        if (photo.calibrated)
            entry.psf_sigma_px = photo.calibrated->psf_sigma_px();
    }
    return summary;
}

}  // namespace etalon
