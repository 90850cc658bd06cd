// The library, fourth of five doors: a photograph against its rendering.
//
//     match_photo()              photometric model and pose fitted, what is left of each pixel
//     examine_match()            what speaks against a match, as findings
//
// Used in examples/library/compare.cpp. Link etalon::compare.
#pragma once

#include "compare/match/photo_findings.h"
#include "compare/photometric/photo_match.h"
#include "etalon/detect.h"
