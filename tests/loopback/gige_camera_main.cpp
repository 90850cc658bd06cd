// gige-camera WIDTH HEIGHT BITS PICTURE: a GigE Vision camera on 127.0.0.1 that shows the picture
// of that number until it is ended. Prints `ready`, and then with which settings its first frame
// was exposed. Used by PoweredCamera.

#include <CLI/CLI.hpp>
#include <cstdio>

#include "core/program/print_stderr.h"
#include "mocks/ending_signals.h"
#include "tests/loopback/gige_rig.h"

namespace {

void print_line(const std::string& line) {
    fmt::print("{}\n", line);
    std::fflush(stdout);
}

std::string text_of(const etalon::CaptureSettings& settings) {
    return fmt::format("{}, {} us, {} dB, black level {}", settings.format,
                       settings.exposure.count(), settings.gain_db,
                       settings.black_level.value_or(-1.0));
}

int run(const etalon::GigeCameraOptions& options, int number) {
    const sigset_t signals = etalon::block_ending_signals();
    const etalon::CodeImage shown =
        etalon::picture(options.width, options.height, options.bits, number);
    std::once_flag first;
    const etalon::GigeCamera camera(options, [&](const etalon::CaptureSettings& settings) {
        std::call_once(first, [&] { print_line(text_of(settings)); });
        return shown;
    });
    print_line("ready");
    int signal = 0;
    sigwait(&signals, &signal);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    etalon::GigeCameraOptions options;
    int number = 0;
    CLI::App app("A GigE Vision camera on 127.0.0.1.");
    app.add_option("width", options.width)->required();
    app.add_option("height", options.height)->required();
    app.add_option("bits", options.bits)->required();
    app.add_option("picture", number, "Number of the picture that it shows")->required();
    CLI11_PARSE(app, argc, argv);
    try {
        return run(options, number);
    } catch (const etalon::Error& error) {
        etalon::print_stderr("gige-camera: {}\n", error.what());
        return 4;
    }
}
