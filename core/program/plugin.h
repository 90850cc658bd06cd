// Parts of the program that are loaded when they are first used: the libraries behind them take
// longer to load than most commands take to run. A plugin is a shared object
// LIBDIR/etalon/etalon_NAME.so, which exports one table of functions and a version.
#pragma once

#include <string>

namespace etalon {

// The table of the plugin, as `etalon_plugin_table` returns it. Looked for below the folders above
// the file that this code lies in (the build folder, the prefix), then where the dynamic linker
// looks (run path, LD_LIBRARY_PATH). Loaded once and never unloaded; any thread. Takes as long as
// its libraries need: 20 to 200 ms. Throws Error with the plugin's file, the cause, and the package
// that brings it.
const void* load_plugin(const std::string& name);

// The same table with its type, the one that the plugin was compiled with.
template <class Table>
const Table& plugin(const std::string& name) {
    return *static_cast<const Table*>(load_plugin(name));
}

}  // namespace etalon
