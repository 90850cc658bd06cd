// A stage's client and its controller on virtual time, for tests of what the client does.
#pragma once

#include "stage/motion/modbus_stage.h"
#include "tests/fakes/memory_transport.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon::test {

// Of the generic profile (docs/stage.md).
constexpr int command = 200;
constexpr std::uint16_t enable_bit = 1, start_bit = 4, stop_bit = 8;

// Unlike the generic one in everything that a profile can say differently: targets and speeds by
// number format, sign and offset; status in other spaces; start, stop and home by code.
inline const char* const by_code = R"(etalon: stage-profile/1
name: by-code
extends: generic
max_axes: 2
word_order: low_first
counts: {per_mm: 200, per_deg: 300, sign: -1, offset: 70}
speed: {unit: counts_per_s, step: 5}
poll:
  - {space: input, address: 0, count: 4, stride: 6}
  - {space: discrete_inputs, address: 40, count: 2, stride: 2}
  - {space: holding, address: 0x300, count: 1, stride: 0}
position: {input_register: 2, type: float32}
alarm_code: {input_register: 1, type: uint16}
signals:
  enabled: {input_register: 0, bit: 9}
  homed: {input_register: 0, bit: 3}
  moving: {input_register: 0, bit: 7}
  homing: {input_register: 0, bit: 5}
  ready: {input_register: 0, bit: 0}
  in_position: {discrete_input: 40}
  alarm: [{discrete_input: 41, inverted: true}, {input_register: 0, bit: 11}]
  emergency_stop: {register: 0x300, bit: 2}
  limit: {register: 0x300, bit: 3, inverted: true}
inputs:
  remote: {coil: 7, act: level}
  enable: {coil: 5, act: level, inverted: true}
  home: {register: 0x6002, act: code, code: 0x20}
  start: {register: 0x6002, act: code, code: 0x10}
  stop: {register: 0x6002, act: code, code: 0x40}
  reset: {coil: 9, act: edge}
target:
  - {register: 0x400, starts: false, read_back: true, fields: [{target: int32}, {constant: 3, type: uint16}]}
  - {register: 0x480, starts: false, read_back: false, fields: [{constant: -7, type: int16}, {speed: uint16}]}
sequences:
  enable: [{set: remote}, {set: enable}, {wait: [enabled], within_ms: 500}]
  reset: [{set: remote}, {pulse: reset}, {wait: [not alarm], within_ms: 500}]
  home: [{pulse: home}, {wait: [homed, not moving, not homing], within_ms: 60000, for_ms: 50}]
  move: [{require: [homed, ready]}, {write: target}, {pulse: start}, {wait: done}]
  stop: [{pulse: stop}, {wait: [not moving], within_ms: 1000}]
watchdog: ~
done: {tolerance_um: 20, tolerance_deg: 0.02, start_seen: true}
)";

inline std::string error_of_move(Stage& stage, const std::vector<double>& target,
                                 const std::stop_token& stop = {}) {
    return device_error_of([&] { stage.move(target, stop); });
}

class Rig {
public:
    explicit Rig(const std::string& profile_text, std::vector<Axis> axes = fast_axes())
        : Rig(stage_profile_from_text(profile_text, "p.yaml"), std::move(axes)) {}
    explicit Rig(StageProfile profile_ = builtin_stage_profile("generic"),
                 std::vector<Axis> axes = fast_axes())
        : profile(std::move(profile_)), simulation(std::move(axes), {}, clock) {}

    std::unique_ptr<Stage> connect(Opening opening = Opening::asks) {
        return open_modbus_stage(StageLink{.response_timeout = std::chrono::milliseconds(100)},
                                 profile, simulation.axes(), clock,
                                 std::make_unique<MemoryTransport>(controller, clock, false),
                                 opening);
    }
    std::unique_ptr<Stage> connect_and_home() {
        auto stage = connect();
        stage->enable({});
        stage->home({});
        return stage;
    }

    // Once, with the first reading request after any axis has come so far.
    void once_beyond(double position, const std::function<void()>& happens) {
        controller.set_script([this, position, happens](const ModbusRequest& request) {
            requests.push_back(request);
            if (!happened && request.values.empty() && simulation.true_positions()[0] > position) {
                happened = true;
                requests.clear();
                happens();
            }
            return ModbusReaction{};
        });
    }

    std::vector<ModbusRequest> writes_since(std::size_t count) const {
        const std::vector<ModbusRequest> all = controller.writes();
        return {all.begin() + static_cast<std::ptrdiff_t>(count), all.end()};
    }

    VirtualClock clock;
    StageProfile profile;
    SimulatedStage simulation;
    ModbusController controller{simulation, profile};
    // With once_beyond():
    bool happened = false;
    std::vector<ModbusRequest> requests;  // since it happened
};

struct HomedRig : Rig {
    using Rig::Rig;
    std::unique_ptr<Stage> stage = connect_and_home();
};

inline bool writes_to(const ModbusRequest& request, int address) {
    return !request.values.empty() && request.address == address;
}

inline bool gives(const ModbusRequest& request, std::uint16_t bit) {
    return writes_to(request, command) && (request.values[0] & bit) != 0;
}

}  // namespace etalon::test
