// STags behind the Detector interface.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "compare/detect/detector.h"
#include "compare/detect/stag/stag_refinement.h"
#include "core/image/image.h"

namespace etalon {

// Finds STag markers in an image: quadrilaterals, their codewords, and the corners from all
// edges. What a Detector makes of it: compare/detect/stag/stag_detector.cpp.

// Unrefined corners are where the edge segments' lines meet, good to a pixel or so, and now and
// then several pixels wrong: a sign of the marker, no measurement.
struct FoundStag {
    int id = 0;               // place among the words
    Quad corners;             // of the black square, from its top left clockwise, in our pixels
    int wrong_bits = 0;       // that were corrected
    bool is_refined = false;  // by all edges: compare/detect/stag/stag_refinement.h
    double edge_shift_px = 0.0, rms_px = 0.0, sigma_px = 0.0;  // as there, when refined
};

// All places where a marker with one of these words is seen, with at most so many of its 48 discs
// misread; what overlaps is one, the one with the fewest. A refined place has been read again with
// its refined corners. Safe from every thread; 3 ms for 640x480.
std::vector<FoundStag> find_stags(const CodeImage& image, std::span<const StagCode> words,
                                  int correctable_bits);

// Our own finder of STag markers (compare/detect/stag/stag_detector.h), all of whose edges place
// the corners: a marker that is too small or too hidden for that is not found. ConfigError at
// `place` for any other marker.
std::unique_ptr<Detector> make_stag_detector(const Marker& marker, const std::string& place);

}  // namespace etalon
