// What the strict reader was asked for while files were read: the keys, types and ranges that a
// kind of file has are stated nowhere but in the code that reads it, and this makes them visible
// (core/config/file_schema.h).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/config/range.h"

namespace etalon {

// One question to a value, at its dotted path: "axes[1].name".
struct ReadEvent {
    enum class Question { required_key, optional_key, items, number, integer, flag, text, words };

    Question question;
    std::string path = {}, key = {};  // key: of the first two
    bool is_name = false;             // the key is a name that the file gives, no word of ours
    Range range = {};                 // of numbers
    std::vector<std::string> words = {};
};

// Notes, from construction to destruction, what this thread's strict files are asked, those that
// are refused included. One at a time.
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

}  // namespace etalon
