// A render's plan for people and for programs: what was done, what was left out and by which bound.
#pragma once

#include <string>

#include "sim/render/renderer.h"

namespace etalon {

// Lines of at most 80 columns, the last one ended too.
std::string plan_table(const RenderPlan& plan);

// A JSON object.
std::string plan_json(const RenderPlan& plan);

}  // namespace etalon
