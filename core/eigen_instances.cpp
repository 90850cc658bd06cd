#define ETALON_INSTANTIATE
#include "core/eigen_instances.h"
