#include "core/config/strict_reader.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "core/config/file_schema.h"
#include "core/config/yaml_text.h"
#include "core/file/text.h"

namespace etalon {

bool Range::contains(double value) const {
    const bool above = open_low ? value > low : value >= low;
    return above && value <= high;
}

std::string Range::words() const {
    const bool is_named = *unit && std::string_view(unit) != units::one.name;
    const std::string of_unit = is_named ? std::string(" ") + unit : "";
    if (open_low && std::isinf(high))
        return fmt::format("greater than {}{}", low, of_unit);
    if (std::isinf(high))
        return fmt::format("at least {}{}", low, of_unit);
    if (std::isinf(low))
        return fmt::format("at most {}{}", high, of_unit);
    if (open_low)
        return fmt::format("greater than {} and at most {}{}", low, high, of_unit);
    return fmt::format("between {} and {}{}", low, high, of_unit);
}

const Unit& unit_named(std::string_view name) {
    return *std::ranges::find(units::all, name,
                              [](const Unit& u) { return std::string_view(u.name); });
}

struct Value::Shared {
    std::string file;
    std::set<std::string> asked;                            // paths that were looked up
    std::map<std::string, std::vector<std::string>> known;  // per mapping: keys looked for
    std::shared_ptr<ReadTrace::File> trace;                 // empty: nobody wants to know
    bool is_foreign = false;
};

namespace {

thread_local ReadTrace* active_trace = nullptr;

std::shared_ptr<ReadTrace::File> traced_file(std::string_view kind) {
    if (!active_trace)
        return nullptr;
    active_trace->files.push_back(
        std::make_shared<ReadTrace::File>(ReadTrace::File{std::string(kind), {}, false}));
    return active_trace->files.back();
}

// Of one mapping; of one key: reading all looks each up among all, and values carry their paths.
constexpr std::size_t max_keys = 1000, max_key_bytes = 200;

int line_of(const YAML::Node& node) {
    return node.Mark().line + 1;
}

std::string join(const std::string& path, const std::string& key) {
    return path.empty() ? key : path + "." + key;
}

std::string item_path(const std::string& path, std::size_t index) {
    return path + "[" + std::to_string(index) + "]";
}

// Calls visit(path, mapping) for every mapping in the tree, the outer ones first.
using Visit = std::function<void(const std::string&, const YAML::Node&)>;
void visit_mappings(const YAML::Node& node, const std::string& path, const Visit& visit) {
    if (node.IsMap()) {
        visit(path, node);
        for (const auto& entry : node)
            visit_mappings(entry.second, join(path, entry.first.Scalar()), visit);
    } else if (node.IsSequence()) {
        for (std::size_t i = 0; i < node.size(); ++i)
            visit_mappings(node[i], item_path(path, i), visit);
    }
}

void require_sound_keys(const YAML::Node& mapping, const std::string& path,
                        const std::string& file) {
    if (mapping.size() > max_keys)
        throw ConfigError({file, line_of(mapping), path},
                          fmt::format("has more than {} keys", max_keys));
    std::map<std::string, int> first_line;
    for (const auto& entry : mapping) {
        const YAML::Node& key = entry.first;
        if (!key.IsScalar() || key.Scalar().size() > max_key_bytes ||
            printable(key.Scalar()) != key.Scalar())
            throw ConfigError({file, line_of(key), path}, "a key must be a word");
        const auto [seen, is_new] = first_line.emplace(key.Scalar(), line_of(key));
        if (!is_new)
            throw ConfigError({file, line_of(key), join(path, key.Scalar())},
                              fmt::format("doubled key, first given in line {}", seen->second));
    }
}

}  // namespace

ReadTrace::ReadTrace() {
    active_trace = this;
}

ReadTrace::~ReadTrace() {
    active_trace = nullptr;
}

Value::Value(std::shared_ptr<YAML::Node> node, std::string path, std::shared_ptr<Shared> shared)
    : node_(std::move(node)), path_(std::move(path)), shared_(std::move(shared)) {}

Value Value::of_foreign_file(const std::string& text, const std::string& file) {
    return Value(std::make_shared<YAML::Node>(parse_yaml(text, file)), "",
                 std::make_shared<Shared>(Shared{file, {}, {}, nullptr, true}));
}

Value Value::child(const YAML::Node& node, std::string path) const {
    return Value(std::make_shared<YAML::Node>(node), std::move(path), shared_);
}

void Value::note(ReadEvent event) const {
    if (!shared_->trace)
        return;
    event.path = path_;
    event.is_name = names_;
    shared_->trace->events.push_back(std::move(event));
}

Value Value::with_names() const {
    Value same = *this;
    same.names_ = true;
    return same;
}

Value Value::at(std::string_view key) const {
    note({.question = ReadEvent::Question::required_key, .key = std::string(key)});
    if (auto value = look_up(key))
        return *value;
    throw ConfigError({shared_->file, line_of(*node_), join(path_, std::string(key))}, "missing");
}

std::optional<Value> Value::find(std::string_view key) const {
    note({.question = ReadEvent::Question::optional_key, .key = std::string(key)});
    return look_up(key);
}

std::optional<Value> Value::look_up(std::string_view key) const {
    if (!node_->IsMap())
        fail("must be a mapping (key: value)");
    const std::string word(key);
    shared_->known[path_].push_back(word);
    const std::string path = join(path_, word);
    std::optional<YAML::Node> found;
    // Walked by hand: looking up by operator[] would convert keys and could change the node.
    for (const auto& entry : *node_) {
        if (entry.first.Scalar() != word)
            continue;
        if (found)  // of a foreign file: ours are looked through when they are opened
            throw ConfigError({shared_->file, line_of(entry.first), path}, "doubled key");
        found.emplace(entry.second);
    }
    if (!found || (shared_->is_foreign && found->IsNull()))
        return std::nullopt;
    shared_->asked.insert(path);
    return child(*found, path);
}

double Value::number_or_zero(std::string_view key, Range range) const {
    const auto value = find(key);
    return value ? value->number(range) : 0.0;
}

std::vector<std::string> Value::keys() const {
    if (!node_->IsMap())
        fail("must be a mapping (key: value)");
    std::vector<std::string> keys;
    for (const auto& entry : *node_)
        keys.push_back(entry.first.Scalar());
    return keys;
}

std::vector<Value> Value::items() const {
    note({.question = ReadEvent::Question::items});
    if (!node_->IsSequence())
        fail("must be a list");
    std::vector<Value> items;
    for (std::size_t i = 0; i < node_->size(); ++i)
        items.push_back(child((*node_)[i], item_path(path_, i)));
    return items;
}

double Value::number(Range range) const {
    note({.question = ReadEvent::Question::number, .range = range});
    return finite_number(range);
}

double Value::finite_number(Range range) const {
    // yaml-cpp tags quoted scalars with "!", plain ones with "?".
    if (!node_->IsScalar() || (node_->Tag() == "!" && !shared_->is_foreign))
        fail("must be a number");
    const auto value = parse_number(node_->Scalar());
    if (!value)
        fail(fmt::format("must be a finite number, not '{}'{}", node_->Scalar(),
                         number_hint(node_->Scalar())));
    if (!range.contains(*value))
        fail(fmt::format("must be {}, not {}", range.words(), *value));
    return *value;
}

int Value::integer(int low, int high) const {
    const Range range{static_cast<double>(low), static_cast<double>(high)};
    note({.question = ReadEvent::Question::integer, .range = range});
    const double value = finite_number(range);
    if (value != std::floor(value))
        fail(fmt::format("must be a whole number, not {}", value));
    return static_cast<int>(value);
}

bool Value::flag() const {
    note({.question = ReadEvent::Question::flag});
    const std::string word = scalar();
    if (word != "true" && word != "false")
        fail(fmt::format("must be true or false, not '{}'", word));
    return word == "true";
}

std::string Value::text() const {
    note({.question = ReadEvent::Question::text});
    return scalar();
}

std::string Value::scalar() const {
    if (!node_->IsScalar())
        fail("must be a single word or text");
    std::string text = node_->Scalar();
    if (text.ends_with('\n'))  // of a block, "about: >"
        text.pop_back();
    require_utf8(text, place());  // yaml-cpp 0.7 makes a byte 0x85 of the escape \N
    if (printable(text) != text)
        fail(fmt::format("must be a line of text: '{}' holds a control character", text));
    return text;
}

std::string Value::one_of(std::initializer_list<std::string_view> words) const {
    if (shared_->trace)  // for it alone the words are copied
        note({.question = ReadEvent::Question::words, .words = {words.begin(), words.end()}});
    const std::string word = scalar();
    std::string allowed;
    for (const std::string_view candidate : words) {
        if (word == candidate)
            return word;
        allowed += (allowed.empty() ? "" : ", ") + std::string(candidate);
    }
    fail(fmt::format("must be one of {}; not '{}'", allowed, word));
}

std::vector<double> Value::numbers(std::size_t count, Range range) const {
    std::vector<double> numbers;
    for (const Value& item : items())
        numbers.push_back(item.number(range));
    if (count != 0 && numbers.size() != count)
        fail(fmt::format("must have {} numbers, not {}{}", count, numbers.size(),
                         numbers.size() > count ? "; a decimal point is a dot" : ""));
    return numbers;
}

bool Value::is_mapping() const {
    return node_->IsMap();
}
bool Value::is_list() const {
    return node_->IsSequence();
}
bool Value::is_scalar() const {
    return node_->IsScalar();
}

SourcePlace Value::place() const {
    return {shared_->file, line_of(*node_), path_};
}

void Value::fail(const std::string& message) const {
    throw ConfigError(place(), message);
}

StrictFile::StrictFile(const std::filesystem::path& path, std::string_view kind)
    : StrictFile(read_text(path), path, kind) {}

StrictFile StrictFile::from_text(const std::string& text, const std::string& name,
                                 std::string_view kind) {
    return StrictFile(text, std::filesystem::path(name), kind);
}

StrictFile::StrictFile(const std::string& text, const std::filesystem::path& path,
                       std::string_view kind)
    : path_(path),
      root_(std::make_shared<YAML::Node>(parse_yaml(text, path.string())), "",
            std::make_shared<Value::Shared>(
                Value::Shared{path.string(), {}, {}, traced_file(kind), false})) {
    visit_mappings(*root_.node_, "", [&](const std::string& at, const YAML::Node& mapping) {
        require_sound_keys(mapping, at, path.string());
    });
    if (!root_.node_->IsMap())
        throw ConfigError({path.string(), 1}, fmt::format("must begin with 'etalon: {}'", kind));
    if (!root_.look_up("etalon"))
        throw ConfigError({path.string(), 1}, fmt::format("must begin with 'etalon: {}'", kind));
    const Value declared = root_.at("etalon");
    if (declared.text() != kind)
        declared.fail(fmt::format("must be '{}', not '{}'", kind, declared.text()));
}

std::filesystem::path StrictFile::resolve(const std::string& relative) const {
    return path_.parent_path() / relative;
}

void StrictFile::finish() const {
    const Value::Shared& shared = *root_.shared_;
    if (shared.trace)
        shared.trace->is_whole = true;
    visit_mappings(*root_.node_, "", [&](const std::string& path, const YAML::Node& mapping) {
        for (const auto& entry : mapping) {
            const std::string full = join(path, entry.first.Scalar());
            if (shared.asked.contains(full))
                continue;
            const auto known = shared.known.find(path);
            const std::string meant = known == shared.known.end()
                                          ? ""
                                          : nearest_word(entry.first.Scalar(), known->second);
            // "{fx: 275,5}" is fx of 275 and a key 5 without a value.
            const bool is_decimals = entry.second.IsNull() && parse_number(entry.first.Scalar());
            throw ConfigError({shared.file, line_of(entry.first), full},
                              is_decimals     ? "unknown key; a decimal point is a dot"
                              : meant.empty() ? "unknown key"
                                              : "unknown key; did you mean '" + meant + "'?");
        }
    });
}

bool is_etalon_file(const std::filesystem::path& path) {
    for (const std::string& line : split(read_text(path), '\n')) {
        const std::string_view text = trimmed(line);
        if (text.starts_with("etalon:") || text.starts_with("\"etalon\":"))
            return true;
        const bool opens_json = text.starts_with("{");
        if (opens_json && text.find("\"etalon\"") != std::string_view::npos)
            return true;
        if (!text.empty() && !text.starts_with("#") && text != "---" && text != "{")
            return false;
    }
    return false;
}

}  // namespace etalon
