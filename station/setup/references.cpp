#include "station/setup/references.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/file/text.h"
#include "core/time/clock.h"
#include "station/setup/station_file.h"

namespace etalon {
namespace {

std::string read_day(const Value& value) {
    if (!days_of_date(value.text()))
        value.fail(fmt::format("'{}' is no day as 2026-03-07", value.text()));
    return value.text();
}

std::string non_empty(const Value& value) {
    if (trimmed(value.text()).empty())
        value.fail("must not be empty");
    return value.text();
}

// `key`: the unit as it stands in keys.
TracedReference read_reference(const Value& section, const std::string& name, const Unit& unit,
                               const std::string& key) {
    TracedReference reference;
    reference.name = name;
    reference.unit = unit.name;
    reference.value = section.at("value_" + key).number(unit.either_sign());
    reference.expanded_uncertainty = section.at("U_" + key).number(unit.positive());
    reference.certificate = non_empty(section.at("certificate"));
    reference.laboratory = non_empty(section.at("laboratory"));
    reference.date = read_day(section.at("date"));
    reference.due = read_day(section.at("due"));
    if (reference.due <= reference.date)
        section.at("due").fail(fmt::format("must be after its date {}", reference.date));
    return reference;
}

// `declared`: the standard uncertainty that the station's budget has for it, in the unit.
void require_covered(const Value& section, const TracedReference& reference,
                     const std::optional<double>& declared, const std::string& key) {
    if (!declared)
        section.fail(fmt::format("is a certificate of what '{}' does not declare", key));
    constexpr double rounding = 1e-9;
    if (reference.standard_uncertainty() > *declared * (1.0 + rounding))
        section.fail(
            fmt::format("leaves a standard uncertainty of {:.4g} {} (of value and U/2), and '{}' "
                        "declares {:.4g}",
                        reference.standard_uncertainty(), reference.unit, key, *declared));
}

std::optional<double> times(const std::optional<double>& value, double factor) {
    return value ? std::optional(*value * factor) : std::nullopt;
}

void read_stage_scales(const Value& section, const StationFile& station,
                       std::vector<TracedReference>& references) {
    const Value named = section.with_names();
    for (const Axis& axis : station.stage.axes) {
        const auto value = named.find(axis.name);
        if (!value)
            continue;
        references.push_back(read_reference(*value, "stage scale " + axis.name, units::ppm, "ppm"));
        require_covered(*value, references.back(), times(axis.scale_uncertainty, 1e6),
                        "scale_uncertainty_ppm");
    }
}

}  // namespace

double TracedReference::standard_uncertainty() const {
    return std::hypot(value, expanded_uncertainty / 2.0);
}

std::vector<TracedReference> read_references(const Value& section, const StationFile& station) {
    std::vector<TracedReference> references;
    if (const auto scales = section.find("stage_scale"))
        read_stage_scales(*scales, station, references);
    if (const auto size = section.find("marker_size")) {
        references.push_back(read_reference(*size, "marker print size", units::ppm, "ppm"));
        require_covered(*size, references.back(), times(station.marker_size_uncertainty, 1e6),
                        "marker_size_uncertainty_ppm");
    }
    if (const auto flatness = section.find("marker_flatness")) {
        references.push_back(read_reference(*flatness, "marker flatness", units::um, "um"));
        require_covered(*flatness, references.back(), times(station.marker_flatness_mm, 1e3),
                        "marker_flatness_um");
    }
    if (const auto thermometer = section.find("thermometer"))
        references.push_back(read_reference(*thermometer, "thermometer", units::kelvin, "k"));
    return references;
}

const TracedReference* reference_named(const std::vector<TracedReference>& references,
                                       const std::string& name) {
    const auto found = std::ranges::find(references, name, &TracedReference::name);
    return found == references.end() ? nullptr : &*found;
}

}  // namespace etalon
