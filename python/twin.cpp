// etalon._etalon._Twin: what etalon.twin() starts (etalon/testing.py).

#ifdef ETALON_HAVE_TWIN
#include "mocks/twin/twin.h"
#include "python/arrays.h"
#include "python/interruptible.h"

namespace etalon {
namespace {

std::unique_ptr<Twin> start(const std::filesystem::path& file,
                            const std::optional<std::uint64_t>& seed) {
    return without_gil([&] {
        TwinFile twin = read_twin_file(file);
        twin.seed = seed.value_or(twin.seed);
        return std::make_unique<Twin>(twin);
    });
}

// Its threads may wait for the GIL's holder.
struct EndWithoutGil {
    void operator()(Twin* twin) const {
        const py::gil_scoped_release released;
        delete twin;
    }
};

}  // namespace

void bind_twin(Module& module) {
    Bound<Twin, std::unique_ptr<Twin, EndWithoutGil>>(
        module, "_Twin", "A simulated stage and camera on 127.0.0.1, until it is deleted.")
        .init(
            [](const std::filesystem::path& file, const std::optional<std::uint64_t>& seed) {
                return std::unique_ptr<Twin, EndWithoutGil>(start(file, seed).release());
            },
            "file"_a, "seed"_a = py::none())
        .get("stage_place", "Where the stage listens.", &Twin::stage_place);
}

}  // namespace etalon
#else

void etalon::bind_twin(pybind11::module_&) {}

#endif
