// A measured quantity judged by the limits file: its outcome, and what that risks.
#pragma once

#include "compare/decision/verdict.h"
#include "compare/qualification/limits_file.h"

namespace etalon {

// Sets outcome, risk and, where it is INCONCLUSIVE, the reason. Without an uncertainty, as in a
// simulation without noise, there is no risk. Throws NumericalError as decide() does.
void decide(JudgedQuantity& quantity, const Limits& limits);

}  // namespace etalon
