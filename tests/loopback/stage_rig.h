// A simulated stage behind a real server, on 127.0.0.1 or on a serial line, for the loopback tests
// of the stage.
#pragma once

#include "mocks/stage/modbus_controller.h"
#include "stage/motion/modbus_stage.h"
#include "tests/fakes/test_axes.h"
#include "tests/test.h"

namespace etalon {

// Of the generic profile (docs/stage.md).
constexpr int command_register = 200;
constexpr std::uint16_t enable_bit = 1, home_bit = 2, start_bit = 4, stop_bit = 8;

inline bool gives(const ModbusRequest& request, std::uint16_t bit) {
    return !request.values.empty() && request.address == command_register &&
           (request.values[0] & bit) != 0;
}

enum class Wire { tcp, rtu };
inline std::string name_of(Wire wire) {
    return wire == Wire::tcp ? "OverTcp" : "OverRtu";
}

class StageRig {
public:
    // The long time-out is for tests that lose nothing: they shall pass on a busy machine.
    explicit StageRig(std::chrono::milliseconds response_timeout = 2s, Wire wire = Wire::tcp,
                      StageProfile of_controller = builtin_stage_profile("generic"),
                      std::vector<Axis> of_stage = fast_axes())
        : profile(std::move(of_controller)), axes(std::move(of_stage)), timeout_(response_timeout) {
        if (wire == Wire::rtu) {
            line = std::make_unique<SerialPair>();
            server = std::make_unique<ModbusStageServer>(simulation, profile, *line);
        } else {
            server = std::make_unique<ModbusStageServer>(simulation, profile);
        }
    }

    StageLink link() const {
        StageLink link{.response_timeout = timeout_, .quiet = 100ms};
        if (line)
            link.address = SerialPort{.device = line->device()};
        else
            link.address = TcpAddress{"127.0.0.1", server->port()};
        return link;
    }

    std::unique_ptr<Stage> connect() { return open_modbus_stage(link(), profile, axes, clock); }
    std::unique_ptr<Stage> connect_and_home() {
        auto stage = connect();
        stage->enable({});
        stage->home({});
        return stage;
    }

    int count_writes(std::uint16_t bit) const {
        int count = 0;
        for (const ModbusRequest& request : server->writes())
            count += gives(request, bit);
        return count;
    }

    // Whether x is on its way beyond `position` mm: where scripts begin their faults.
    bool is_beyond(double position) {
        return simulation.is_moving() && simulation.true_positions()[0] > position;
    }

    SteadyClock clock;
    StageProfile profile;
    std::vector<Axis> axes;
    // A controller that does not tell whether its axes are homed must be seen to move them: also by
    // the polls of a slow line on a busy machine.
    SimulatedStage simulation{axes, {.homing = profile.has(Signal::homed) ? 30ms : 1s}, clock};
    std::unique_ptr<SerialPair> line;  // of a serial rig
    std::unique_ptr<ModbusStageServer> server;

private:
    std::chrono::milliseconds timeout_;
};

// The file of a station with this stage of fast_axes(), and with `more` lines of its stage. Its
// camera cannot be read.
inline std::string station_of(const StageRig& rig, const std::string& more) {
    return "etalon: station/1\ncamera: {calibration: there-is-none.yml}\nstage:\n  link: {host: "
           "127.0.0.1, port: " +
           std::to_string(rig.server->port()) + "}\n" + more + R"(  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-7, 700], speed: 200}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-57, 114], speed_deg: 114}
)";
}

}  // namespace etalon
