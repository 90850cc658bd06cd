// The part of a comparison's report that belongs to one photograph: what was found, photograph and
// rendering in one place, the maps, the change of the pose, every fitted parameter.
#pragma once

#include <string>

#include "station/compare/comparison.h"

namespace etalon {

// `number` counts photographs from 1 and names the card for links ("photo-3"). The viewer of one
// card in a report starts moving, that with `starts_in_turn`.
std::string card_html(const Comparison& comparison, std::size_t number, bool starts_in_turn);

// All photographs, small, each a link to its card.
std::string contact_sheet_html(const Comparison& comparison);

// Size of the change from the pose under test to the photometric pose, with the standard deviation
// of that pose in the change's direction.
struct PoseChange {
    double translation_mm = 0.0, translation_deviation_mm = 0.0;
    double rotation_mrad = 0.0, rotation_deviation_mrad = 0.0;
};
std::optional<PoseChange> pose_change_of(const ComparedPhoto& photo);

}  // namespace etalon
