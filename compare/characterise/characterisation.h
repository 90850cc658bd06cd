// What `etalon characterise` measures, in the order in which each step needs the one before: black
// level, transfer curve, photon transfer, relative illumination, then blur along the target's
// edges (docs/characterising.md).
#pragma once

#include "compare/characterise/blur_estimate.h"
#include "compare/characterise/illumination_estimate.h"
#include "compare/characterise/photon_transfer.h"
#include "compare/characterise/slanted_edge.h"
#include "compare/characterise/transfer_estimate.h"
#include "compare/detect/board/calibration_target.h"

namespace etalon {

struct NamedPhoto {
    std::string name;
    CodeImage image;
};

// Photographs by what they are for; all of the camera's size. Empty: not given.
struct CharacteriseInput {
    CameraModel camera;
    CalibrationTarget target;
    std::vector<NamedPhoto> photos, flats;  // the target in several places; a uniform field
    std::vector<CodeImage> repeats, darks;
    std::vector<ExposedPhoto> exposures;
    // A JPEG file among repeats, darks and exposures: no noise is measured, as its gain would be a
    // fifth too low. Empty: none.
    std::string lossy_file;
};

// A number with its uncertainty, as it goes into words, JSON and the report.
struct MeasuredValue {
    std::string key;    // "gain_e_per_dn", in JSON
    std::string words;  // "gain", on stdout and in the report
    std::string unit;   // "e/DN"; empty: none
    double value = 0.0, standard_uncertainty = 0.0;
    std::string how;          // one sentence: from what, degrees of freedom
    bool is_written = false;  // into the camera file
};

struct NotMeasured {
    std::string quantity, reason;
    bool was_refused = false;  // photographs were given and cannot be used
};

// The modulation along one of the target's edges.
struct EdgeModulation {
    std::string photo;
    Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
    SlantedEdge edge;
};

// Width of the whole blur, defocus included, as a Gaussian's, of the edges at about one depth.
struct BlurAtDepth {
    double depth_mm = 0.0, sigma_px = 0.0, standard_uncertainty_px = 0.0;
};

struct Characterisation {
    CameraModel camera;  // the one given, with what was measured in its place
    std::vector<MeasuredValue> values;
    std::vector<NotMeasured> not_measured;
    std::vector<std::string> remarks;
    std::optional<BlackLevel> black;
    std::optional<TransferEstimate> transfer;
    std::optional<PhotonTransfer> photon_transfer;
    std::optional<IlluminationEstimate> illumination;
    std::string illumination_from;  // "flats", "white squares of the target"
    std::optional<PointSpreadEstimate> point_spread;
    std::optional<DefocusEstimate> defocus;
    std::vector<EdgeModulation> modulation;
    std::vector<BlurAtDepth> blur_by_depth;  // ascending; with a defocus only
    int photos_with_target = 0;

    bool was_anything_refused() const;
};

// Never throws for what a photograph shows: that is `not_measured`. Throws as SensorModel does for
// a camera that contradicts itself.
Characterisation characterise(const CharacteriseInput& input);

}  // namespace etalon
