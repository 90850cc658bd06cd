// Descriptions of GenICam devices, of which Aravis makes nodes: a device in this process that has
// such a one is opened, set up and asked what our cameras are asked.
#include <arv.h>
#include <dlfcn.h>

#include <algorithm>
#include <map>
#include <regex>
#include <set>

#include "capture/genicam/genicam_clock.h"
#include "capture/genicam/genicam_settings.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

void open(const std::filesystem::path& description) {
    arv_set_fake_camera_genicam_filename(description.c_str());
    const GenicamDevice device("Fake_1", {});
    const CaptureSettings wanted{.exposure = std::chrono::microseconds(2000), .gain_db = 1.0};
    const GenicamCapture capture = configure_genicam(device, wanted);
    require(capture.format != nullptr, "a capture without a format");
    require_all_finite(std::array{capture.exposure_step_us, capture.settings.gain_db});
    genicam_abilities(device);
    const SteadyClock clock;
    read_genicam_clock(device, clock);
    read_ptp(device);
}

// What each node refers to, by name: the elements that begin with p.
std::map<std::string, std::set<std::string>> references_of(const std::string& description) {
    static const std::regex name_or_reference(
        "<EnumEntry Name|Name=\"([^\"]{0,80})\"|<p[A-Za-z]{1,40}[^<>]{0,80}>([^<]{0,80})<");
    std::map<std::string, std::set<std::string>> references;
    std::string node;
    for (std::sregex_iterator at(description.begin(), description.end(), name_or_reference), end;
         at != end; ++at)
        if ((*at)[1].matched)
            node = (*at)[1];
        else if ((*at)[2].matched)
            references[node].insert((*at)[2]);
    return references;
}

// Aravis follows references without looking for circles, until the stack is full: known, see
// docs/robustness.md. Nodes that refer to nothing more are taken away until none is left.
bool refers_in_circles(const std::string& description) {
    auto references = references_of(description);
    const auto is_settled = [&](const auto& node) {
        return std::none_of(node.second.begin(), node.second.end(),
                            [&](const std::string& other) { return references.contains(other); });
    };
    while (std::erase_if(references, is_settled) > 0)
        continue;
    return !references.empty();
}

}  // namespace
}  // namespace etalon::test

// The library's device copies beyond its buffer when it is read behind its memory, where it keeps
// the description (Aravis 0.8.26). A camera refuses what it does not have, and so does this one.
// Takes the place of the library's function.
extern "C" gboolean arv_fake_camera_read_memory(ArvFakeCamera* camera, guint32 address,
                                                guint32 size, void* buffer) {
    static const auto read = reinterpret_cast<decltype(&arv_fake_camera_read_memory)>(
        dlsym(RTLD_NEXT, "arv_fake_camera_read_memory"));
    const bool is_there = guint64(address) + size <= ARV_FAKE_CAMERA_MEMORY_SIZE;
    return is_there && read(camera, address, size, buffer);
}

extern "C" int LLVMFuzzerInitialize(int*, char***) {
    for (const char* network : {"GigEVision", "USB3Vision"})
        arv_disable_interface(network);
    arv_enable_interface("Fake");
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon::test;
    const std::string description(text_of(data, size));
    if (refers_in_circles(description))
        return 0;
    const auto path = write_input("description.xml", description);
    read_or_refuse([&] { open(path); });
    return 0;
}
