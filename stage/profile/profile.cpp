#include "stage/profile/profile.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "core/file/text.h"
#include "stage/profile/profile_layers.h"

namespace etalon {
namespace {

// Signed: an axis may count backwards.
double counts_per_unit(const StageProfile& profile, const Axis& axis) {
    if (axis.counts_per_unit)
        return *axis.counts_per_unit;
    const bool linear = axis.kind == Axis::Kind::linear;
    const auto given = linear ? profile.counts.per_mm : profile.counts.per_deg;
    if (!given)
        throw ConfigError({"stage axes", 0, axis.name},
                          fmt::format("profile '{}' needs its {}", profile.name,
                                      linear ? "counts_per_mm" : "counts_per_deg"));
    return linear ? *given : *given * deg_per_rad;
}

// Of a speed register, per mm/s or rad/s.
double speed_factor(const StageProfile& profile, const Axis& axis) {
    if (profile.speed.unit == StageProfile::Speed::Unit::counts_per_s)
        return std::abs(counts_per_unit(profile, axis)) / profile.speed.step;
    if (!axis.lead)
        throw ConfigError({"stage axes", 0, axis.name},
                          fmt::format("profile '{}' needs its {}", profile.name,
                                      axis.kind == Axis::Kind::linear ? "lead_mm" : "lead_deg"));
    return 60.0 / *axis.lead / profile.speed.step;
}

}  // namespace

const char* name_of(Signal signal) {
    return signal_words[static_cast<std::size_t>(signal)];
}

const char* name_of(Input input) {
    return input_words[static_cast<std::size_t>(input)];
}

int TargetBlock::size() const {
    int count = 0;
    for (const Field& field : fields)
        count += registers_of(field.type);
    return count;
}

bool starts_motion(const StageProfile& profile, const Step& step) {
    if (step.kind == Step::Kind::set || step.kind == Step::Kind::pulse)
        return step.input == Input::home || step.input == Input::start;
    return step.kind == Step::Kind::write &&
           std::ranges::any_of(profile.target, &TargetBlock::starts);
}

double StageProfile::counts_of(const Axis& axis, double mm_or_rad) const {
    return counts.offset + counts.sign * counts_per_unit(*this, axis) * mm_or_rad;
}

double StageProfile::position_of(const Axis& axis, double number) const {
    return (number - counts.offset) / (counts.sign * counts_per_unit(*this, axis));
}

double StageProfile::register_of_speed(const Axis& axis, double mm_or_rad_per_s) const {
    return mm_or_rad_per_s * speed_factor(*this, axis);
}

double StageProfile::speed_of_register(const Axis& axis, double number) const {
    return number / speed_factor(*this, axis);
}

double StageProfile::tolerance(const Axis& axis) const {
    return axis.kind == Axis::Kind::linear ? done.tolerance_mm : done.tolerance_deg / deg_per_rad;
}

std::string StageProfile::describe_alarm(int code) const {
    if (code < 0)
        return "alarm without a code";
    const auto known = alarms.find(code);
    return known == alarms.end() ? fmt::format("alarm {}", code)
                                 : fmt::format("alarm {} ({})", code, known->second);
}

StageProfile named_stage_profile(const std::string& name) {
    return name.ends_with(".yaml") ? read_stage_profile(name) : builtin_stage_profile(name);
}

namespace {

constexpr auto kind = "stage-profile/1";
constexpr std::size_t deepest = 8;  // profiles that extend each other

std::chrono::milliseconds read_ms(const Value& value, int low) {
    return std::chrono::milliseconds(value.integer(low, 3'600'000));
}

std::vector<std::string> read_texts(const Layers& root, const std::string& key) {
    std::vector<std::string> texts;
    if (const auto list = root.find(key))
        for (const Value& item : list->items())
            texts.push_back(item.text());
    return texts;
}

// {per_mm: 100, per_deg: 100} or {from: axis}; {sign, offset}
void read_counts(const Layers& section, StageProfile::Counts& counts) {
    if (const auto from = section.find("from")) {
        from->one_of({"axis"});
    } else {
        counts.per_mm = section.at("per_mm").number(units::counts.positive());
        counts.per_deg = section.at("per_deg").number(units::counts.positive());
    }
    if (const auto sign = section.find("sign"))
        counts.sign = sign->one_of({"1", "-1"}) == "1" ? 1.0 : -1.0;
    if (const auto offset = section.find("offset"))
        counts.offset = offset->number(units::counts.either_sign());
}

void read_speed(const Layers& section, StageProfile::Speed& speed) {
    using Unit = StageProfile::Speed::Unit;
    const std::string unit = section.at("unit").one_of({"counts_per_s", "rpm"});
    speed.unit = unit == "rpm" ? Unit::rpm : Unit::counts_per_s;
    if (const auto step = section.find("step"))
        speed.step = step->number(units::one.positive());
}

void read_done(const Layers& section, StageProfile& profile) {
    auto& done = profile.done;
    const Value in_position = section.at("in_position");
    done.in_position = in_position.flag();
    if (done.in_position && !profile.has(Signal::in_position))
        in_position.fail("signal 'in_position' is unavailable");
    done.start_seen = section.at("start_seen").flag();
    done.tolerance_mm = section.at("tolerance_um").number(units::um.positive()) * 1e-3;
    done.tolerance_deg = section.at("tolerance_deg").number(units::deg.positive());
    done.stable_polls = section.at("stable_polls").integer(1, 1000);
    done.settle = read_ms(section.at("settle_ms"), 0);
}

void read_limits(const Layers& section, StageProfile::Limits& limits) {
    limits.move_factor = section.at("move_factor").number({1.0, 100.0});
    limits.move_margin = read_ms(section.at("move_margin_ms"), 1);
}

void read_alarms(const Layers& section, StageProfile& profile) {
    for (const std::string& key : section.keys()) {
        const auto code = parse_integer(key);
        if (!code || *code < 1 || *code > 65535)
            section.at(key).fail("an alarm's key must be its code, 1 to 65535");
        profile.alarms[static_cast<int>(*code)] = section.at(key).text();
    }
}

StageProfile read_profile(const Layers& root) {
    StageProfile profile;
    profile.name = root.at("name").text();
    profile.about = root.at("about").text();
    profile.confirmed = read_texts(root, "confirmed");
    profile.unconfirmed = read_texts(root, "unconfirmed");
    profile.max_axes = root.at("max_axes").integer(1, 31);
    if (const auto link = root.find("link"))
        profile.link = read_link_defaults(*link);
    profile.word_order = read_word_order(root.at("word_order"));
    read_counts(root.section("counts"), profile.counts);
    read_speed(root.section("speed"), profile.speed);
    read_profile_registers(root, profile);
    read_profile_sequences(root, profile);
    read_done(root.section("done"), profile);
    read_limits(root.section("limits"), profile.limits);
    if (const auto alarms = root.find_section("alarms"))
        read_alarms(alarms->with_names(), profile);
    return profile;
}

StrictFile builtin_file(const std::string& name, const std::string& text) {
    return StrictFile::from_text(text, name + ".yaml (built in)", kind);
}

// Beside the file that extends it, or built in.
StrictFile open_base(const StrictFile& file, const Value& extends) {
    const std::string name = extends.text();
    const auto beside = file.resolve(name + ".yaml");
    std::error_code none;
    if (std::filesystem::exists(beside, none))
        return StrictFile(beside, kind);
    const auto found = builtin_profile_texts().find(name);
    if (found == builtin_profile_texts().end())
        extends.fail(
            fmt::format("there is no '{}' and no built-in profile '{}'", beside.string(), name));
    return builtin_file(name, found->second);
}

StageProfile read_with_bases(const StrictFile& file) {
    std::vector<StrictFile> files = {file};
    std::vector<Value> roots = {file.root()};
    while (const auto extends = roots.back().find("extends")) {
        if (roots.size() == deepest)
            extends->fail(fmt::format("more than {} profiles extend each other", deepest));
        files.push_back(open_base(files.back(), *extends));
        roots.push_back(files.back().root());
    }
    StageProfile profile = read_profile(Layers(roots));
    for (const StrictFile& each : files)
        each.finish();
    return profile;
}

}  // namespace

StageProfile read_stage_profile(const std::filesystem::path& path) {
    return read_with_bases(StrictFile(path, kind));
}

StageProfile stage_profile_from_text(const std::string& text, const std::string& name) {
    return read_with_bases(StrictFile::from_text(text, name, kind));
}

std::vector<std::string> builtin_stage_profile_names() {
    std::vector<std::string> names;
    for (const auto& [name, text] : builtin_profile_texts())
        if (!name.starts_with("base/"))
            names.push_back(name);
    return names;
}

StageProfile builtin_stage_profile(const std::string& name) {
    const auto found = builtin_profile_texts().find(name);
    if (found == builtin_profile_texts().end())
        throw ConfigError({"stage profile"},
                          fmt::format("there is no profile '{}'; known: {}", name,
                                      fmt::join(builtin_stage_profile_names(), ", ")));
    return read_with_bases(builtin_file(name, found->second));
}

}  // namespace etalon
