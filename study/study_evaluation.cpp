#include "study/study_evaluation.h"

namespace etalon {
namespace {

// What an image shows of the switches: poses are estimated with the others.
StudySwitches seen_in_images(StudySwitches switches) {
    switches.erase(StudySwitch::half_pixel);
    switches.erase(StudySwitch::undistortion);
    return switches;
}

bool disturbs_radiance(const Disturbances& d) {
    Disturbances before_sensor = d;
    before_sensor.jpeg_quality = Disturbances{}.jpeg_quality;
    return std::ranges::any_of(disturbance_axes, [&](const DisturbanceAxis& axis) {
        return before_sensor.*axis.value != axis.neutral();
    });
}

}  // namespace

std::vector<StudyVariant> study_variants(const StudyFile& study,
                                         const std::vector<std::string>& ablations) {
    std::vector<StudyVariant> variants{{"as is", study.switched}};
    for (const std::string& name : ablations) {
        if (std::ranges::count(ablations, name) > 1)
            throw ConfigError({"--ablate"}, "names " + name + " twice");
        StudyVariant variant{name, study.switched};
        toggle(variant.switches, parse_study_switch(name, {"--ablate"}));
        imaging_camera(study.camera, variant.switches, {"--ablate"});
        variants.push_back(variant);
    }
    return variants;
}

void StudyTimes::add(const StudyTimes& other) {
    render += other.render;
    sensor += other.sensor;
    estimate += other.estimate;
    detectors.resize(std::max(detectors.size(), other.detectors.size()));
    for (std::size_t i = 0; i < other.detectors.size(); ++i)
        detectors[i] += other.detectors[i];
}

StudyOptics::StudyOptics(const StudyFile& study, std::vector<StudyVariant> variants)
    : study_(study), variants_(std::move(variants)), true_projector_(study.camera) {
    photometric_.resize(variants_.size() * study_.detectors.size());
    for (std::size_t variant = 0; variant < variants_.size(); ++variant) {
        add_imaging(variant);
        projectors_.emplace_back(
            etalon::estimation_camera(study_.camera, variants_[variant].switches));
        add_photometric(variant);
    }
    const auto uses = [&](bool sharp) {
        return std::ranges::any_of(imagings_, [&](const auto& i) { return i.sharp == sharp; });
    };
    if (uses(true)) {
        CameraModel sharp = study_.camera;
        sharp.lens.reset();
        sharp_.emplace_back(sharp);
    }
    if (uses(false) && study_.focus_mm.empty())
        lens_.emplace_back(study_.camera);
    for (const double focus_mm : study_.focus_mm)
        if (uses(false)) {
            CameraModel focused = study_.camera;
            focused.lens->focus_distance_mm = focus_mm;
            lens_.emplace_back(focused);
        }
}

void StudyOptics::add_imaging(std::size_t variant) {
    const StudySwitches seen = seen_in_images(variants_[variant].switches);
    for (Imaging& imaging : imagings_)
        if (seen == seen_in_images(variants_[imaging.variants.front()].switches))
            return imaging.variants.push_back(variant);
    const CameraModel camera = imaging_camera(study_.camera, seen, {study_.id});
    SensorModel sensor(camera);
    Disturber disturber(camera, sensor);
    imagings_.push_back({camera,
                         std::move(sensor),
                         std::move(disturber),
                         seen.contains(StudySwitch::blur),
                         {variant}});
}

void StudyOptics::add_photometric(std::size_t variant) {
    const StudySwitches& switches = variants_[variant].switches;
    const CameraModel camera =
        etalon::estimation_camera(imaging_camera(study_.camera, switches, {study_.id}), switches);
    for (std::size_t i = 0; i < study_.detectors.size(); ++i)
        if (study_.detectors[i].detector == "photometric")
            photometric_[variant * study_.detectors.size() + i] =
                std::make_unique<const PhotometricDetector>(camera, study_.detectors[i].marker,
                                                            study_.detectors[i].name);
}

RenderedPart StudyOptics::radiance(const Marker& marker, const StudyPose& pose, bool sharp) const {
    const Renderer& renderer = sharp ? sharp_.front() : lens_.at(pose.focus);
    RenderedPart part =
        renderer.render_part({{{marker.grid, pose.camera_from_marker}}, study_.background});
    if (study_.white_level != 1.0) {
        part.radiance = part.radiance * study_.white_level;
        part.background *= study_.white_level;
    }
    return part;
}

CodeImage StudyOptics::image(const RenderedPart& radiance, const Marker& marker,
                             const StudyPose& pose, const Imaging& imaging) const {
    const NoiseKey key{study_.poses.seed, static_cast<std::uint32_t>(pose.index)};
    const bool has_noise = imaging.camera.sensor && imaging.camera.sensor->gain_e_per_dn > 0.0;
    const std::optional<NoiseKey> noise = has_noise ? std::optional(key) : std::nullopt;
    if (!disturbs_radiance(pose.disturbances))
        return compressed(imaging.sensor.expose(radiance, noise), pose.disturbances.jpeg_quality);
    const cv::Rect all(0, 0, imaging.camera.width, imaging.camera.height);
    const Radiance disturbed = imaging.disturber.disturbed(
        radiance.within(all), {marker.grid, pose.camera_from_marker}, pose.disturbances, key);
    return compressed(imaging.sensor.expose(disturbed, noise), pose.disturbances.jpeg_quality);
}

}  // namespace etalon
