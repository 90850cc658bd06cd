// Where a detector finds the marker in what the camera under test should see: what B3 compares the
// photographs' corners with.
//
// Noise moves a detector's corners, and always the same way: the lines that AprilTag fits to the
// demo's photographs lie 0.02 px apart from those of images without noise. More frames do not
// average that out. So renders are given the noise that the calibration states, in several
// exposures, and the corners' mean is taken. A calibration without noise gets one exposure without.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "compare/detector.h"
#include "station/expected_view.h"
#include "station/station_file.h"

namespace etalon {

class RenderedCorners {
public:
    // Of the mean: the detector's noise is a third of a single photograph's.
    static constexpr int noisy_exposures = 9;

    // `detector` must outlive it, and is used by one thread at a time.
    RenderedCorners(const StationFile& station, Detector& detector);

    const ExpectedView& view() const { return view_; }

    // In the order of Marker::points_mm; nothing when the marker is not detected in most of the
    // exposures. A pure function of station and pose. Throws what Renderer::render throws.
    std::optional<std::vector<Eigen::Vector2d>> at(const Rigid& camera_from_marker) const;

private:
    ExpectedView view_;
    SensorModel sensor_;
    Detector& detector_;
    int exposures_;
    std::uint64_t seed_;
};

}  // namespace etalon
