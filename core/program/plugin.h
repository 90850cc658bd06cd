// Parts that are loaded when first used, since their libraries load longer than most commands run:
// shared objects LIBDIR/etalon/etalon_NAME.so, which export one table of functions and a version.
#pragma once

#include <string>

namespace etalon {

// The table that `etalon_plugin_table` returns. Looked for below the folders above the file of this
// code (build folder, prefix), then by the dynamic linker. Loaded once, never unloaded; any thread;
// 20 to 200 ms. Throws Error with the plugin's file, the cause and the package that brings it.
const void* load_plugin(const std::string& name);

// The same table with its type, the one that the plugin was compiled with.
template <class Table>
const Table& plugin(const std::string& name) {
    return *static_cast<const Table*>(load_plugin(name));
}

}  // namespace etalon
