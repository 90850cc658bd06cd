// Lines that an external detector prints.
#include "study/external_detector.h"
#include "tests/fuzz/coverage/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon;
    using namespace etalon::test;
    read_or_refuse([&] {
        const auto answer = external_answer(std::string(text_of(data, size)));
        if (!answer || !answer->camera_from_marker)
            return;
        require(answer->failure.empty(), "a pose with a failure");
        require(answer->camera_from_marker->rotation.coeffs().allFinite() &&
                    answer->camera_from_marker->translation.allFinite(),
                "a pose that is none");
    });
    return 0;
}
