// A measured quantity judged by the limits file: its outcome, and what that risks.
#pragma once

#include "compare/verdict/limits_file.h"
#include "compare/verdict/verdict.h"

namespace etalon {

// Sets outcome, risk and, where it is INCONCLUSIVE, the reason. Without an uncertainty, as in a
// simulation without noise, there is no risk. Throws NumericalError as decide() does.
void decide(JudgedQuantity& quantity, const Limits& limits);

}  // namespace etalon
