// The register image of a stage profile in front of a simulated stage: what a controller's firmware
// does between its registers and its motors. No sockets. For one thread.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "mocks/simulated_stage.h"
#include "stage/profile.h"

namespace etalon {

class StageRegisters {
public:
    // The stage must outlive this. Throws ConfigError when it has more axes than the profile.
    StageRegisters(SimulatedStage& stage, const StageProfile& profile);

    // Nothing when one of the registers does not exist. Poll registers of absent axes read as 0.
    std::optional<std::vector<std::uint16_t>> read(int address, int count) const;

    // False, and nothing written, when one of the registers does not exist or is read-only.
    // Commands take effect before it returns.
    bool write(int address, std::span<const std::uint16_t> values);

    // To be called every few milliseconds: stops the axes, with an alarm, when they move and the
    // watchdog register was not written in time.
    void check_watchdog();

private:
    std::uint16_t status_word(const AxisStatus& axis) const;
    void write_poll_group(std::vector<std::uint16_t>& image, const AxisStatus& axis,
                          std::size_t index) const;
    std::vector<std::uint16_t> poll_image() const;
    void obey(std::uint16_t command);
    void start();

    SimulatedStage& stage_;
    StageProfile profile_;
    std::vector<std::uint16_t> move_;
    std::uint16_t command_ = 0, watchdog_ms_ = 0;
    Instant watchdog_written_;
};

}  // namespace etalon
