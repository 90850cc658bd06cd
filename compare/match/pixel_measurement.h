// Measures how photographs deviate from their renders at the photometric pose: by the lens'
// f-number and focus distance, a further blur, tone, width of dark parts, noise, levels and
// background.
//
// A photograph is linearised by its deviations, pose and levels together
// (compare/photometric/photometric_equations.h); by f-number and focus distance from renders with a
// little more of them, diffraction included. The equations of all photographs add up: only all
// depths of a run tell focus from f-number. Renders are repeated while more than a small change is
// asked for.
#pragma once

#include <functional>
#include <optional>
#include <span>

#include "compare/diagnosis/pixel_evidence.h"
#include "compare/match/photo_findings.h"

namespace etalon {

// A calibration with a deviation in it. Making one takes some 0.1 s. Safe from every thread.
class DeviatingCamera {
public:
    explicit DeviatingCamera(const CameraModel& calibration,
                             const PixelDeviation& deviating = PixelDeviation::Zero());

    // Deviations that can be asked for: of the lens with a lens section, of the tone with a sensor
    // section, and growth.
    static std::array<bool, deviation::count> asked_of(const CameraModel& calibration);

    // `photo` as PhotometricDetector::photo_at() gives it at this pose; `whole`: the marker's whole
    // printed area, nothing where its surroundings are not known. Residuals beyond three times
    // `noise_scale` (nothing: their own) are limited. Throws NumericalError where the pixels
    // determine nothing. Some 30 ms of CPU time for a tag of 5000 px.
    PhotoEvidence measure(const PhotoOfMarker& photo, const Rigid& camera_from_marker,
                          const std::optional<ComparedArea>& whole,
                          std::optional<double> noise_scale = std::nullopt) const;

private:
    std::vector<cv::Mat> changes(const PhotoOfMarker& photo, const Rigid& camera_from_marker,
                                 const RenderedGradient& rendered, const cv::Rect& region) const;

    std::array<bool, deviation::count> asked_;
    PixelDeviation deviating_, steps_;
    PhotometricCamera camera_;
    std::optional<PhotometricCamera> other_f_number_, other_focus_;
};

// The same photographs as those at deviation 0, a few of them by index, with another deviation.
using MeasurePhotos = std::function<std::vector<PhotoEvidence>(const PixelDeviation& deviating,
                                                               std::span<const std::size_t> which,
                                                               std::optional<double> noise_scale)>;

// From what was measured at deviation 0 to where nothing more is asked for (`at`, `asked` and
// `photos` of the result). Deterministic.
RunEvidence settled_pixels(const CameraModel& calibration, std::vector<PhotoEvidence> at_zero,
                           const MeasurePhotos& measure);

}  // namespace etalon
