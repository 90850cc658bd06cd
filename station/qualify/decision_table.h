// The decision rule of a run and what each of its judgements risks, in the report.
#pragma once

#include "compare/qualification/qualification.h"
#include "report/html.h"

namespace etalon {

// Nothing where nothing was judged.
void add_decision(HtmlPage& page, const Qualification& analysis);

}  // namespace etalon
