#include "compare/verdict/limits_file.h"

#include "compare/verdict/judged_quantities.h"
#include "core/strict_reader.h"

namespace etalon {

Limits read_limits(const std::filesystem::path& path) {
    const StrictFile file(path, "limits/1");
    const Value root = file.root();
    Limits limits;
    limits.id = root.at("id").text();
    if (limits.id.empty())
        root.at("id").fail("is empty");
    for (const QuantityKind& kind : quantity_kinds()) {
        const auto given = kind.is_required ? root.at(kind.name) : root.find(kind.name);
        if (!given)
            continue;
        limits.*kind.limit = given->at("limit").number(unit_named(kind.unit).positive());
        given->at("unit").one_of({kind.unit});
    }
    if (const auto pixels = root.find("pixels")) {
        pixels->one_of({"must_match"});
        limits.pixels_must_match = true;
    }
    file.finish();
    return limits;
}

}  // namespace etalon
