// STag's codewords: the published families, our own rotation-safe one, and tables from a file. How
// a marker is drawn from one: sim/marker/stag_pattern.h.
//
// Published (B. Benligiray, C. Topal, C. Akinlar, "STag: A stable fiducial marker system", Image
// and Vision Computing 89, 2019; tables of the authors' generator): HD17, HD19, HD21 and HD23 of
// 157, 38, 12 and 6 words. The number is the smallest Hamming distance of two words in the same
// orientation. A camera does not know the orientation, and a turned word may be nearer to another
// one: over all four turns it is 10, 10, 14 and 14. HD11, HD13 and HD15 (22309, 2884 and 766 words)
// are read from the published files.
//
// R16 is ours: 128 words that differ in 16 discs or more from each other in all four orientations
// and from themselves turned, 18 to 30 discs black.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace etalon {

inline constexpr int stag_bits = 48;
inline constexpr int stag_bits_a_quarter = stag_bits / 4;

// Bit i is 1 when the disc at code point i (sim/marker/stag_pattern.h) is black.
using StagCode = std::uint64_t;

// The built-in families, "HD17" to "R16".
const std::vector<std::string>& stag_families();

// Whether a family's name is that of a file: it holds a '.' or a '/'.
bool is_stag_file(const std::string& family);

// The words of a built-in family or of a table file; a word's place is its id. A file has a line a
// word, 48 characters 0 or 1, the first one code point 0, 1 for a black disc (as in the published
// files); empty lines and those that begin with '#' are skipped. Throws ConfigError for an unknown
// family and a file that is not exactly so. Safe from every thread; R16 takes some ms the first
// time.
std::vector<StagCode> stag_codes(const std::string& family);

// The word that is read from a marker turned counter-clockwise by so many quarters (any number).
StagCode turned_stag_code(StagCode code, int quarters);

// In how many discs they differ, both upright.
int hamming_distance(StagCode a, StagCode b);

// The smallest Hamming distance of word `id` to any other word in any orientation and to itself
// turned; 0 when it cannot be told from one of them.
int stag_separation(const std::vector<StagCode>& codes, int id);

}  // namespace etalon
