#include "core/config/yaml_text.h"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <sstream>
#include <vector>

#include "core/file/text.h"

namespace etalon {
namespace {

// Counts the values of a document as it is parsed, and stops at a limit.
class Census final : public YAML::EventHandler {
public:
    explicit Census(const std::string& file) : file_(file) {}

    void OnDocumentStart(const YAML::Mark&) override {}
    void OnDocumentEnd() override {}
    void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { leaf(mark, anchor); }
    void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  const std::string&) override {
        leaf(mark, anchor);
    }
    void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                         YAML::EmitterStyle::value) override {
        open(mark, anchor);
    }
    void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                    YAML::EmitterStyle::value) override {
        open(mark, anchor);
    }
    void OnSequenceEnd() override { close(); }
    void OnMapEnd() override { close(); }

    void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
        const auto whole = known_.find(anchor);
        if (whole == known_.end())
            refuse(mark, "an alias of the value that it is part of");
        add(mark, whole->second);
    }

private:
    // Of a value with all that is in it.
    struct Size {
        std::size_t values = 1, depth = 0;
    };
    struct Open {
        YAML::anchor_t anchor;
        Size size;
    };

    [[noreturn]] void refuse(const YAML::Mark& mark, const std::string& message) const {
        throw ConfigError({file_, mark.line + 1}, message);
    }

    void add(const YAML::Mark& mark, const Size& size) {
        values_ += size.values;
        if (values_ > max_yaml_values)
            refuse(mark, fmt::format("has more than {} values by here", max_yaml_values));
        if (open_.size() + size.depth > max_yaml_depth)
            refuse(mark, fmt::format("has more than {} lists and mappings in each other",
                                     max_yaml_depth));
        if (!open_.empty())
            include(size);
    }

    // In the innermost list or mapping that is still open.
    void include(const Size& size) {
        Size& whole = open_.back().size;
        whole.values += size.values;
        whole.depth = std::max(whole.depth, size.depth + 1);
    }

    void leaf(const YAML::Mark& mark, YAML::anchor_t anchor) {
        add(mark, {});
        known_[anchor] = {};
    }

    void open(const YAML::Mark& mark, YAML::anchor_t anchor) {
        add(mark, {1, 1});
        open_.push_back({anchor, {1, 1}});
    }

    void close() {
        const Open whole = open_.back();
        open_.pop_back();
        known_[whole.anchor] = whole.size;
        if (!open_.empty())
            include({whole.size.values - 1, whole.size.depth});  // itself was counted as it opened
    }

    const std::string& file_;
    std::size_t values_ = 0;
    std::vector<Open> open_;
    std::map<YAML::anchor_t, Size> known_;  // of anchors whose value is complete; 0: of none
};

void require_limits(const std::string& text, const std::string& file) {
    if (text.size() > max_yaml_bytes)
        throw ConfigError({file},
                          fmt::format("is YAML or JSON of more than {} MiB", max_yaml_bytes >> 20));
    std::istringstream stream(text);
    Census census(file);
    YAML::Parser parser(stream);
    parser.HandleNextDocument(census);
    if (parser.HandleNextDocument(census))
        throw ConfigError({file}, "holds more than one YAML document");
}

// The first line, from 1, that a tab indents, which YAML's parsers call by many names; 0: none.
int line_with_tab(const std::string& text) {
    int number = 0;
    for (const std::string& line : split(text, '\n')) {
        ++number;
        if (line.substr(0, line.find_first_not_of(" \t")).find('\t') != std::string::npos &&
            !trimmed(line).empty())
            return number;
    }
    return 0;
}

}  // namespace

YAML::Node parse_yaml(const std::string& text, const std::string& file) {
    try {
        require_limits(text, file);
        return YAML::Load(text);
    } catch (const YAML::Exception& error) {
        if (const int line = line_with_tab(text); line > 0)
            throw ConfigError({file, line}, "is indented by a tab: YAML takes spaces");
        throw ConfigError({file, error.mark.line + 1}, error.msg);
    }
}

}  // namespace etalon
