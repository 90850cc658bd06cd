#define ETALON_INSTANTIATE
#include "core/json_instances.h"
