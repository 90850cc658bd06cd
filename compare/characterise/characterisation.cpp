#include "compare/characterise/characterisation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "compare/detect/detector.h"
#include "compare/photometric/compared_area.h"
#include "core/program/errors.h"

namespace etalon {

CameraUncertainty& uncertainty_of(Characterisation& result) {
    if (!result.camera.standard_uncertainty)
        result.camera.standard_uncertainty.emplace();
    return *result.camera.standard_uncertainty;
}

namespace {

// Runs one measurement; what it cannot use is noted and the others go on.
void attempt(Characterisation& result, const std::string& quantity,
             const std::function<void()>& measure) {
    if (const auto measured = attempted(measure); !measured)
        result.not_measured.push_back({quantity, measured.cause, true});
}

void measure_black(const CharacteriseInput& input, Characterisation& result) {
    if (input.darks.empty()) {
        result.not_measured.push_back({"black level", "no dark photos"});
        return;
    }
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
    if (input.exposures.empty()) {
        result.not_measured.push_back({"transfer curve", "no exposure series"});
        return;
    }
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

// ResidualsAndJacobian signals inherit what is not known of the curve: its share of gain and read
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
    if (views.empty()) {
        result.not_measured.push_back({"gain and read noise", "no repeats of one view"});
        return;
    }
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
    if (input.flats.empty() && result.photos_with_target == 0) {
        result.not_measured.push_back(
            {"relative illumination", "neither flat photos nor a target"});
        return;
    }
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
