// qualify STATION FOLDER: moves the stage, photographs, judges; the record and report go to FOLDER.
#include <etalon/qualify.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    if (argc != 3)
        return std::puts("usage: qualify STATION FOLDER"), 3;
    const etalon::StationFile station = etalon::read_station(argv[1]);
    etalon::SteadyClock clock;
    etalon::Progress progress(stderr, false, clock);

    // Devices of your own go in here: classes that implement Camera and Stage.
    const etalon::DeviceOpeners devices{
        [&] { return etalon::open_camera(station.camera.uri, station.camera.link, clock); },
        [&] {
            const etalon::StationStage& stage = station.stage;
            return etalon::open_stage(stage.link, stage.profile, stage.axes, clock);
        }};
    const etalon::QualifyResult result =
        etalon::run_qualification(station, argv[2], devices, clock, progress, {});

    std::printf("%s %s\n", etalon::name(result.outcome), result.reason.c_str());
    if (result.analysis)
        for (const etalon::JudgedQuantity& judged : result.analysis->quantities)
            std::printf("%s %.4f +- %.4f %s, limit %.4f\n", judged.name.c_str(), judged.value,
                        judged.expanded_uncertainty, judged.unit.c_str(), judged.limit);
    return etalon::exit_code(result.outcome);
} catch (const std::exception& error) {
    std::fprintf(stderr, "qualify: %s\n", error.what());
    return 3;
}
