#define ETALON_INSTANTIATE
#include "core/precompiled/eigen_instances.h"
