#include "compare/characterise/characterisation.h"

#include <fmt/format.h>

#include "compare/detect/detector.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double mtf_half_width_px = 12.0;
constexpr std::size_t max_mtf_edges = 9;  // one a zone of the image

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

// For a plot: groups of equal size in depth, a few edges of each.
std::vector<BlurAtDepth> blur_by_depth(std::vector<StraightEdge> edges, CameraModel camera) {
    constexpr std::size_t groups = 10, edges_of_a_group = 7;
    camera.lens.reset();
    std::ranges::sort(edges, std::greater(), &StraightEdge::depth_term);
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

// The longest edge of each zone of the image at an angle that ISO 12233 can use.
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

// The measurements, each of which writes into the result.
class Measurement {
public:
    Measurement(const CharacteriseInput& input, Characterisation& result)
        : input_(input), result_(result), camera_(result.camera) {}

    void black() {
        if (input_.darks.empty())
            return note_missing("black level", "no dark photos");
        attempt("black level", [&] {
            const BlackLevel black = measure_black_level(input_.darks);
            result_.black = black;
            camera_.sensor->black_dn = black.dn;
            uncertainty().black_dn = black.standard_uncertainty_dn;
            result_.values.push_back({"black_dn", "black", "DN", black.dn,
                                      black.standard_uncertainty_dn,
                                      fmt::format("mean of {} dark photos", black.frames), true});
        });
    }

    void transfer() {
        if (input_.exposures.empty())
            return note_missing("transfer curve", "no exposure series");
        attempt("transfer curve", [&] {
            const auto& known = camera_.standard_uncertainty;
            const TransferEstimate estimate = estimate_transfer(
                input_.exposures, *camera_.sensor, known ? known->black_dn.value_or(0.0) : 0.0);
            result_.transfer = estimate;
            camera_.sensor->transfer = estimate.transfer;
            uncertainty().transfer_code = estimate.code_standard_uncertainty;
            result_.values.push_back(
                {"nonlinearity_percent", "nonlinearity", "%", 100.0 * estimate.nonlinearity,
                 100.0 * estimate.nonlinearity_standard_uncertainty,
                 fmt::format("{} patches in {} photos, largest departure from a straight line",
                             estimate.patches, estimate.photos)});
            if (!estimate.light_drift)
                result_.remarks.push_back(
                    "no exposure time was repeated: a drift of the light would be taken for a "
                    "property of the transfer curve");
        });
    }

    void noise() {
        const char* what = "gain and read noise";
        const std::vector<RepeatedView> views = repeated_views(input_);
        if (views.empty())
            return note_missing(what, "no repeats of one view");
        if (!input_.lossy_file.empty())
            return refuse(what,
                          input_.lossy_file + " is a JPEG file: compression changes the noise");
        attempt(what, [&] {
            PhotonTransfer photon = measure_photon_transfer(views, camera_, result_.black);
            add_transfer_uncertainty(views, photon);
            result_.photon_transfer = photon;
            camera_.sensor->gain_e_per_dn = photon.gain_e_per_dn;
            uncertainty().gain_e_per_dn = photon.gain_standard_uncertainty;
            result_.values.push_back(
                {"gain_e_per_dn", "gain", "e/DN", photon.gain_e_per_dn,
                 photon.gain_standard_uncertainty,
                 fmt::format("photon transfer, {} degrees of freedom, reduced chi-square {:.2f}",
                             photon.degrees_of_freedom, photon.reduced_chi_square),
                 true});
            if (!photon.read_noise_e)
                return note_missing("read noise", photon.read_noise_remark);
            camera_.sensor->read_noise_e = *photon.read_noise_e;
            uncertainty().read_noise_e = photon.read_noise_standard_uncertainty_e;
            result_.values.push_back({"read_noise_e", "read noise", "e", *photon.read_noise_e,
                                      photon.read_noise_standard_uncertainty_e,
                                      "photon transfer at signal 0", true});
        });
    }

    // Where the target is in each photograph; nothing where it is not seen.
    void find_target() {
        const Projector projector(camera_);
        for (const NamedPhoto& photo : input_.photos) {
            poses_.emplace_back();
            const auto [view, reason, shown_as] = observe(input_.target, photo.image);
            const auto pose =
                view ? estimate_pose(projector, view->points_mm, view->pixels) : std::nullopt;
            if (!pose) {
                result_.remarks.push_back(fmt::format("{}: the target was not found: not used{}{}",
                                                      photo.name, reason.empty() ? "" : "; ",
                                                      reason));
                continue;
            }
            if (pose->reprojection_rms_px > 2.0) {
                result_.remarks.push_back(fmt::format(
                    "{}: the calibration misses the target's points by {:.1f} px RMS: not used",
                    photo.name, pose->reprojection_rms_px));
                continue;
            }
            poses_.back() = pose->camera_from_marker;
            ++result_.photos_with_target;
        }
    }

    void illumination() {
        const char* what = "relative illumination";
        if (input_.flats.empty() && result_.photos_with_target == 0)
            return note_missing(what, "neither flat photos nor a target");
        const std::size_t failures = result_.not_measured.size();
        attempt(what, [&] {
            const IlluminationEstimate estimate = estimate_illumination(white_patches(), camera_);
            result_.illumination = estimate;
            result_.illumination_from =
                input_.flats.empty() ? "white squares of the target" : "flats";
            camera_.sensor->illumination = estimate.illumination;
            uncertainty().illumination.reset();
            if (estimate.illumination.kind == Illumination::Kind::polynomial)
                uncertainty().illumination = estimate.standard_uncertainty;
            result_.values.push_back(
                {"illumination_at_corner", "illumination at the corner", "", estimate.at_corner,
                 estimate.at_corner_standard_uncertainty,
                 fmt::format("{} patches in {} photos ({}), {} degrees of freedom",
                             estimate.patches, estimate.photos, result_.illumination_from,
                             estimate.degrees_of_freedom),
                 true});
        });
        // The target's photographs were not taken for this: that they do not do is no fault.
        if (input_.flats.empty() && result_.not_measured.size() > failures)
            result_.not_measured.back().was_refused = false;
    }

    // Focus distance, f-number, point spread and MTF along the target's edges.
    void blur() {
        if (result_.photos_with_target == 0)
            return note_missing("point spread, defocus and MTF",
                                input_.photos.empty()
                                    ? "no photos of the target"
                                    : "the target was found in none of the photos");
        try {
            const std::vector<StraightEdge> edges = edges_of_target({});
            estimate_focus(edges);
            CameraModel focused = camera_;
            if (result_.defocus && focused.lens) {
                focused.lens->focus_distance_mm = result_.defocus->focus_distance_mm;
                focused.lens->f_number = result_.defocus->f_number;
            }
            result_.point_spread = estimate_point_spread(edges, focused);
            result_.point_spread->sharpening =
                measure_sharpening(edges_of_target({.with_clipped = true}), focused);
            remark_sharpening();
            if (result_.defocus) {
                take_defocus();
                result_.blur_by_depth = blur_by_depth(edges, camera_);
            }
            take_point_spread();
            if (!camera_.lens)
                result_.remarks.push_back(
                    "the camera file has no lens section (f_number, focus_distance_mm, "
                    "wavelength_nm; estimates will do): f-number, focus and point spread have no "
                    "place to be written");
        } catch (const NumericalError& error) {
            note_missing("point spread", error.what());
        }
        modulation();
    }

private:
    CameraUncertainty& uncertainty() {
        if (!camera_.standard_uncertainty)
            camera_.standard_uncertainty.emplace();
        return *camera_.standard_uncertainty;
    }

    void note_missing(const std::string& quantity, const std::string& reason) {
        result_.not_measured.push_back({quantity, reason});
    }

    void refuse(const std::string& quantity, const std::string& reason) {
        result_.not_measured.push_back({quantity, reason, true});
    }

    // What a measurement cannot use is noted and the others go on.
    void attempt(const std::string& quantity, const std::function<void()>& measure) {
        if (const auto measured = attempted(measure); !measured)
            refuse(quantity, measured.cause);
    }

    // What is not known of the transfer curve: its part of gain and read noise is what the same
    // curve changes, wrong by its uncertainty everywhere but at its ends.
    void add_transfer_uncertainty(const std::vector<RepeatedView>& views, PhotonTransfer& photon) {
        if (!result_.transfer || result_.transfer->code_standard_uncertainty.empty())
            return;
        CameraModel camera = camera_;
        auto& table = camera.sensor->transfer.table;
        for (std::size_t i = 1; i + 1 < table.size(); ++i)
            table[i].second -= result_.transfer->code_standard_uncertainty[i];
        const PhotonTransfer other = measure_photon_transfer(views, camera, result_.black);
        const Eigen::Vector2d change(other.gain_e_per_dn - photon.gain_e_per_dn,
                                     photon.read_noise_e && other.read_noise_e
                                         ? *other.read_noise_e - *photon.read_noise_e
                                         : 0.0);
        photon.covariance += change * change.transpose();
        photon.gain_standard_uncertainty = std::sqrt(photon.covariance(0, 0));
        photon.read_noise_standard_uncertainty_e = std::sqrt(photon.covariance(1, 1));
    }

    std::vector<WhitePatch> white_patches() const {
        std::vector<WhitePatch> patches;
        const auto add = [&patches](const std::vector<WhitePatch>& more) {
            patches.insert(patches.end(), more.begin(), more.end());
        };
        for (std::size_t i = 0; i < input_.flats.size(); ++i)
            add(flat_patches(input_.flats[i].image, camera_, static_cast<int>(i),
                             input_.flats[i].name));
        const Projector projector(camera_);
        for (std::size_t i = 0; input_.flats.empty() && i < input_.photos.size(); ++i)
            if (poses_[i])
                add(white_cell_patches(input_.photos[i].image, projector, input_.target.board.grid,
                                       *poses_[i], static_cast<int>(i)));
        return patches;
    }

    std::vector<StraightEdge> edges_of_target(const EdgeSelection& selection) const {
        const Projector projector(camera_);
        const ComparedArea area = compared_area(input_.target.board, {}, "--target");
        std::vector<StraightEdge> edges;
        for (std::size_t i = 0; i < input_.photos.size(); ++i) {
            if (!poses_[i])
                continue;
            const std::vector<StraightEdge> seen = target_edges(
                linear_photo(input_.photos[i].image, camera_), projector, input_.target.board.grid,
                *poses_[i], area, selection, static_cast<int>(i));
            edges.insert(edges.end(), seen.begin(), seen.end());
        }
        return edges;
    }

    // Written only where the file has a lens section: its wavelength cannot be measured here.
    bool can_write_lens() const {
        return camera_.lens.has_value() && !result_.point_spread->sharpening.is_detected;
    }

    void estimate_focus(const std::vector<StraightEdge>& edges) {
        const char* what = "focus distance and f-number";
        if (camera_.projection.kind == Projection::telecentric)
            return note_missing(what, "the camera is telecentric");
        if (!(camera_.sensor->pixel_pitch_um > 0.0))
            return note_missing(what, "the camera file gives no pixel pitch");
        auto defocus = attempted([&] { return estimate_defocus(edges, camera_); });
        if (!defocus || !defocus->is_determined)
            return note_missing(what, defocus ? defocus->undetermined : defocus.cause);
        result_.defocus = *defocus;
    }

    void take_defocus() {
        const DefocusEstimate& defocus = *result_.defocus;
        const bool is_written = can_write_lens();
        const std::string how = fmt::format(
            "blur of {} edges against depth, {} degrees of freedom, {} nearer than focus, {} "
            "farther",
            defocus.edges, defocus.degrees_of_freedom, defocus.edges_nearer, defocus.edges_farther);
        result_.values.push_back({"focus_distance_mm", "focus distance", "mm",
                                  defocus.focus_distance_mm,
                                  defocus.focus_distance_standard_uncertainty_mm, how, is_written});
        result_.values.push_back({"f_number", "f-number", "", defocus.f_number,
                                  defocus.f_number_standard_uncertainty, how, is_written});
        if (!is_written)
            return;
        camera_.lens->focus_distance_mm = defocus.focus_distance_mm;
        camera_.lens->f_number = defocus.f_number;
        uncertainty().focus_distance_mm = defocus.focus_distance_standard_uncertainty_mm;
        uncertainty().f_number = defocus.f_number_standard_uncertainty;
    }

    // With the defocus determined its own width at focus is written. A measured pattern holds the
    // blur of the photographed depths: only where that could not be told apart.
    void take_point_spread() {
        const PointSpreadEstimate& spread = *result_.point_spread;
        const bool can_write = can_write_lens();
        const bool is_measured =
            !result_.defocus && !spread.gaussian_suffices && spread.measured && can_write;
        const double sigma = result_.defocus ? result_.defocus->sigma_px : spread.gaussian.sigma_px;
        const double u = result_.defocus ? result_.defocus->sigma_standard_uncertainty_px
                                         : spread.gaussian.standard_uncertainty_px;
        result_.values.push_back(
            {"psf_sigma_px", "psf sigma", "px", sigma, u,
             fmt::format("{} edges{}{}", spread.gaussian.edges,
                         result_.defocus ? ", at focus" : ", defocus as the camera file has it",
                         is_measured ? "; a measured profile is written, which fits better" : ""),
             can_write && !is_measured && sigma > 0.0});
        if (!is_measured && !(can_write && sigma > 0.0))
            return;
        PointSpread& psf = camera_.lens->psf;
        psf = {is_measured ? PointSpread::Kind::measured : PointSpread::Kind::gaussian,
               is_measured ? 0.0 : sigma,
               {}};
        uncertainty().psf_density.clear();
        uncertainty().psf_sigma_px = is_measured ? std::nullopt : std::optional(u);
        for (std::size_t i = 0; is_measured && i < spread.measured->rows.size(); ++i) {
            const ProfileRow& row = spread.measured->rows[i];
            psf.profile.emplace_back(row.radius_px, row.density);
            uncertainty().psf_density.push_back(row.standard_uncertainty);
        }
    }

    void remark_sharpening() {
        const Sharpening& sharpening = result_.point_spread->sharpening;
        if (sharpening.is_detected)
            refuse("point spread",
                   fmt::format("the camera sharpens: edges overshoot by {:.1f} % +- {:.1f} % of "
                               "their contrast (k = 2), undershoot {:.1f} %; switch it off",
                               100.0 * sharpening.overshoot,
                               200.0 * sharpening.overshoot_standard_uncertainty,
                               100.0 * sharpening.undershoot));
    }

    void modulation() {
        const std::vector<StraightEdge> edges =
            edges_of_target({.half_width_px = mtf_half_width_px, .least_half_width_px = 8.0});
        std::string last_error = "no edge of the target is 16 px long and wide at 2 to 30 degrees";
        for (const StraightEdge* edge : modulation_edges(edges, camera_)) {
            auto slanted = attempted([&] { return slanted_edge(*edge); });
            if (slanted)
                result_.modulation.push_back(
                    {input_.photos[static_cast<std::size_t>(edge->photo)].name, edge->centre_px,
                     *slanted});
            else
                last_error = slanted.cause;
        }
        if (result_.modulation.empty())
            return note_missing("MTF", last_error);
        const Eigen::Vector2d middle(0.5 * (camera_.width - 1), 0.5 * (camera_.height - 1));
        const auto central = std::ranges::min_element(
            result_.modulation, {},
            [&](const EdgeModulation& one) { return (one.centre_px - middle).norm(); });
        const SlantedEdge& edge = central->edge;
        const std::string how = fmt::format(
            "ISO 12233, edge at ({:.0f}, {:.0f}) of {}, {:.1f} degrees", central->centre_px.x(),
            central->centre_px.y(), central->photo, edge.angle_deg);
        if (edge.mtf50_cycles_per_px > 0.0)
            result_.values.push_back({"mtf50_cycles_per_px", "MTF50", "cycles/px",
                                      edge.mtf50_cycles_per_px, edge.mtf50_standard_uncertainty,
                                      how});
        result_.values.push_back({"mtf_at_nyquist", "MTF at Nyquist", "", edge.at_nyquist,
                                  edge.at_nyquist_standard_uncertainty, how});
    }

    const CharacteriseInput& input_;
    Characterisation& result_;
    CameraModel& camera_;                      // the result's
    std::vector<std::optional<Rigid>> poses_;  // by photograph
};

}  // namespace

bool Characterisation::was_anything_refused() const {
    return std::ranges::any_of(not_measured, &NotMeasured::was_refused);
}

Characterisation characterise(const CharacteriseInput& input) {
    Characterisation result;
    result.camera = input.camera;
    if (!result.camera.sensor)
        result.camera.sensor = Sensor{.bits = bits_of(input)};
    Measurement measurement(input, result);
    measurement.black();
    measurement.transfer();
    measurement.noise();
    measurement.find_target();
    measurement.illumination();
    measurement.blur();
    return result;
}

}  // namespace etalon
