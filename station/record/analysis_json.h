// What an analysis found, as run.json has it: measurements, registration, fields, budget, what the
// run could see. Includes json.hpp: for .cpp files only.
#pragma once

#include "station/record/record_json.h"

namespace etalon {

// Adds its keys to `run`.
void add_analysis(RecordJson& run, const Qualification& analysis);

}  // namespace etalon
