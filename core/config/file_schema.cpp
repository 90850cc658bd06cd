#include "core/config/file_schema.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "core/file/file_writing.h"
#include "core/file/text.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

// All that was asked of the values at one place of a kind of file. The same place in a list's
// items, and under names that files give, is one.
struct Place {
    std::vector<std::pair<std::string, std::unique_ptr<Place>>> keys;  // as first asked for
    std::unique_ptr<Place> named, item;
    std::vector<ordered_json> scalars;  // what a scalar may be

    int mappings = 0;                        // that were looked into
    std::map<std::string, int> required_in;  // of them
    std::set<std::string> asked_now;         // of the last one, whose path and file are:
    std::string path;
    const void* file = nullptr;
};

Place& key_of(Place& place, const std::string& key) {
    const auto found =
        std::ranges::find(place.keys, key, [](const auto& one) { return one.first; });
    if (found != place.keys.end())
        return *found->second;
    return *place.keys.emplace_back(key, std::make_unique<Place>()).second;
}

Place& made(std::unique_ptr<Place>& place) {
    if (!place)
        place = std::make_unique<Place>();
    return *place;
}

// One kind of file, filled with the events of one file after the other.
class KindOfFile {
public:
    void add(const ReadTrace::File& file) {
        known_ = {{"", &root_}};
        for (const ReadEvent& event : file.events)
            add(event, &file);
    }
    const Place& root() const { return root_; }

private:
    using Question = ReadEvent::Question;

    // "axes[1]" is asked before anything below it, and "axes" before that.
    Place& place_at(const std::string& path) {
        const auto found = known_.find(path);
        if (found != known_.end())
            return *found->second;
        Place& item = made(place_at(path.substr(0, path.rfind('['))).item);
        known_[path] = &item;
        return item;
    }

    void add(const ReadEvent& event, const void* file) {
        Place& place = place_at(event.path);
        switch (event.question) {
            case Question::required_key:
            case Question::optional_key:
                return add_key(place, event, file);
            case Question::items:
                made(place.item);
                return;
            default:
                break;
        }
        const ordered_json scalar = scalar_schema(event);
        if (std::ranges::count(place.scalars, scalar) == 0)
            place.scalars.push_back(scalar);
    }

    void add_key(Place& place, const ReadEvent& event, const void* file) {
        if (place.file != file || place.path != event.path) {
            ++place.mappings;
            place.asked_now.clear();
            place.file = file;
            place.path = event.path;
        }
        Place& key = event.is_name ? made(place.named) : key_of(place, event.key);
        known_[event.path.empty() ? event.key : event.path + "." + event.key] = &key;
        // A key that the reader first looks for is optional, however it then reads it.
        const bool is_wanted = event.question == Question::required_key && !event.is_name;
        if (place.asked_now.insert(event.key).second && is_wanted)
            ++place.required_in[event.key];
    }

    static ordered_json number_schema(const Range& range, const char* type) {
        ordered_json schema = {{"type", type}};
        if (std::isfinite(range.low))
            schema[range.open_low ? "exclusiveMinimum" : "minimum"] = range.low;
        if (std::isfinite(range.high))
            schema["maximum"] = range.high;
        if (*range.unit != '\0')
            schema["description"] = std::string("in ") + range.unit;
        return schema;
    }

    // A word that looks like a number, "-1", is one to whoever reads YAML by the book.
    static ordered_json as_editors_read(const std::vector<std::string>& words) {
        ordered_json values = words;
        for (const std::string& word : words)
            if (const auto number = parse_integer(word))
                values.push_back(*number);
        return values;
    }

    static ordered_json scalar_schema(const ReadEvent& event) {
        switch (event.question) {
            case Question::number:
                return number_schema(event.range, "number");
            case Question::integer:
                return number_schema(event.range, "integer");
            case Question::flag:
                return {{"enum", {true, false, "true", "false"}}};
            case Question::words:
                return {{"enum", as_editors_read(event.words)}};
            default:  // a text may look like a number
                return {{"type", {"string", "number", "boolean"}}};
        }
    }

    Place root_;
    std::map<std::string, Place*> known_;  // by path in the present file
};

// A file that may extend another needs no keys; `key: ~` removes one; lists are never merged.
ordered_json schema_of(const Place& place, bool extends);

ordered_json mapping_schema(const Place& place, bool extends) {
    ordered_json properties = ordered_json::object(), required = ordered_json::array();
    for (const auto& [name, value] : place.keys) {
        properties[name] = schema_of(*value, extends);
        const auto wanted = place.required_in.find(name);
        if (!extends && wanted != place.required_in.end() && wanted->second == place.mappings)
            required.push_back(name);
    }
    ordered_json schema = {{"type", "object"}, {"properties", properties}};
    if (!required.empty())
        schema["required"] = required;
    schema["additionalProperties"] =
        place.named ? schema_of(*place.named, extends) : ordered_json(false);
    return schema;
}

ordered_json schema_of(const Place& place, bool extends) {
    std::vector<ordered_json> choices = place.scalars;
    if (!place.keys.empty() || place.named)
        choices.push_back(mapping_schema(place, extends));
    if (place.item)
        choices.push_back({{"type", "array"}, {"items", schema_of(*place.item, false)}});
    if (extends && !choices.empty())
        choices.push_back({{"type", "null"}});
    if (choices.size() == 1)
        return choices.front();
    return choices.empty() ? ordered_json::object() : ordered_json{{"anyOf", choices}};
}

}  // namespace

std::map<std::string, std::string> file_schemas(const ReadTrace& trace) {
    std::map<std::string, KindOfFile> kinds;
    for (const auto& file : trace.files)
        if (file->is_whole)
            kinds[file->kind].add(*file);
    std::map<std::string, std::string> schemas;
    for (const auto& [kind, file] : kinds) {
        ordered_json schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                               {"title", "etalon: " + kind}};
        const bool extends = std::ranges::count(file.root().keys, "extends",
                                                [](const auto& key) { return key.first; });
        schema.update(mapping_schema(file.root(), extends));
        schema["properties"]["etalon"] = {{"const", kind}};
        schemas[kind] = schema.dump(2) + "\n";
    }
    return schemas;
}

void write_schemas(const ReadTrace& trace, const std::filesystem::path& folder) {
    const FolderLock lock = claim_folder(folder);
    for (const auto& [kind, schema] : file_schemas(trace))
        write_text(folder / (kind.substr(0, kind.find('/')) + ".json"), schema);
}

}  // namespace etalon
