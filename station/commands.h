// All commands of `etalon`.
#pragma once

#include "station/shell/command.h"

namespace etalon {

// In the order of the help.
void declare_commands(Command& program);

// `etalon completion`, which is asked about all of them.
void declare_completion(Command& program);

void declare_schema(Command& program);

// ---- what may stand next on a command line, for the completion of shells

// The words of an option, of an argument ("STATION") or of all options of that name, from the
// tables of the program; a word that ends with a colon goes on. Files stand for themselves:
// ":files yaml|yml" for those with such an end, ":files" for any, ":folders".
std::vector<std::string> words_of_value(const DescribedOption& option);

// The candidates for the last of `words`, which stand behind the program's name: "WORD\tHELP", and
// ":files ...", ":folders" in place of names of files. `words` may be empty.
std::vector<std::string> completed_words(const DescribedCommand& program,
                                         const std::vector<std::string>& words);

// Every command as it is typed, "camera convert\tHELP"; no groups.
std::vector<std::string> command_lines(const DescribedCommand& program);

}  // namespace etalon
