// What a PASS of a station's plan means: how often a run comes out as PASS, FAIL or neither when
// the camera (or marker, or stage) is wrong by a known size.
//
// Monte Carlo of whole runs (station/planning/simulated_run.h). Sizes are multiples of "1x": the
// size at which the field that registration leaves, without any noise, just reaches the limit of a
// judged quantity. 1x comes from the analysis of exact corners, not from first-order signatures.
//
// Of errors whose signatures cannot be told apart one is studied, which names the others. An error
// that cannot be seen has no 1x and no curve.
#pragma once

#include "core/statistics/distributions.h"
#include "report/result_rows.h"
#include "station/planning/simulated_run.h"

namespace etalon {

struct OutcomeCounts {
    std::size_t pass = 0, fail = 0, other = 0;

    std::size_t runs() const { return pass + fail + other; }
    // Of the runs, with its two-sided 95 % interval.
    Proportion share(std::size_t OutcomeCounts::*outcome) const {
        return wilson_share(this->*outcome, runs());
    }
};

// One judged quantity at one size of an error.
struct QuantityOutcomes {
    OutcomeCounts counts;
    double mean_value = 0.0, mean_uncertainty = 0.0;  // over the runs; in the quantity's unit
};

struct CharacteristicPoint {
    double size = 0.0;                         // of the error, in its unit
    std::vector<QuantityOutcomes> quantities;  // as OperatingCharacteristic::quantities
    OutcomeCounts verdict;                     // of the run
    int refused = 0;  // runs that ended in a NumericalError: "other" everywhere, never a PASS
};

struct ErrorCharacteristic {
    std::string name, unit;
    std::vector<std::string> alike;  // cannot be told apart from it
    bool observable = true;
    std::string reason;  // why it is not
    // 1x per quantity; nothing where no size was found that reaches the limit.
    std::vector<std::optional<double>> limit_size;
    // Ascending sizes: 0.5x, 1x and 2x of each quantity. Of an error that cannot be seen none.
    std::vector<CharacteristicPoint> points;
};

struct OperatingCharacteristic {
    std::vector<JudgedQuantity> quantities;  // as a run of this station without any error has them
    CharacteristicPoint without_error;
    std::vector<ErrorCharacteristic> errors;
    int runs = 0;  // per point
    std::uint64_t seed = 0;
};

struct CharacteristicRequest {
    int runs = 2000;  // per point
    std::uint64_t seed = 1;
    std::vector<std::string> errors;  // only these; empty: all
};

// What one run makes of one point.
struct QuantityRun {
    Outcome outcome = Outcome::skipped;
    double value = 0.0, expanded_uncertainty = 0.0;
};
struct PointRun {
    bool refused = false;  // then its quantities say nothing
    Outcome verdict = Outcome::inconclusive;
    std::vector<QuantityRun> quantities;  // as OperatingCharacteristic::quantities
};

// The runs of an operating characteristic, to be simulated a part at a time: a run is all points,
// first the one without an error, then each error's. Safe from every thread once built.
class CharacteristicRuns {
public:
    // Finds each error's 1x: some seconds of CPU time on one thread. `simulator` must outlive it.
    // Throws ConfigError for an error that has no such name, NumericalError when not even the exact
    // run without any error can be analysed, or none of its quantities is judged.
    CharacteristicRuns(const RunSimulator& simulator, const CharacteristicRequest& request);

    // All points with their sizes, nothing counted yet.
    const OperatingCharacteristic& planned() const { return planned_; }

    // Simulates these runs, some of them in parallel, and hands each on, in their order and from
    // this thread: the same results for any number of threads. Some 10 ms of CPU a point.
    using KeepRun = std::function<void(std::size_t run, std::span<const PointRun> points)>;
    void simulate(std::span<const std::size_t> runs, const KeepRun& keep) const;

private:
    RunTruth truth(const InjectedError& error, double size) const;
    Qualification judgement(QualificationInput input) const;
    std::optional<double> size_at(const JudgedQuantity& quantity, const InjectedError& error,
                                  double start) const;
    ErrorCharacteristic with_sizes(const InjectedError& error, const ErrorSignature& signature);
    void choose_errors(const std::vector<std::string>& wanted);
    PointRun run(std::size_t run, std::size_t point) const;

    const RunSimulator& simulator_;
    NoiseDraws draws_;
    Qualification told_;  // of a run without any error
    OperatingCharacteristic planned_;
    std::vector<RunTruth> truths_;  // by point
};

std::size_t point_count(const OperatingCharacteristic& result);

// Counts one run more. Sums depend on the order: runs are added as they are numbered.
void add_run(OperatingCharacteristic& result, std::span<const PointRun> points);

// The point of an error at this multiple of a quantity's 1x; nothing without a 1x.
const CharacteristicPoint* point_at(const ErrorCharacteristic& error, std::size_t quantity,
                                    double multiple);

// The folder of a shard of `etalon oc` (report/result_rows.h): oc.json has what the runs follow
// from, results.csv a line per run and point (docs/operating-characteristic.md). From all shards
// follows the operating characteristic, to the bit that of the runs in one process.

// An operating characteristic with what is said of its station.
struct StationCharacteristic {
    std::string station;    // its id
    std::string made_from;  // JSON: version, hashes of the station's files
    DetectorFigures detector;
    OperatingCharacteristic result;
};
StationCharacteristic characteristic_of(const RunSimulator& simulator,
                                        const OperatingCharacteristic& result);

// Of the runs of one shard. `planned`: as CharacteristicRuns::planned() gives it.
RowsDescription oc_rows(const StationCharacteristic& planned, const Shard& shard);
std::string rows_of_run(std::size_t run, std::span<const PointRun> points);

// Reads and counts all runs, one at a time. Throws ConfigError with file and line for shards that
// are missing, doubled, unfinished, of different settings, or changed.
StationCharacteristic merged_characteristic(const std::vector<std::filesystem::path>& shards);

}  // namespace etalon
