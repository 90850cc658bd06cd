// `etalon qualify`, `report` and `demo`. What `qualify` is asked, and the function that carries it
// out: it returns the verdict's exit code or throws (core/program/errors.h), prints its stable
// words and
// --json on stdout and everything else on stderr.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace etalon {

class Command;

struct QualifyArguments {
    std::filesystem::path station, out;
    std::filesystem::path calibration;  // in place of the one that the station names
    std::filesystem::path resume;       // in place of out: the record to go on with
    std::vector<std::string> twin;  // arguments of the etalon-twin to start for the run; or none
    std::string operator_name;      // for the record
    bool homed = false;             // the operator's word, Stage::take_for_homed()
    bool json = false;
};
int run_qualify(const QualifyArguments& arguments);

void declare_qualify(Command& program);
void declare_report(Command& program);
void declare_demo(Command& program);

}  // namespace etalon
