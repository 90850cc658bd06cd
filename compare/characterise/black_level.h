// The black level: the mean code value of photographs that no light reached (lens cap on, same
// exposure time, gain and temperature as the photographs that it is for). EMVA 1288 release 4,
// section 7 (dark current and its temporal noise at one exposure time).
//
// Standard uncertainty: the larger of what the pixels' temporal noise leaves of a mean and the
// scatter of the frames' means (which offset drift and row noise make larger), and the rounding
// (compare/characterise/code_statistics.h).
#pragma once

#include <span>

#include "core/image/image.h"

namespace etalon {

struct BlackLevel {
    double dn = 0.0, standard_uncertainty_dn = 0.0;
    // Of one pixel from frame to frame, rounding included; 0 with one frame.
    double temporal_variance_dn2 = 0.0, temporal_variance_standard_uncertainty = 0.0;
    // Standard deviation of the pixels' own means, temporal noise taken out (dark signal
    // non-uniformity, DSNU).
    double fixed_pattern_dn = 0.0;
    double drift_dn = 0.0;  // largest mean of a frame minus the smallest
    int frames = 0;
};

// Throws NumericalError for no frames, different sizes or bits, and with the values when
//  - more than 0.1 % of the pixels are at code 0: the mean of the rest would be too high;
//  - the frames' means drift by more than half the temporal noise (and half a code);
//  - there is light: the pixels' own means differ by more than 3 % of full scale.
// About 2 ns a pixel and frame. Safe from every thread.
BlackLevel measure_black_level(std::span<const CodeImage> dark_frames);

}  // namespace etalon
