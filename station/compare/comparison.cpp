#include "station/compare/comparison.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

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

// Pose, residual and edge shift of a fit, if there is one.
void summarise_fit(const std::optional<ComparedFit>& fit, std::optional<Rigid>& pose,
                   std::optional<double>& residual_gray, std::optional<double>& edge_shift_px) {
    if (!fit)
        return;
    pose = fit->camera_from_marker;
    residual_gray = fit->scored.rms_gray;
    if (fit->edge_summary.edges > 0)
        edge_shift_px = fit->edge_summary.shift.rms_px;
}

}  // namespace

void ComparedPhoto::drop_figures() {
    calibrated = refined = std::nullopt;
    photometric = std::nullopt;
    defocus = std::nullopt;
}

const char* ComparedPhoto::outcome() const {
    if (!has_figures())
        return "refused";
    return is_matched(findings) ? "matched" : "not matched";
}

std::string ComparedPhoto::reason() const {
    std::string text = failure;
    for (const Finding& finding : findings)
        text += (text.empty() ? "" : " ") + finding.sentence;
    return text;
}

ResidualProfile::ResidualProfile(double low_end, double high_end, int steps)
    : low(low_end),
      high(high_end),
      squares(static_cast<std::size_t>(steps), 0.0),
      pixels(static_cast<std::size_t>(steps), 0.0) {}

void ResidualProfile::add(double place, double residual) {
    const double steps = static_cast<double>(squares.size());
    const double share = high > low ? (place - low) / (high - low) : 0.0;
    const auto step = static_cast<std::size_t>(std::clamp(share * steps, 0.0, steps - 1.0));
    squares[step] += residual * residual;
    pixels[step] += 1.0;
}

void ResidualProfile::add(const ResidualProfile& other) {
    for (std::size_t i = 0; i < squares.size() && i < other.squares.size(); ++i) {
        squares[i] += other.squares[i];
        pixels[i] += other.pixels[i];
    }
}

double ResidualProfile::middle(std::size_t step) const {
    return low +
           (static_cast<double>(step) + 0.5) / static_cast<double>(squares.size()) * (high - low);
}

std::optional<double> ResidualProfile::rms(std::size_t step) const {
    constexpr double min_pixels = 100;
    if (pixels[step] < min_pixels)
        return std::nullopt;
    return std::sqrt(squares[step] / pixels[step]);
}

void ResidualProfiles::add(const ResidualProfiles& other) {
    radius.add(other.radius);
    refined_radius.add(other.refined_radius);
    depth.add(other.depth);
    refined_depth.add(other.refined_depth);
}

bool Comparison::has_poses() const {
    return std::ranges::any_of(photos, &std::string::empty, &ComparedPhoto::failure);
}

std::size_t Comparison::compared() const {
    return static_cast<std::size_t>(std::ranges::count_if(photos, &ComparedPhoto::has_figures));
}

std::size_t Comparison::matched() const {
    return static_cast<std::size_t>(std::ranges::count_if(photos, [](const auto& photo) {
        return photo.has_figures() && is_matched(photo.findings);
    }));
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
    for (const ComparedPhoto& photo : photos) {
        if (!photo.has_figures())
            continue;
        const std::vector<EdgeShift>& edges = (photo.*fit)->edges;
        std::copy_if(edges.begin(), edges.end(), std::back_inserter(all),
                     [only_scored](const EdgeShift& edge) {
                         return !only_scored || edge.use == pixel_scored;
                     });
    }
    return all;
}

double Comparison::mean_psf_sigma_px() const {
    return mean_over(*this, [](const auto& photo) { return photo.calibrated->model.psf_sigma_px; });
}

std::optional<std::pair<EdgeSummary, EdgeSummary>> Comparison::edge_summaries() const {
    const std::vector<EdgeShift> before = edges(&ComparedPhoto::calibrated, true);
    const std::vector<EdgeShift> after = edges(&ComparedPhoto::refined, true);
    if (before.empty() || after.empty())
        return std::nullopt;
    return std::pair(edge_summary(before), edge_summary(after));
}

std::vector<std::string> blind_spots(const Comparison& comparison) {
    std::vector<std::string> spots;
    const CameraModel& camera = comparison.camera;
    if (!comparison.detector.empty()) {
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
    if (std::ranges::any_of(comparison.photos, &ComparedPhoto::is_jpeg))
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

std::string board_in_words(const Comparison& comparison) {
    if (!comparison.board || !comparison.board->are_the_boards())
        return "";
    return fmt::format(
        "{:.0f} % of what displaces edges comes back at the same place of the marker in other "
        "photographs ({:.2f} mm RMS): it is not flat, or not printed true. etalon calibrate "
        "--fit-board measures a board's shape.",
        100.0 * comparison.board->share, comparison.board->rms_mm);
}

std::string source_of_poses(const Comparison& comparison) {
    if (comparison.detector.empty())
        return "given in " + std::filesystem::path(comparison.poses).filename().string();
    return "estimated from corners (" + comparison.detector + ")";
}

std::string scored_region(const Comparison& comparison) {
    if (!comparison.is_chessboard)
        return "the whole marker with its white border";
    return fmt::format("the inner corners and {} squares around them in x, {} in y",
                       comparison.margin.x, comparison.margin.y);
}

ComparisonSummary summary_of(const Comparison& comparison) {
    const CameraModel& camera = comparison.camera;
    ComparisonSummary summary{camera.serial, camera.width, camera.height, comparison.marker, {}};
    for (const ComparedPhoto& photo : comparison.photos) {
        PhotoSummary entry;
        entry.name = photo.photo.filename().string();
        entry.outcome = photo.outcome();
        summarise_fit(photo.calibrated, entry.camera_from_marker, entry.residual_gray,
                      entry.edge_shift_px);
        summarise_fit(photo.refined, entry.refined_from_marker, entry.refined_residual_gray,
                      entry.refined_edge_shift_px);
        if (photo.calibrated)
            entry.psf_sigma_px = photo.calibrated->model.psf_sigma_px;
        summary.photos.push_back(entry);
    }
    return summary;
}

}  // namespace etalon
