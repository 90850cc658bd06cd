// report.html of a qualification: the verdict on top, then what limits it, what the run could not
// see, the bias over the volume, photographs against renders, the budget and the run itself.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// Writes a self-contained page that opens offline. Pictures are read from result.folder. A run
// that ended early gets the page of what it has. Throws ConfigError when the file cannot be
// written; a picture that cannot be read is left out and the page says so.
void write_qualify_report(const QualifyResult& result, const std::filesystem::path& path);

}  // namespace etalon
