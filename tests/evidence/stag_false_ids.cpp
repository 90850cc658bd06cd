// Counts what the STag finder takes for a marker in images with and without markers: noise,
// textures, shapes, other tags, boards, STag markers of other families, and markers whole and in
// part (tests/compare/detect/stag/stag_images.h). All 128 words of R16 are looked for in every
// image. Argument: IMAGES, default 100 000, about 25 minutes of CPU time. docs/stag.md has the
// table.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cstdlib>
#include <mutex>

#include "tests/compare/detect/stag/stag_images.h"

int main(int count, char** arguments) {
    using namespace etalon;
    using namespace etalon::test;
    const std::uint64_t images = count > 1 ? std::strtoull(arguments[1], nullptr, 10) : 100000;
    const std::vector<StagCode> words = stag_codes("R16");
    const StagImages source(words, 2019);
    std::array<StagTally, stag_image_kinds> tallies;
    std::mutex lock;
    tbb::parallel_for(std::uint64_t{0}, images, [&](std::uint64_t number) {
        const StagImage image = source.make(number);
        const std::vector<FoundStag> found = find_stags({image.pixels, 8}, words, 4);
        const std::lock_guard hold(lock);
        tallies[static_cast<std::size_t>(image.kind)].add(image, found);
    });
    constexpr std::array names{"noise",  "textures",    "shapes",  "other tags",
                               "boards", "other STags", "markers", "markers in part"};
    fmt::print(
        "| images of | images | found | not measured | false ids | misplaced |\n"
        "|---|---|---|---|---|---|\n");
    int wrong = 0;
    for (std::size_t kind = 0; kind < names.size(); ++kind) {
        const StagTally& t = tallies[kind];
        fmt::print("| {} | {} | {} | {} | {} | {} |\n", names[kind], t.images, t.found, t.unrefined,
                   t.false_ids, t.misplaced);
        wrong += t.false_ids + t.misplaced;
    }
    return wrong == 0 ? 0 : 1;
}
