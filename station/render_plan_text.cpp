#include "station/render_plan_text.h"

#include <nlohmann/json.hpp>

#include "core/text.h"

namespace etalon {
namespace {

constexpr std::size_t columns = 80;

// Words broken into lines, each of them but the first indented.
std::string wrapped(const std::string& text, std::size_t indent) {
    std::string lines, line;
    for (const std::string& word : split(text, ' ')) {
        if (!line.empty() && line.size() + 1 + word.size() > columns) {
            lines += line + "\n";
            line = std::string(indent, ' ') + word;
        } else {
            line += (line.empty() ? "" : " ") + word;
        }
    }
    return lines + line + "\n";
}

}  // namespace

std::string plan_table(const RenderPlan& plan) {
    return wrapped(plan.describe(), 2);
}

nlohmann::ordered_json plan_json(const RenderPlan& plan) {
    return {{"summary", plan.describe()}};
}

}  // namespace etalon
