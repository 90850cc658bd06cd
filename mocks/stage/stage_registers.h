// The registers of a stage profile in front of a simulated stage: what a controller's firmware does
// between its registers and its motors, by the same file that the client reads. No sockets. For one
// thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "mocks/stage/simulated_stage.h"
#include "stage/profile/profile.h"

namespace etalon {

class StageRegisters {
public:
    // Of one of the stage's controllers. The stage must outlive this. Throws ConfigError when the
    // controller has more axes than the profile.
    StageRegisters(SimulatedStage& stage, const StageProfile& profile, std::size_t controller = 0);

    // Of coils and discrete inputs 0 or 1. Nothing when one of them does not exist. What is polled
    // of absent axes reads as 0, and so do registers that take codes.
    std::optional<std::vector<std::uint16_t>> read(RegisterSpace space, int address,
                                                   int count) const;

    // False, and nothing written, when one of the registers does not exist or is read-only.
    // Commands take effect before it returns.
    bool write(RegisterSpace space, int address, std::span<const std::uint16_t> values);

    // To be called every few milliseconds: stops the axes, with an alarm, when they move and the
    // watchdog register was not written in time.
    void check_watchdog();

private:
    using Place = std::pair<RegisterSpace, int>;

    std::vector<std::uint16_t> poll_image(const PollBlock& block) const;
    void show_number(std::vector<std::uint16_t>& image, const PollBlock& block,
                     const PolledNumber& number, std::size_t axis, double value) const;
    void show_signals(std::vector<std::uint16_t>& image, const PollBlock& block,
                      const std::vector<AxisStatus>& axes) const;

    bool is_on(Input input) const;  // as the memory says; a controller without the input: false
    bool acts(Input input, bool was_on, std::span<const Place> written) const;
    void obey_enable(bool given);
    void obey(const std::map<Input, bool>& before, std::span<const Place> written);
    bool starts_by(std::span<const Place> written) const;
    void start();
    bool decode_target(std::vector<double>& target, std::vector<double>& speed) const;

    std::vector<AxisStatus> status() const;  // of its axes

    SimulatedStage& stage_;
    std::size_t controller_;
    std::vector<Axis> axes_;
    std::size_t first_axis_;  // of the stage's
    StageProfile profile_;
    std::map<Place, std::uint16_t> memory_;  // everything that can be written
    Instant watchdog_written_;
};

}  // namespace etalon
