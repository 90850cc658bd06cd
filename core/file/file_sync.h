// What must outlast a power cut is brought to the disk before anything is said of it.
#pragma once

#include <filesystem>

namespace etalon {

// Returns when the content of a file, or the names in a folder, are on the disk. Throws as
// fail_writing() when they cannot be. Takes as long as the disk does: from 0.5 ms to some 20 ms.
void sync_to_disk(const std::filesystem::path& file_or_folder);

}  // namespace etalon
