// Command lines of `etalon`, an argument a line: all commands with all their options, of which none
// is run. Then the arguments that commands take apart themselves.
#include "sim/marker/marker.h"
#include "sim/scene/pose_file.h"
#include "station/commands.h"
#include "study/study_results.h"
#include "tests/fuzz/coverage/fuzz_input.h"

namespace etalon::test {
namespace {

void parse(std::vector<std::string> arguments) {
    std::vector<char*> words{const_cast<char*>("etalon")};
    for (std::string& argument : arguments)
        words.push_back(argument.data());
    const auto version = [] { return std::string("etalon"); };
    const auto command = parse_command_line(static_cast<int>(words.size()), words.data(),
                                            {"summary", "footer", version}, declare_commands);
    require(static_cast<bool>(command), "a command line without a command");
}

std::vector<std::string> lines_of(std::string_view text) {
    std::vector<std::string> lines(1);
    for (const char c : text)
        if (c == '\n')
            lines.emplace_back();
        else if (c != '\0')
            lines.back() += c;
    return lines;
}

}  // namespace
}  // namespace etalon::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace etalon;
    using namespace etalon::test;
    const std::vector<std::string> arguments = lines_of(text_of(data, size));
    read_or_refuse([&] { parse(arguments); });
    const std::string& last = arguments.back();
    read_or_refuse(
        [&] { require(!parse_marker(last, "--marker").points_mm.empty(), "no points"); });
    read_or_refuse(
        [&] { require(parse_pose(last, "--pose").rotation.coeffs().allFinite(), "no pose"); });
    read_or_refuse([&] { require(parse_shard(last).count > 0, "no shard"); });
    return 0;
}
