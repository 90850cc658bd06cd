// What the detectors of a study make of one pose: the marker rendered, disturbed and exposed, seen
// by every detector, and their poses judged against the truth.
//
// Detectors with the same marker see the same image; variants share renders, exposures and
// detections as far as they do not differ in them.
#pragma once

#include "compare/expect/pose_statistics.h"
#include "compare/photometric/photometric_detector.h"
#include "study/study_file.h"

namespace etalon {

// The study itself, or the study with something switched.
struct StudyVariant {
    std::string name;  // "as is", "tone", ...
    StudySwitches switches;
};

// With a variant for each ablation. Throws ConfigError at --ablate for impossible or doubled ones.
std::vector<StudyVariant> study_variants(const StudyFile& study,
                                         const std::vector<std::string>& ablations);

// One pose of a study with what is drawn along with it.
struct StudyPose {
    std::size_t index = 0;
    Rigid camera_from_marker;
    Disturbances disturbances;
    std::size_t focus = 0;  // of StudyFile::focus_mm
};

// What one detector made of one pose in one variant.
struct StudyFinding {
    double size_px = 0.0;  // root of the area that the marker's points span in the image
    std::optional<DetectedError> error;
    std::optional<double> corner_rms_px;  // distance from the projected truth; not of whole poses
    std::string failure;                  // why there is no pose; empty where there is
};

// CPU time by purpose, ms.
struct StudyTimes {
    double render = 0.0;            // radiance
    double sensor = 0.0;            // disturbances, exposure, compression
    std::vector<double> detectors;  // by detector: images to corners, or to photometric poses
    double estimate = 0.0;          // corners to poses, and their judgement

    void add(const StudyTimes& other);
};

// What threads share. Immutable. Costs some ms, and 30 bytes a pixel for each focus distance.
class StudyOptics {
public:
    // Throws ConfigError as study_variants does, and what Renderer and PhotometricDetector throw.
    StudyOptics(const StudyFile& study, std::vector<StudyVariant> variants);

    const StudyFile& study() const { return study_; }
    const std::vector<StudyVariant>& variants() const { return variants_; }

    // A way to take an image; several variants may share one.
    struct Imaging {
        CameraModel camera;
        SensorModel sensor;
        Disturber disturber;
        bool sharp = false;                 // without the lens
        std::vector<std::size_t> variants;  // that use it
    };
    const std::vector<Imaging>& imagings() const { return imagings_; }

    // Radiance of a marker at a pose. Throws what Renderer::render throws.
    RenderedPart radiance(const Marker& marker, const StudyPose& pose, bool sharp) const;
    // What the sensor makes of it.
    CodeImage image(const RenderedPart& radiance, const Marker& marker, const StudyPose& pose,
                    const Imaging& imaging) const;

    const CameraModel& estimation_camera(std::size_t variant) const {
        return projectors_[variant].camera();
    }
    const Projector& projector(std::size_t variant) const { return projectors_[variant]; }
    const Projector& true_projector() const { return true_projector_; }
    // Of a detector "photometric"; null of any other.
    const PhotometricDetector* photometric(std::size_t variant, std::size_t detector) const {
        return photometric_[variant * study_.detectors.size() + detector].get();
    }

private:
    void add_imaging(std::size_t variant);
    void add_photometric(std::size_t variant);

    StudyFile study_;
    std::vector<StudyVariant> variants_;
    std::vector<Renderer> lens_, sharp_;  // by focus; sharp_ has one, or none
    std::vector<Imaging> imagings_;
    std::vector<Projector> projectors_;
    Projector true_projector_;
    std::vector<std::unique_ptr<const PhotometricDetector>> photometric_;
};

}  // namespace etalon
