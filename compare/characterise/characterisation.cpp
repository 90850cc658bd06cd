#include "compare/characterise/characterisation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "compare/detect/detector.h"
#include "compare/photometric/compared_area.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

CameraUncertainty& uncertainty_of(Characterisation& result) {
    if (!result.camera.standard_uncertainty)
        result.camera.standard_uncertainty.emplace();
    return *result.camera.standard_uncertainty;
}

void note_missing(Characterisation& result, const std::string& quantity,
                  const std::string& reason) {
    result.not_measured.push_back({quantity, reason});
}

// Runs one measurement; what it cannot use is noted and the others go on.
void attempt(Characterisation& result, const std::string& quantity,
             const std::function<void()>& measure) {
    if (const auto measured = attempted(measure); !measured)
        result.not_measured.push_back({quantity, measured.cause, true});
}

void measure_black(const CharacteriseInput& input, Characterisation& result) {
    if (input.darks.empty())
        return note_missing(result, "black level", "no dark photos");
    attempt(result, "black level", [&] {
        const BlackLevel black = measure_black_level(input.darks);
        result.black = black;
        result.camera.sensor->black_dn = black.dn;
        uncertainty_of(result).black_dn = black.standard_uncertainty_dn;
        result.values.push_back({"black_dn", "black", "DN", black.dn, black.standard_uncertainty_dn,
                                 fmt::format("mean of {} dark photos", black.frames), true});
    });
}

void measure_transfer(const CharacteriseInput& input, Characterisation& result) {
    if (input.exposures.empty())
        return note_missing(result, "transfer curve", "no exposure series");
    attempt(result, "transfer curve", [&] {
        const double u_black = result.camera.standard_uncertainty
                                   ? result.camera.standard_uncertainty->black_dn.value_or(0.0)
                                   : 0.0;
        const TransferEstimate estimate =
            estimate_transfer(input.exposures, *result.camera.sensor, u_black);
        result.transfer = estimate;
        result.camera.sensor->transfer = estimate.transfer;
        uncertainty_of(result).transfer_code = estimate.code_standard_uncertainty;
        result.values.push_back(
            {"nonlinearity_percent", "nonlinearity", "%", 100.0 * estimate.nonlinearity,
             100.0 * estimate.nonlinearity_standard_uncertainty,
             fmt::format("{} patches in {} photos, largest departure from a straight line",
                         estimate.patches, estimate.photos),
             false});
        if (!estimate.light_drift)
            result.remarks.push_back(
                "no exposure time was repeated: a drift of the light would be taken for a property "
                "of the transfer curve");
    });
}

// The repeats, and photographs of the series with equal exposure times.
std::vector<RepeatedView> repeated_views(const CharacteriseInput& input) {
    std::vector<RepeatedView> views;
    if (!input.repeats.empty())
        views.push_back(input.repeats);
    std::map<double, RepeatedView> by_time;
    for (const ExposedPhoto& photo : input.exposures)
        by_time[photo.exposure_us].push_back(photo.image);
    for (const auto& [time, view] : by_time)
        if (view.size() > 1)
            views.push_back(view);
    return views;
}

void take_read_noise(Characterisation& result) {
    const PhotonTransfer& photon = *result.photon_transfer;
    if (!photon.read_noise_e) {
        result.not_measured.push_back({"read noise", photon.read_noise_remark});
        return;
    }
    result.camera.sensor->read_noise_e = *photon.read_noise_e;
    uncertainty_of(result).read_noise_e = photon.read_noise_standard_uncertainty_e;
    result.values.push_back({"read_noise_e", "read noise", "e", *photon.read_noise_e,
                             photon.read_noise_standard_uncertainty_e,
                             "photon transfer at signal 0", true});
}

// The same curve, wrong by its uncertainty everywhere at once. The ends are no estimates.
Transfer displaced(Transfer transfer, const std::vector<double>& uncertainties) {
    for (std::size_t i = 1; i + 1 < transfer.table.size(); ++i)
        transfer.table[i].second -= uncertainties[i];
    return transfer;
}

// Linear signals inherit what is not known of the curve: its share of gain and read
// noise is what displacing the curve changes.
void add_transfer_uncertainty(const std::vector<RepeatedView>& views,
                              const Characterisation& result, PhotonTransfer& photon) {
    if (!result.transfer || result.transfer->code_standard_uncertainty.empty())
        return;
    CameraModel camera = result.camera;
    camera.sensor->transfer =
        displaced(camera.sensor->transfer, result.transfer->code_standard_uncertainty);
    const PhotonTransfer other = measure_photon_transfer(views, camera, result.black);
    const Eigen::Vector2d change(other.gain_e_per_dn - photon.gain_e_per_dn,
                                 photon.read_noise_e && other.read_noise_e
                                     ? *other.read_noise_e - *photon.read_noise_e
                                     : 0.0);
    photon.covariance += change * change.transpose();
    photon.gain_standard_uncertainty = std::sqrt(photon.covariance(0, 0));
    photon.read_noise_standard_uncertainty_e = std::sqrt(photon.covariance(1, 1));
}

void measure_noise(const CharacteriseInput& input, Characterisation& result) {
    const std::vector<RepeatedView> views = repeated_views(input);
    if (views.empty())
        return note_missing(result, "gain and read noise", "no repeats of one view");
    if (!input.lossy_file.empty()) {
        result.not_measured.push_back(
            {"gain and read noise",
             input.lossy_file + " is a JPEG file: compression changes the noise", true});
        return;
    }
    attempt(result, "gain and read noise", [&] {
        PhotonTransfer photon = measure_photon_transfer(views, result.camera, result.black);
        add_transfer_uncertainty(views, result, photon);
        result.photon_transfer = photon;
        result.camera.sensor->gain_e_per_dn = photon.gain_e_per_dn;
        uncertainty_of(result).gain_e_per_dn = photon.gain_standard_uncertainty;
        result.values.push_back({"gain_e_per_dn", "gain", "e/DN", photon.gain_e_per_dn,
                                 photon.gain_standard_uncertainty,
                                 fmt::format("photon transfer, {} degrees of freedom, reduced "
                                             "chi-square {:.2f}",
                                             photon.degrees_of_freedom, photon.reduced_chi_square),
                                 true});
        take_read_noise(result);
    });
}

// Where the target is in each photograph; nothing where it is not seen.
std::vector<std::optional<Rigid>> target_poses(const CharacteriseInput& input,
                                               const Projector& projector,
                                               Characterisation& result) {
    std::vector<std::optional<Rigid>> poses;
    for (const NamedPhoto& photo : input.photos) {
        poses.emplace_back();
        const auto [view, reason, shown_as] = observe(input.target, photo.image);
        const auto pose =
            view ? estimate_pose(projector, view->points_mm, view->pixels) : std::nullopt;
        if (!pose) {
            result.remarks.push_back(fmt::format("{}: the target was not found: not used{}{}",
                                                 photo.name, reason.empty() ? "" : "; ", reason));
            continue;
        }
        if (pose->reprojection_rms_px > 2.0) {
            result.remarks.push_back(
                fmt::format("{}: the calibration misses the target's points by {:.1f} px RMS: not "
                            "used",
                            photo.name, pose->reprojection_rms_px));
            continue;
        }
        poses.back() = pose->camera_from_marker;
        ++result.photos_with_target;
    }
    return poses;
}

std::vector<WhitePatch> white_patches(const CharacteriseInput& input, const Projector& projector,
                                      const std::vector<std::optional<Rigid>>& poses,
                                      const Characterisation& result) {
    std::vector<WhitePatch> patches;
    const auto add = [&patches](const std::vector<WhitePatch>& more) {
        patches.insert(patches.end(), more.begin(), more.end());
    };
    for (std::size_t i = 0; i < input.flats.size(); ++i)
        add(flat_patches(input.flats[i].image, result.camera, static_cast<int>(i),
                         input.flats[i].name));
    for (std::size_t i = 0; input.flats.empty() && i < input.photos.size(); ++i)
        if (poses[i])
            add(white_cell_patches(input.photos[i].image, projector, input.target.board, *poses[i],
                                   static_cast<int>(i)));
    return patches;
}

void write_illumination(Characterisation& result) {
    const IlluminationEstimate& estimate = *result.illumination;
    result.camera.sensor->illumination = estimate.illumination;
    uncertainty_of(result).illumination.reset();
    if (estimate.illumination.kind == Illumination::Kind::polynomial)
        uncertainty_of(result).illumination = estimate.standard_uncertainty;
}

void measure_illumination(const CharacteriseInput& input, const Projector& projector,
                          const std::vector<std::optional<Rigid>>& poses,
                          Characterisation& result) {
    if (input.flats.empty() && result.photos_with_target == 0)
        return note_missing(result, "relative illumination", "neither flat photos nor a target");
    const std::size_t failures = result.not_measured.size();
    attempt(result, "relative illumination", [&] {
        result.illumination =
            estimate_illumination(white_patches(input, projector, poses, result), result.camera);
        result.illumination_from = input.flats.empty() ? "white squares of the target" : "flats";
        write_illumination(result);
        const IlluminationEstimate& estimate = *result.illumination;
        result.values.push_back(
            {"illumination_at_corner", "illumination at the corner", "", estimate.at_corner,
             estimate.at_corner_standard_uncertainty,
             fmt::format("{} patches in {} photos ({}), {} degrees of freedom", estimate.patches,
                         estimate.photos, result.illumination_from, estimate.degrees_of_freedom),
             true});
    });
    // The target's photographs were not taken for this: that they do not do is no fault of theirs.
    if (input.flats.empty() && result.not_measured.size() > failures)
        result.not_measured.back().was_refused = false;
}

// The blur: defocus, point spread and modulation along the target's edges.

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
    constexpr char what[] = "focus distance and f-number";
    if (result.camera.projection.kind == Projection::telecentric)
        return note_missing(result, what, "the camera is telecentric");
    if (!(result.camera.sensor->pixel_pitch_um > 0.0))
        return note_missing(result, what, "the camera file gives no pixel pitch");
    auto defocus = attempted([&] { return estimate_defocus(edges, result.camera); });
    if (!defocus || !defocus->is_determined)
        return note_missing(result, what, defocus ? defocus->undetermined : defocus.cause);
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
    PointSpread& psf = result.camera.lens->psf;
    psf = {PointSpread::Kind::measured, 0.0, {}};
    uncertainty_of(result).psf_sigma_px.reset();
    uncertainty_of(result).psf_density.clear();
    for (const ProfileRow& row : result.point_spread->measured->rows) {
        psf.profile.emplace_back(row.radius_px, row.density);
        uncertainty_of(result).psf_density.push_back(row.standard_uncertainty);
    }
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
        const BlurWidth width = estimate_gaussian(group, camera);
        result.push_back({depth, width.sigma_px, width.standard_uncertainty_px});
    }
    return result;
}

// The longest edge of each zone of the image whose angle to the pixels is one that ISO 12233 can
// use.
std::vector<const StraightEdge*> modulation_edges(const std::vector<StraightEdge>& edges,
                                                  const CameraModel& camera) {
    std::vector<const StraightEdge*> longest(max_mtf_edges, nullptr);
    for (const StraightEdge& edge : edges) {
        const double tangent =
            edge.normal.cwiseAbs().minCoeff() / edge.normal.cwiseAbs().maxCoeff();
        const double angle_deg = std::atan(tangent) * 180.0 / std::numbers::pi;
        if (angle_deg < 2.0 || angle_deg > 30.0 || edge.length_px < 16.0)
            continue;
        const StraightEdge*& best = longest[image_zone(camera, edge.centre_px)];
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
        return note_missing(result, "MTF", last_error);
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

// Adds focus distance, f-number, point spread and MTF to `result`, or why not.
void measure_blur(const CharacteriseInput& input, const std::vector<std::optional<Rigid>>& poses,
                  Characterisation& result) {
    if (result.photos_with_target == 0)
        return note_missing(result, "point spread, defocus and MTF",
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
        note_missing(result, "point spread", error.what());
    }
    measure_modulation(input, poses, result);
}

// Of a camera that does not say them: those of its photographs, whatever they are for.
int bits_of(const CharacteriseInput& input) {
    std::vector<int> bits;
    for (const auto* photos : {&input.photos, &input.flats})
        for (const NamedPhoto& photo : *photos)
            bits.push_back(photo.image.bits);
    for (const auto* images : {&input.repeats, &input.darks})
        for (const CodeImage& image : *images)
            bits.push_back(image.bits);
    for (const ExposedPhoto& photo : input.exposures)
        bits.push_back(photo.image.bits);
    if (bits.empty())
        return Sensor{}.bits;
    const auto [fewest, most] = std::minmax_element(bits.begin(), bits.end());
    if (*fewest != *most)
        throw NumericalError(
            fmt::format("photographs of {} and of {} bits: say in the camera file's sensor section "
                        "how many it has",
                        *fewest, *most));
    return bits.front();
}

}  // namespace

bool Characterisation::was_anything_refused() const {
    return std::any_of(not_measured.begin(), not_measured.end(),
                       [](const NotMeasured& n) { return n.was_refused; });
}

Characterisation characterise(const CharacteriseInput& input) {
    Characterisation result;
    result.camera = input.camera;
    if (!result.camera.sensor)
        result.camera.sensor = Sensor{.bits = bits_of(input)};
    measure_black(input, result);
    measure_transfer(input, result);
    measure_noise(input, result);
    const Projector projector(result.camera);
    const std::vector<std::optional<Rigid>> poses = target_poses(input, projector, result);
    measure_illumination(input, Projector(result.camera), poses, result);
    measure_blur(input, poses, result);
    return result;
}

}  // namespace etalon
