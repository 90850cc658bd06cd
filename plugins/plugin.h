// What every plugin exports: its version and its table (core/program/plugin.h).
#pragma once

#include "core/program/version.h"

#define ETALON_EXPORT_PLUGIN(table)                                                         \
    extern "C" __attribute__((visibility("default"))) const char* etalon_plugin_version() { \
        return etalon::version;                                                             \
    }                                                                                       \
    extern "C" __attribute__((visibility("default"))) const void* etalon_plugin_table() {   \
        return &(table);                                                                    \
    }
