// The files that a station was read from, by content, and their copies in a record: a record must
// tell years later what was measured with what, wherever the originals have gone.
//
// Copies lie under inputs/ as the originals lay under their nearest common folder, so that relative
// paths from one to another still lead to the copy. A file other than the calibration that is named
// with its absolute path is copied too, but it is the original that reading back opens: it must
// still be the same.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "station/setup/station_file.h"

namespace etalon {

// Station, calibration and limits, then what these name: the camera's point spread and transfer
// table, the stage's profile and those that it extends. `profile` may be a built-in one's name.
// Throws ConfigError when one cannot be read.
std::vector<InputFile> station_inputs(const std::filesystem::path& station,
                                      const std::filesystem::path& calibration,
                                      const std::filesystem::path& limits,
                                      const std::string& profile);

// Copies them into `record`/inputs and sets their `copy`. Throws ConfigError when one cannot be
// copied or is not any more what was read.
void copy_inputs(std::vector<InputFile>& inputs, const std::filesystem::path& record);

// The station from these copies, with the inputs as given. Throws ConfigError for a copy outside of
// inputs/, one that is missing or not the recorded bytes, and what read_station() throws.
StationFile read_recorded_station(const std::filesystem::path& record,
                                  const std::vector<InputFile>& inputs);

// Throws ConfigError with the first file that is not the same in both.
void require_same_inputs(const std::vector<InputFile>& recorded,
                         const std::vector<InputFile>& given);

}  // namespace etalon
