#include "compare/characterise/characterisation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "compare/photometric/compared_area.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double mtf_half_width_px = 12.0;
constexpr std::size_t max_mtf_edges = 9;  // one a zone of the image

std::vector<StraightEdge> edges_of(const CharacteriseInput& input,
                                   const std::vector<std::optional<Rigid>>& poses,
                                   const CameraModel& camera, const EdgeSelection& selection) {
    const Projector projector(camera);
    const ComparedArea area = compared_area(input.target.board, {}, "--target");
    std::vector<StraightEdge> edges;
    for (std::size_t i = 0; i < input.photos.size(); ++i) {
        if (!poses[i])
            continue;
        const TargetEdges seen =
            target_edges(linear_photo(input.photos[i].image, camera), projector, input.target.board,
                         *poses[i], area, selection, static_cast<int>(i));
        edges.insert(edges.end(), seen.edges.begin(), seen.edges.end());
    }
    return edges;
}

void refuse(Characterisation& result, const std::string& quantity, const std::string& reason) {
    result.not_measured.push_back({quantity, reason});
}

// Written only where the file has a lens section: its wavelength cannot be measured here.
bool can_write_lens(const Characterisation& result) {
    return result.camera.lens.has_value() && !result.point_spread->sharpening.is_detected;
}

void take_defocus(Characterisation& result) {
    const DefocusEstimate& defocus = *result.defocus;
    const bool is_written = can_write_lens(result);
    const std::string how = fmt::format(
        "blur of {} edges against depth, {} degrees of freedom, {} nearer than focus, {} "
        "farther",
        defocus.edges, defocus.degrees_of_freedom, defocus.edges_nearer, defocus.edges_farther);
    result.values.push_back({"focus_distance_mm", "focus distance", "mm", defocus.focus_distance_mm,
                             defocus.focus_distance_standard_uncertainty_mm, how, is_written});
    result.values.push_back({"f_number", "f-number", "", defocus.f_number,
                             defocus.f_number_standard_uncertainty, how, is_written});
    if (!is_written)
        return;
    result.camera.lens->focus_distance_mm = defocus.focus_distance_mm;
    result.camera.lens->f_number = defocus.f_number;
    uncertainty_of(result).focus_distance_mm = defocus.focus_distance_standard_uncertainty_mm;
    uncertainty_of(result).f_number = defocus.f_number_standard_uncertainty;
}

void measure_defocus(const std::vector<StraightEdge>& edges, Characterisation& result) {
    const char* const what = "focus distance and f-number";
    if (result.camera.projection.kind == Projection::telecentric)
        return refuse(result, what, "the camera is telecentric");
    if (!(result.camera.sensor->pixel_pitch_um > 0.0))
        return refuse(result, what, "the camera file gives no pixel pitch");
    auto defocus = attempted([&] { return estimate_defocus(edges, result.camera); });
    if (!defocus || !defocus->is_determined)
        return refuse(result, "focus distance and f-number",
                      defocus ? defocus->undetermined : defocus.cause);
    result.defocus = *defocus;
}

void write_gaussian(Characterisation& result, double sigma, double uncertainty) {
    if (!can_write_lens(result) || !(sigma > 0.0))
        return;
    result.camera.lens->psf = {PointSpread::Kind::gaussian, sigma, {}};
    uncertainty_of(result).psf_sigma_px = uncertainty;
    uncertainty_of(result).psf_density.clear();
}

void write_measured(Characterisation& result) {
    result.camera.lens->psf = {PointSpread::Kind::measured, 0.0,
                               result.point_spread->measured->profile()};
    uncertainty_of(result).psf_sigma_px.reset();
    uncertainty_of(result).psf_density.clear();
    for (const ProfileRow& row : result.point_spread->measured->rows)
        uncertainty_of(result).psf_density.push_back(row.standard_uncertainty);
}

// With the defocus determined its own width at focus is written, which shares its covariance; a
// measured pattern holds the blur of the depths that were photographed, and stands only where that
// blur could not be told apart.
void take_point_spread(Characterisation& result) {
    const PointSpreadEstimate& spread = *result.point_spread;
    const bool is_measured =
        !result.defocus && !spread.gaussian_suffices && spread.measured && can_write_lens(result);
    const double sigma = result.defocus ? result.defocus->sigma_px : spread.gaussian.sigma_px;
    const double u = result.defocus ? result.defocus->sigma_standard_uncertainty_px
                                    : spread.gaussian.standard_uncertainty_px;
    result.values.push_back(
        {"psf_sigma_px", "psf sigma", "px", sigma, u,
         fmt::format("{} edges{}{}", spread.gaussian.edges,
                     result.defocus ? ", at focus" : ", defocus as the camera file has it",
                     is_measured ? "; a measured profile is written, which fits better" : ""),
         can_write_lens(result) && !is_measured && sigma > 0.0});
    if (is_measured)
        write_measured(result);
    else
        write_gaussian(result, sigma, u);
}

void remark_sharpening(Characterisation& result) {
    const Sharpening& sharpening = result.point_spread->sharpening;
    if (!sharpening.is_detected)
        return;
    result.not_measured.push_back(
        {"point spread",
         fmt::format(
             "the camera sharpens: edges overshoot by {:.1f} % +- {:.1f} % of their contrast "
             "(k = 2), undershoot {:.1f} %; switch it off",
             100.0 * sharpening.overshoot, 200.0 * sharpening.overshoot_standard_uncertainty,
             100.0 * sharpening.undershoot),
         true});
}

// For the eye only: what the fit of the defocus used all at once, in groups of equal size, of which
// a few edges each will do.
std::vector<BlurAtDepth> blur_by_depth(std::vector<StraightEdge> edges, CameraModel camera) {
    constexpr std::size_t groups = 10, edges_of_a_group = 7;
    camera.lens.reset();
    std::sort(edges.begin(), edges.end(),
              [](const auto& a, const auto& b) { return a.depth_term > b.depth_term; });
    std::vector<BlurAtDepth> result;
    for (std::size_t i = 0; i < groups; ++i) {
        const std::size_t first = edges.size() * i / groups, last = edges.size() * (i + 1) / groups;
        if (last - first < edges_of_a_group)
            continue;
        std::vector<StraightEdge> group;
        for (std::size_t k = 0; k < edges_of_a_group; ++k)
            group.push_back(edges[first + k * (last - first) / edges_of_a_group]);
        double depth = 0.0;
        for (const StraightEdge& edge : group)
            depth += 1.0 / edge.depth_term / static_cast<double>(group.size());
        const BlurWidth width = estimate_point_spread(group, camera).gaussian;
        result.push_back({depth, width.sigma_px, width.standard_uncertainty_px});
    }
    return result;
}

int zone_of(const CameraModel& camera, const Eigen::Vector2d& pixel) {
    const auto third = [](double at, int size) {
        return std::clamp(static_cast<int>(3.0 * (at + 0.5) / size), 0, 2);
    };
    return 3 * third(pixel.y(), camera.height) + third(pixel.x(), camera.width);
}

// The longest edge of each zone of the image whose angle to the pixels is one that ISO 12233 can
// use.
std::vector<const StraightEdge*> modulation_edges(const std::vector<StraightEdge>& edges,
                                                  const CameraModel& camera) {
    std::vector<const StraightEdge*> longest(max_mtf_edges, nullptr);
    for (const StraightEdge& edge : edges) {
        const double tangent =
            edge.normal.cwiseAbs().minCoeff() / edge.normal.cwiseAbs().maxCoeff();
        const double angle_deg = std::atan(tangent) * 57.29577951308232;
        if (angle_deg < 2.0 || angle_deg > 30.0 || edge.length_px < 16.0)
            continue;
        const StraightEdge*& best =
            longest[static_cast<std::size_t>(zone_of(camera, edge.centre_px))];
        if (!best || edge.length_px > best->length_px)
            best = &edge;
    }
    std::erase(longest, nullptr);
    return longest;
}

void measure_modulation(const CharacteriseInput& input,
                        const std::vector<std::optional<Rigid>>& poses, Characterisation& result) {
    EdgeSelection selection;
    selection.half_width_px = mtf_half_width_px;
    selection.least_half_width_px = 8.0;
    const std::vector<StraightEdge> edges = edges_of(input, poses, result.camera, selection);
    std::string last_error = "no edge of the target is 16 px long and wide at 2 to 30 degrees";
    for (const StraightEdge* edge : modulation_edges(edges, result.camera)) {
        auto slanted = attempted([&] { return slanted_edge(*edge); });
        if (slanted)
            result.modulation.push_back({input.photos[static_cast<std::size_t>(edge->photo)].name,
                                         edge->centre_px, *slanted});
        else
            last_error = slanted.cause;
    }
    if (result.modulation.empty())
        return refuse(result, "MTF", last_error);
    const Eigen::Vector2d middle(0.5 * (result.camera.width - 1), 0.5 * (result.camera.height - 1));
    const auto central = std::min_element(
        result.modulation.begin(), result.modulation.end(), [&](const auto& a, const auto& b) {
            return (a.centre_px - middle).norm() < (b.centre_px - middle).norm();
        });
    const SlantedEdge& edge = central->edge;
    const std::string how =
        fmt::format("ISO 12233, edge at ({:.0f}, {:.0f}) of {}, {:.1f} degrees",
                    central->centre_px.x(), central->centre_px.y(), central->photo, edge.angle_deg);
    if (edge.mtf50_cycles_per_px > 0.0)
        result.values.push_back({"mtf50_cycles_per_px", "MTF50", "cycles/px",
                                 edge.mtf50_cycles_per_px, edge.mtf50_standard_uncertainty, how,
                                 false});
    result.values.push_back({"mtf_at_nyquist", "MTF at Nyquist", "", edge.at_nyquist,
                             edge.at_nyquist_standard_uncertainty, how, false});
}

}  // namespace

void measure_blur(const CharacteriseInput& input, const std::vector<std::optional<Rigid>>& poses,
                  Characterisation& result) {
    if (result.photos_with_target == 0)
        return refuse(result, "point spread, defocus and MTF",
                      input.photos.empty() ? "no photos of the target"
                                           : "the target was found in none of the photos");
    try {
        const std::vector<StraightEdge> edges = edges_of(input, poses, result.camera, {});
        measure_defocus(edges, result);
        CameraModel focused = result.camera;
        if (result.defocus && focused.lens) {
            focused.lens->focus_distance_mm = result.defocus->focus_distance_mm;
            focused.lens->f_number = result.defocus->f_number;
        }
        result.point_spread = estimate_point_spread(edges, focused);
        result.point_spread->sharpening = measure_sharpening(
            edges_of(input, poses, result.camera, {.with_clipped = true}), focused);
        remark_sharpening(result);
        if (result.defocus) {
            take_defocus(result);
            result.blur_by_depth = blur_by_depth(edges, result.camera);
        }
        take_point_spread(result);
        if (!result.camera.lens)
            result.remarks.push_back(
                "the camera file has no lens section (f_number, focus_distance_mm, wavelength_nm; "
                "estimates will do): f-number, focus and point spread have no place to be written");
    } catch (const NumericalError& error) {
        refuse(result, "point spread", error.what());
    }
    measure_modulation(input, poses, result);
}

}  // namespace etalon
