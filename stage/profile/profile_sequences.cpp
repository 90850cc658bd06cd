#include <fmt/format.h>

#include "stage/profile/profile_layers.h"

namespace etalon {
namespace {

using Kind = Step::Kind;

constexpr std::chrono::milliseconds max_stop{3000};  // it also holds up whoever gives up

using Steps = std::span<const Step>;

bool gives(const Step& step, Input input) {
    return (step.kind == Kind::set || step.kind == Kind::pulse) && step.input == input;
}

bool give(Steps steps, Input input) {
    return std::ranges::any_of(steps, [=](const Step& step) { return gives(step, input); });
}

bool wait_for(Steps steps, Signal signal, bool on) {
    return std::ranges::any_of(steps, [=](const Step& step) {
        return step.kind == Kind::wait &&
               std::ranges::any_of(step.conditions, [=](const Condition& condition) {
                   return condition.signal == signal && condition.on == on;
               });
    });
}

std::ptrdiff_t count(Steps steps, Kind kind) {
    return std::ranges::count(steps, kind, &Step::kind);
}

void require(bool holds, const Value& at, const std::string& message) {
    if (!holds)
        at.fail(message);
}

class SequenceReader {
public:
    explicit SequenceReader(StageProfile& profile) : profile_(profile) {}

    void read(const Layers& root) {
        const Layers section = root.section("sequences");
        const auto steps_of = [&](const char* key) {
            std::vector<Step> steps;
            for (const Value& item : section.at(key).items())
                steps.push_back(read_step(item));
            return steps;
        };
        auto& sequences = profile_.sequences;
        sequences.enable = steps_of("enable");
        sequences.reset = steps_of("reset");
        sequences.home = steps_of("home");
        sequences.move = steps_of("move");
        sequences.stop = steps_of("stop");
        check_at_rest(section.at("enable"), sequences.enable);
        check_at_rest(section.at("reset"), sequences.reset);
        check_home(section.at("home"), sequences.home);
        check_move(section.at("move"), sequences.move);
        check_stop(section.at("stop"), sequences.stop);
        require(wait_for(sequences.reset, Signal::alarm, false), section.at("reset"),
                "must wait for 'not alarm'");
        for (const auto& [input, point] : profile_.inputs)
            require(std::ranges::count(used_, input) != 0,
                    root.section("inputs").at(name_of(input)), "is used in no sequence");
    }

private:
    Step read_step(const Value& item) {
        for (const auto& [key, kind] :
             {std::pair("set", Kind::set), std::pair("clear", Kind::clear),
              std::pair("pulse", Kind::pulse)})
            if (const auto input = item.find(key))
                return read_input_step(*input, kind);
        Step step;
        if (const auto written = item.find("write")) {
            written->one_of({"target"});
            step.kind = Kind::write;
        } else if (const auto required = item.find("require"))
            step.conditions = read_conditions(*required);
        else if (const auto wait = item.find("wait"))
            step = read_wait(item, *wait);
        else
            item.fail("must be one of set, clear, pulse, write, wait, require");
        return step;
    }

    Step read_input_step(const Value& value, Kind kind) {
        const std::string word = value.text();
        const auto known = std::ranges::find(input_words, word);
        if (known == std::end(input_words))
            value.fail(fmt::format("there is no input '{}'", word));
        const auto input = static_cast<Input>(known - input_words);
        const auto point = profile_.inputs.find(input);
        if (point == profile_.inputs.end())
            value.fail(fmt::format("this controller has no input '{}'", word));
        if (point->second.act == InputPoint::Act::code && kind != Kind::pulse)
            value.fail(fmt::format("'{}' is a code: it can only be pulsed", word));
        used_.push_back(input);
        return {.kind = kind, .input = input, .conditions = {}};
    }

    Step read_wait(const Value& item, const Value& wait) {
        if (wait.is_scalar()) {
            wait.one_of({"done"});
            return {.kind = Kind::wait_done, .conditions = {}};
        }
        Step step{.kind = Kind::wait, .conditions = read_conditions(wait)};
        step.within = std::chrono::milliseconds(item.at("within_ms").integer(1, 3'600'000));
        if (const auto held = item.find("for_ms"))
            step.held = std::chrono::milliseconds(held->integer(0, 60'000));
        return step;
    }

    std::vector<Condition> read_conditions(const Value& list) {
        std::vector<Condition> conditions;
        for (const Value& item : list.items())
            conditions.push_back(read_condition(item));
        if (conditions.empty())
            list.fail("must have at least one condition");
        return conditions;
    }

    Condition read_condition(const Value& value) {
        std::string word = value.text();
        const bool on = !word.starts_with("not ");
        if (!on)
            word.erase(0, 4);
        const auto known = std::ranges::find(signal_words, word);
        if (known == std::end(signal_words))
            value.fail(fmt::format("there is no signal '{}'", word));
        const auto signal = static_cast<Signal>(known - signal_words);
        if (!profile_.has(signal))
            value.fail(fmt::format("signal '{}' is unavailable", word));
        return {signal, on};
    }

    void check_at_rest(const Value& at, Steps steps) const {
        for (const Step& step : steps)
            require(!starts_motion(profile_, step) && step.kind != Kind::write &&
                        step.kind != Kind::wait_done,
                    at, "may not set anything in motion");
    }

    // Exactly one motion; returns the steps after its start.
    Steps after_only_start(const Value& at, Steps steps) const {
        const auto is_start = [this](const Step& step) { return starts_motion(profile_, step); };
        const auto starts = std::ranges::count_if(steps, is_start);
        require(starts == 1, at,
                fmt::format("must start a motion exactly once, not {} times", starts));
        return {std::ranges::find_if(steps, is_start) + 1, steps.end()};
    }

    void check_home(const Value& at, Steps steps) const {
        const Steps after = after_only_start(at, steps);
        require(give(steps, Input::home), at, "must give 'home'");
        require(wait_for(after, Signal::moving, false), at,
                "must wait for 'not moving' after the start");
        require(!profile_.has(Signal::homed) || wait_for(after, Signal::homed, true), at,
                "must wait for 'homed' after the start");
    }

    void check_move(const Value& at, Steps steps) const {
        const Steps after = after_only_start(at, steps);
        require(!give(steps, Input::home), at, "may not give 'home'");
        require(count(steps, Kind::write) == 1 && count(after, Kind::write) == 0, at,
                "must write the target once, not after the start");
        require(count(steps, Kind::wait_done) == 1 && count(after, Kind::wait_done) == 1, at,
                "must wait for 'done' once, after the start");
    }

    void check_stop(const Value& at, Steps steps) const {
        const auto first =
            std::ranges::find_if(steps, [](const Step& step) { return gives(step, Input::stop); });
        require(first != steps.end(), at, "must give 'stop'");
        const Steps before(steps.begin(), first), after(first, steps.end());
        require(count(before, Kind::wait) == 0 && count(before, Kind::wait_done) == 0, at,
                "may not wait before it gives 'stop'");
        require(wait_for(after, Signal::moving, false), at,
                "must wait for 'not moving' after it gives 'stop'");
        check_at_rest(at, steps);
        require(count(steps, Kind::require) == 0, at, "may not require anything");
        std::chrono::milliseconds time{0};
        for (const Step& step : steps)
            time += step.within;
        require(time <= max_stop, at,
                fmt::format("may not take more than {} ms", max_stop.count()));
    }

    StageProfile& profile_;
    std::vector<Input> used_;
};

}  // namespace

void read_profile_sequences(const Layers& root, StageProfile& profile) {
    SequenceReader(profile).read(root);
}

}  // namespace etalon
