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

std::string found_fingerprint() {
    std::string all = sha256_of_file("/proc/self/exe") + "\n" + cv::getCPUFeaturesLine() + "\n";
    dl_iterate_phdr(add_notes, &all);
    return sha256(all);
}

}  // namespace

const std::string& program_fingerprint() {
    static const std::string fingerprint = found_fingerprint();
    return fingerprint;
}

}  // namespace etalon
