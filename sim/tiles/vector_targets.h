// For which instruction sets Highway compiles a file that includes this first; a machine that has
// others takes one of these. Each costs a compilation. Left out are vectors of unknown size, which
// cannot stand in an array, and x86's SSSE3 (2006), beside SSE4, AVX2, AVX-512 and code for any.
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS \
    (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
