// JSON Schema (draft 2020-12) of our kinds of files, for editors: made of what the strict reader
// asked while files were read (core/config/read_trace.h), so that it says what the reader takes and
// nothing else. It has the keys and ranges that those files led the reader to; what one key says
// about another (files that exist, low < high, a key that another one needs) only the reader knows.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "core/config/read_trace.h"

namespace etalon {

// By kind, "camera/1", of the files that were read to their end. A key is required if the reader
// wanted it in every mapping of its place. The files of the trace must be ones that were read
// without an error.
std::map<std::string, std::string> file_schemas(const ReadTrace& trace);

// Each as FOLDER/NAME.json, "camera.json"; the folder is made.
void write_schemas(const ReadTrace& trace, const std::filesystem::path& folder);

}  // namespace etalon
