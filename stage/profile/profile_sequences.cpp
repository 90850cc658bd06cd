#include <fmt/format.h>

#include <algorithm>

#include "stage/profile/profile_layers.h"

namespace etalon {
namespace {

using Kind = Step::Kind;

constexpr std::chrono::milliseconds max_stop{3000};  // it also holds up whoever gives up

bool gives(const Step& step, Input input) {
    return (step.kind == Kind::set || step.kind == Kind::pulse) && step.input == input;
}

bool waits(const Step& step) {
    return step.kind == Kind::wait || step.kind == Kind::wait_done;
}

bool waits_for(const Step& step, Signal signal, bool on) {
    return step.kind == Kind::wait &&
           std::ranges::any_of(step.conditions, [&](const Condition& condition) {
               return condition.signal == signal && condition.on == on;
           });
}

class SequenceReader {
public:
    explicit SequenceReader(StageProfile& profile) : profile_(profile) {}

    void read(const Layers& root) {
        const Layers section = root.section("sequences");
        auto& sequences = profile_.sequences;
        sequences.enable = read_steps(section.at("enable"));
        sequences.reset = read_steps(section.at("reset"));
        sequences.home = read_steps(section.at("home"));
        sequences.move = read_steps(section.at("move"));
        sequences.stop = read_steps(section.at("stop"));
        check_at_rest(section.at("enable"), sequences.enable);
        check_at_rest(section.at("reset"), sequences.reset);
        check_home(section.at("home"), sequences.home);
        check_move(section.at("move"), sequences.move);
        check_stop(section.at("stop"), sequences.stop);
        if (!std::ranges::any_of(sequences.reset,
                                 [](const Step& s) { return waits_for(s, Signal::alarm, false); }))
            section.at("reset").fail("must wait for 'not alarm'");
        require_all_used(root);
    }

private:
    std::vector<Step> read_steps(const Value& list) {
        std::vector<Step> steps;
        for (const Value& item : list.items())
            steps.push_back(read_step(item));
        return steps;
    }

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

    bool starts(const Step& step) const { return starts_motion(profile_, step); }

    void check_at_rest(const Value& at, const std::vector<Step>& steps) const {
        for (const Step& step : steps) {
            if (starts(step) || step.kind == Kind::write || step.kind == Kind::wait_done)
                at.fail("may not set anything in motion");
        }
    }

    // Exactly one motion; returns the steps after its start.
    std::vector<Step> after_only_start(const Value& at, const std::vector<Step>& steps) const {
        const auto is_start = [this](const Step& step) { return starts(step); };
        const auto count = std::ranges::count_if(steps, is_start);
        if (count != 1)
            at.fail(fmt::format("must start a motion exactly once, not {} times", count));
        return {std::ranges::find_if(steps, is_start) + 1, steps.end()};
    }

    void check_home(const Value& at, const std::vector<Step>& steps) const {
        const std::vector<Step> after = after_only_start(at, steps);
        const auto homes = [](const Step& step) { return gives(step, Input::home); };
        if (std::ranges::none_of(steps, homes))
            at.fail("must give 'home'");
        const auto rests = [](const Step& s) { return waits_for(s, Signal::moving, false); };
        if (std::ranges::none_of(after, rests))
            at.fail("must wait for 'not moving' after the start");
        const bool homed = std::ranges::any_of(
            after, [](const Step& s) { return waits_for(s, Signal::homed, true); });
        if (profile_.has(Signal::homed) && !homed)
            at.fail("must wait for 'homed' after the start");
    }

    void check_move(const Value& at, const std::vector<Step>& steps) const {
        const std::vector<Step> after = after_only_start(at, steps);
        const auto is = [](Kind kind) {
            return [kind](const Step& step) { return step.kind == kind; };
        };
        if (std::ranges::any_of(steps, [](const Step& s) { return gives(s, Input::home); }))
            at.fail("may not give 'home'");
        if (std::ranges::count_if(steps, is(Kind::write)) != 1 ||
            std::ranges::any_of(after, is(Kind::write)))
            at.fail("must write the target once, not after the start");
        if (std::ranges::count_if(after, is(Kind::wait_done)) != 1 ||
            std::ranges::count_if(steps, is(Kind::wait_done)) != 1)
            at.fail("must wait for 'done' once, after the start");
    }

    void check_stop(const Value& at, const std::vector<Step>& steps) const {
        const auto first =
            std::ranges::find_if(steps, [](const Step& step) { return gives(step, Input::stop); });
        if (first == steps.end())
            at.fail("must give 'stop'");
        if (std::any_of(steps.begin(), first, waits))
            at.fail("may not wait before it gives 'stop'");
        const bool confirmed = std::any_of(first, steps.end(), [](const Step& step) {
            return waits_for(step, Signal::moving, false);
        });
        if (!confirmed)
            at.fail("must wait for 'not moving' after it gives 'stop'");
        check_at_rest(at, steps);
        std::chrono::milliseconds time{0};
        for (const Step& step : steps) {
            time += step.within;
            if (step.kind == Kind::require)
                at.fail("may not require anything");
        }
        if (time > max_stop)
            at.fail(fmt::format("may not take more than {} ms", max_stop.count()));
    }

    void require_all_used(const Layers& root) const {
        for (const auto& [input, point] : profile_.inputs) {
            if (std::ranges::find(used_, input) == used_.end())
                root.section("inputs").at(name_of(input)).fail("is used in no sequence");
        }
    }

    StageProfile& profile_;
    std::vector<Input> used_;
};

}  // namespace

void read_profile_sequences(const Layers& root, StageProfile& profile) {
    SequenceReader(profile).read(root);
}

}  // namespace etalon
