#define ETALON_INSTANTIATE
#include "core/precompiled/json_instances.h"
