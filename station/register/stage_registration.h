// X and Y of a stage from photographs of its marker at known positions: what `etalon register`
// does. On a detector's corners, corrected for the detector's bias (compare/pose/pose_bias.h),
// or on photometric poses, each with its own covariance.
//
// Not for a verdict: all poses take part, nothing is held out.
#pragma once

#include "station/setup/station_file.h"

namespace etalon {

// A photograph and where the axes were.
struct StagePhoto {
    std::filesystem::path photo;
    std::vector<double> positions;  // per axis, mm or rad
};

// CSV whose header is `photo` and a column per axis, in any order: `x_mm`, `rz_deg`, as the axes
// are named. Photographs are seen from the CSV's folder. Throws ConfigError with file and line.
std::vector<StagePhoto> read_stage_photos(const std::filesystem::path& csv,
                                          const std::vector<Axis>& axes);

// The first whole frame of every pose in the record of a qualification, with what the axes read
// (poses.csv of station/record/run_record.h), training and hold-out. Throws ConfigError as above.
std::vector<StagePhoto> read_record_photos(const std::filesystem::path& record,
                                           const std::vector<Axis>& axes);

// The station file of a record: its copy, or the unchanged original. Throws ConfigError.
std::filesystem::path station_of_record(const std::filesystem::path& record);

struct RegisteredPhoto {
    std::filesystem::path photo;
    std::string failure;  // why it takes no part; empty when it does
    PoseError residual;   // measured pose against X S Y
};

struct StageRegistration {
    Registration registration;
    std::string detector;
    std::vector<RegisteredPhoto> photos;  // in the order given
    int used = 0;
    int rounds = 0;  // of correcting for the detector's bias; of photometric poses 0
    // Standard deviations of X, then of Y: of the stated covariance and of what the residuals show
    // beyond it. Of corners, whose noise nobody states, of the residuals alone.
    Vector12d deviations = Vector12d::Zero();
    double scale = 1.0;  // that was applied to the covariance's deviations
};

// `detector` as make_detector() knows it, or "photometric". Throws ConfigError for a photograph
// that cannot be read, NumericalError for a degenerate plan and whatever registration throws,
// Interrupted after a stop.
StageRegistration register_photos(const StationFile& station, const std::vector<StagePhoto>& photos,
                                  const std::string& detector, const std::stop_token& stop = {});

}  // namespace etalon
