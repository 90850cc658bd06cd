// Highway's instruction sets for a file that includes this first; other machines take one of these.
// Left out: vectors of unknown size, which cannot stand in an array, and x86's SSSE3 (2006).
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS \
    (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
