// The folder of a shard of `etalon oc` (report/result_rows.h):
//
//   oc.json        what the runs follow from: the station's files, the detector's figures, the
//                  errors with their sizes, the program's version
//   results.csv    a line per run and point: verdict, and each judged quantity's outcome, value
//                  and U
//
// From all shards follows the operating characteristic, to the bit that of the runs in one process.
// Layout of the files: docs/operating-characteristic.md.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/result_rows.h"
#include "station/planning/operating_characteristic.h"
#include "station/planning/studied_plan.h"

namespace etalon {

// An operating characteristic with what is said of its station.
struct StationCharacteristic {
    std::string station;    // its id
    std::string made_from;  // JSON: version, hashes of the station's files
    DetectorFigures detector;
    OperatingCharacteristic result;
};
StationCharacteristic characteristic_of(const StudiedPlan& studied,
                                        const OperatingCharacteristic& result);

// Of the runs of one shard. `planned`: as CharacteristicRuns::planned() gives it.
RowsDescription oc_rows(const StationCharacteristic& planned, const Shard& shard);
std::string rows_of_run(std::size_t run, std::span<const PointRun> points);

// Reads and counts all runs, of which no more than one is in memory. Throws ConfigError with file
// and line for shards that are missing, doubled, not finished, of different settings, or not as
// they were written.
StationCharacteristic merged_characteristic(const std::vector<std::filesystem::path>& shards);

}  // namespace etalon
