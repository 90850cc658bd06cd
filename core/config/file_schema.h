// JSON Schema (draft 2020-12) of our kinds of files, for editors, made of what the strict reader
// asked while files were read. It has the keys and ranges that those files led to, but not what one
// key says about another (existing files, low < high, keys that need each other).
#pragma once

#include <map>

#include "core/config/strict_reader.h"

namespace etalon {

// One question of the strict reader to a value, at its dotted path: "axes[1].name".
struct ReadEvent {
    enum class Question { required_key, optional_key, items, number, integer, flag, text, words };

    Question question;
    std::string path = {}, key = {};  // key: of the first two
    bool is_name = false;             // the key is a name that the file gives, no word of ours
    Range range = {};                 // of numbers
    std::vector<std::string> words = {};
};

// Notes what this thread's strict files are asked while it exists, refused ones too. One at a time.
class ReadTrace {
public:
    ReadTrace();
    ~ReadTrace();
    ReadTrace(const ReadTrace&) = delete;
    ReadTrace& operator=(const ReadTrace&) = delete;

    struct File {
        std::string kind;  // "camera/1"
        std::vector<ReadEvent> events;
        bool is_whole = false;  // read to its end, StrictFile::finish()
    };
    std::vector<std::shared_ptr<File>> files;  // in the order in which they were opened
};

// By kind, "camera/1", of files that were read to their end, without an error. A key is required if
// the reader wanted it in every mapping of its place.
std::map<std::string, std::string> file_schemas(const ReadTrace& trace);

// Each as FOLDER/NAME.json, "camera.json"; the folder is made.
void write_schemas(const ReadTrace& trace, const std::filesystem::path& folder);

}  // namespace etalon
