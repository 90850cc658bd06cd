// Pictures, whose format OpenCV finds by their content.
#include "core/image/image.h"
#include "tests/fuzz/coverage/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon;
    using namespace etalon::test;
    const auto path = write_input("picture.png", text_of(data, size));
    read_or_refuse([&] {
        const CodeImage image = read_image(path);
        require(!image.pixels.empty() && (image.bits == 8 || image.bits == 16),
                "a picture without pixels");
    });
    read_or_refuse([&] { require(read_radiance(path).channels() == 1, "a radiance of colours"); });
    return 0;
}
