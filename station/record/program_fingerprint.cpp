#include "station/record/program_fingerprint.h"

#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <opencv2/core/utility.hpp>

#include "core/file/sha256.h"

namespace etalon {
namespace {

// The notes of a loaded object hold its build ID, which follows from its code.
int add_notes(dl_phdr_info* object, std::size_t, void* text) {
    std::string& all = *static_cast<std::string*>(text);
    all += fmt::format("{}\n", object->dlpi_name);
    for (int i = 0; i < object->dlpi_phnum; ++i) {
        const ElfW(Phdr)& part = object->dlpi_phdr[i];
        if (part.p_type == PT_NOTE)
            all.append(reinterpret_cast<const char*>(object->dlpi_addr + part.p_vaddr),
                       part.p_memsz);
    }
    return 0;
}

// What was loaded with the program: plugins (core/program/plugin.h) that come later measure
// nothing.
const std::string notes_at_start = [] {
    std::string all;
    dl_iterate_phdr(add_notes, &all);
    return all;
}();

std::string found_fingerprint() {
    return sha256(sha256_of_file("/proc/self/exe") + "\n" + cv::getCPUFeaturesLine() + "\n" +
                  notes_at_start);
}

}  // namespace

const std::string& program_fingerprint() {
    static const std::string fingerprint = found_fingerprint();
    return fingerprint;
}

}  // namespace etalon
