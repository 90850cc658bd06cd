#include "stage/profile.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <set>

#include "core/strict_reader.h"
#include "core/text.h"
#include "stage/builtin_profiles.h"

namespace etalon {
namespace {

constexpr double deg_per_rad = 180.0 / std::numbers::pi;
constexpr int max_address = 65535;
// Registers in one request: Modbus Application Protocol V1.1b3, 6.3 and 6.12.
constexpr int max_read = 125, max_write = 123;

int read_address(const Value& value) {
    return value.integer(0, max_address);
}

std::chrono::milliseconds read_ms(const Value& value, int low) {
    return std::chrono::milliseconds(value.integer(low, 3'600'000));
}

// Bit numbers by name, each used once.
template <class Bits, class Member>
void read_bits(const Value& mapping, Bits& bits,
               std::initializer_list<std::pair<const char*, Member>> members) {
    std::set<int> used;
    for (const auto& [key, member] : members) {
        const Value value = mapping.at(key);
        bits.*member = value.integer(0, 15);
        if (!used.insert(bits.*member).second)
            value.fail(fmt::format("bit {} is used twice", bits.*member));
    }
}

// Where registers of a group are: `count` of them from `offset`.
struct Member {
    const char* key;
    int offset, count;
};

void require_separate(const Value& group, int stride, const std::vector<Member>& members) {
    std::set<int> used;
    for (const Member& member : members) {
        for (int i = 0; i < member.count; ++i) {
            if (member.offset + i >= stride)
                group.at(member.key).fail(fmt::format("does not fit into the stride {}", stride));
            if (!used.insert(member.offset + i).second)
                group.at(member.key).fail("overlaps with another register of its group");
        }
    }
}

// All axes' groups have to fit into one request and below the last address.
void require_one_request(const Value& group, int address, int registers, int most) {
    if (registers > most)
        group.fail(fmt::format("{} registers do not fit into one request of {}", registers, most));
    if (address + registers - 1 > max_address)
        group.fail(fmt::format("reaches beyond register {}", max_address));
}

void read_poll(const Value& group, StageProfile& profile) {
    auto& poll = profile.poll;
    poll.address = read_address(group.at("address"));
    poll.stride = group.at("stride").integer(4, max_read);
    poll.status = group.at("status").integer(0, max_read);
    poll.alarm = group.at("alarm").integer(0, max_read);
    poll.position = group.at("position").integer(0, max_read);
    require_separate(
        group, poll.stride,
        {{"status", poll.status, 1}, {"alarm", poll.alarm, 1}, {"position", poll.position, 2}});
    require_one_request(group, poll.address, profile.max_axes * poll.stride, max_read);
}

void read_move(const Value& group, StageProfile& profile) {
    auto& move = profile.move;
    move.address = read_address(group.at("address"));
    // Every register of the block is written, so there may be no gap.
    move.stride = group.at("stride").integer(4, 4);
    move.target = group.at("target").integer(0, max_write);
    move.speed = group.at("speed").integer(0, max_write);
    require_separate(group, move.stride, {{"target", move.target, 2}, {"speed", move.speed, 2}});
    require_one_request(group, move.address, profile.max_axes * move.stride, max_write);
}

void read_command(const Value& group, StageProfile& profile) {
    using Command = StageProfile::Command;
    profile.command.address = read_address(group.at("address"));
    read_bits<Command, int Command::*>(group, profile.command,
                                       {{"enable", &Command::enable},
                                        {"home", &Command::home},
                                        {"start", &Command::start},
                                        {"stop", &Command::stop},
                                        {"reset", &Command::reset}});
}

void read_status_bits(const Value& group, StageProfile& profile) {
    using Bits = StageProfile::StatusBits;
    read_bits<Bits, int Bits::*>(group, profile.status_bits,
                                 {{"enabled", &Bits::enabled},
                                  {"homed", &Bits::homed},
                                  {"moving", &Bits::moving},
                                  {"in_position", &Bits::in_position},
                                  {"alarm", &Bits::alarm}});
}

void read_watchdog(const Value& group, StageProfile& profile) {
    // Less than a second could expire while one request is repeated.
    profile.watchdog = {read_address(group.at("address")),
                        std::chrono::milliseconds(group.at("timeout_ms").integer(1000, 65535))};
}

void read_done(const Value& group, StageProfile& profile) {
    profile.done.tolerance_mm = group.at("tolerance_um").number(positive) * 1e-3;
    profile.done.tolerance_deg = group.at("tolerance_deg").number(positive);
    profile.done.stable_polls = group.at("stable_polls").integer(1, 1000);
    profile.done.settle = read_ms(group.at("settle_ms"), 0);
}

void read_limits(const Value& group, StageProfile& profile) {
    profile.limits.enable = read_ms(group.at("enable_ms"), 1);
    profile.limits.home = read_ms(group.at("home_ms"), 1);
    profile.limits.move_margin = read_ms(group.at("move_margin_ms"), 1);
    profile.limits.move_factor = group.at("move_factor").number({1.0, 100.0});
}

void read_alarms(const Value& group, StageProfile& profile) {
    for (const std::string& key : group.keys()) {
        const auto code = parse_integer(key);
        if (!code || *code < 1 || *code > 65535)
            group.at(key).fail("an alarm's key must be its code, 1 to 65535");
        profile.alarms[static_cast<int>(*code)] = group.at(key).text();
    }
}

// No register may mean two things.
void require_separate_blocks(const Value& root, const StageProfile& profile) {
    struct Block {
        const char* key;
        int first, count;
    };
    std::vector<Block> blocks = {
        {"poll", profile.poll.address, profile.max_axes * profile.poll.stride},
        {"move", profile.move.address, profile.max_axes * profile.move.stride},
        {"command", profile.command.address, 1}};
    if (profile.watchdog)
        blocks.push_back({"watchdog", profile.watchdog->address, 1});
    for (std::size_t i = 0; i < blocks.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            const Block &a = blocks[j], &b = blocks[i];
            if (a.first < b.first + b.count && b.first < a.first + a.count)
                root.at(b.key).fail(fmt::format("overlaps with the registers of '{}'", a.key));
        }
    }
}

StageProfile read_profile(const StrictFile& file) {
    const Value root = file.root();
    StageProfile profile;
    profile.name = root.at("name").text();
    profile.max_axes = root.at("max_axes").integer(1, 31);
    profile.counts_per_mm = root.at("counts").at("per_mm").number(positive);
    profile.counts_per_deg = root.at("counts").at("per_deg").number(positive);
    read_poll(root.at("poll"), profile);
    read_status_bits(root.at("status_bits"), profile);
    read_move(root.at("move"), profile);
    read_command(root.at("command"), profile);
    if (const auto group = root.find("watchdog"))
        read_watchdog(*group, profile);
    read_done(root.at("done"), profile);
    read_limits(root.at("limits"), profile);
    if (const auto group = root.find("alarms"))
        read_alarms(*group, profile);
    require_separate_blocks(root, profile);
    file.finish();
    return profile;
}

}  // namespace

double StageProfile::counts_per_unit(const Axis& axis) const {
    return axis.kind == Axis::Kind::linear ? counts_per_mm : counts_per_deg * deg_per_rad;
}

double StageProfile::tolerance(const Axis& axis) const {
    return axis.kind == Axis::Kind::linear ? done.tolerance_mm : done.tolerance_deg / deg_per_rad;
}

std::string StageProfile::describe_alarm(int code) const {
    const auto known = alarms.find(code);
    return known == alarms.end() ? fmt::format("alarm {}", code)
                                 : fmt::format("alarm {} ({})", code, known->second);
}

StageProfile read_stage_profile(const std::filesystem::path& path) {
    return read_profile(StrictFile(path, "stage-profile/1"));
}

StageProfile stage_profile_from_text(const std::string& text, const std::string& name) {
    return read_profile(StrictFile::from_text(text, name, "stage-profile/1"));
}

std::vector<std::string> builtin_stage_profile_names() {
    std::vector<std::string> names;
    for (const auto& entry : builtin_profile_texts())
        names.push_back(entry.first);
    return names;
}

StageProfile builtin_stage_profile(const std::string& name) {
    const auto found = builtin_profile_texts().find(name);
    if (found == builtin_profile_texts().end())
        throw ConfigError({"stage profile"},
                          fmt::format("there is no profile '{}'; known: {}", name,
                                      fmt::join(builtin_stage_profile_names(), ", ")));
    return stage_profile_from_text(found->second, name + ".yaml (built in)");
}

}  // namespace etalon
