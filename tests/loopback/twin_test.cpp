// The whole twin through the station's own device code: what the camera delivers is what an
// in-process rendering says the stage's position must show. And the program etalon-twin.
#include "mocks/twin/twin.h"
#include "capture/frame/camera.h"
#include "mocks/camera/gige_camera.h"
#include "stage/axes/kinematics.h"
#include "tests/loopback/program.h"
#include "tests/mocks/twin/twin_folder.h"

namespace etalon {
namespace {

constexpr double deg = std::numbers::pi / 180.0;

struct Station {
    explicit Station(const Twin& twin) {
        stage = open_stage({.address = TcpAddress{"127.0.0.1", twin.stage_port()}}, "generic", axes,
                           clock);
        camera = open_camera("genicam:127.0.0.1", {}, clock);
    }

    void prepare(std::chrono::microseconds exposure, double gain_db = 0.0) {
        camera->configure({.exposure = exposure, .gain_db = gain_db});
        camera->arm();
    }
    void home() {
        stage->enable({});
        stage->home({});
    }
    CodeImage frame() {
        const Frame taken = camera->frame_after(clock.now(), 10, {});
        EXPECT_EQ(taken.status, FrameStatus::complete) << taken.status_detail;
        return taken.image;
    }

    SteadyClock clock;
    std::vector<Axis> axes = read_axes_of_twin();
    std::unique_ptr<Stage> stage;
    std::unique_ptr<Camera> camera;

private:
    static std::vector<Axis> read_axes_of_twin() {
        return read_twin_file(TwinFolder().file("twin.yaml")).stage.axes;
    }
};

class TwinOnLoopback : public testing::Test {
protected:
    const TwinFolder folder;
    Twin twin{read_twin_file(folder.file("twin.yaml"))};
    Station station{twin};
};

// Mean of (code - expected)^2 / variance over the pixels that are neither dark nor saturated: 1 if
// the picture is the expected one, with the noise that the sensor section says. Expected code
// 255 L; variance 255 L / gain + (read / gain)^2 + 1/12 of the rounding, gain 40, read noise 20.
double chi_square(const CodeImage& image, const Radiance& radiance, int& pixels) {
    double sum = 0.0;
    pixels = 0;
    for (int y = 0; y < radiance.rows; ++y)
        for (int x = 0; x < radiance.cols; ++x) {
            const double expected = 255.0 * static_cast<double>(radiance.at<float>(y, x));
            if (expected < 15.0 || expected > 240.0)
                continue;
            const double variance = expected / 40.0 + 0.25 + 1.0 / 12.0;
            sum += std::pow(image.pixels.at<std::uint8_t>(y, x) - expected, 2.0) / variance;
            ++pixels;
        }
    return sum / pixels;
}

// Standard deviation of that mean over n normal deviates is sqrt(2 / n): 0.010 for the at least
// 18000 pixels here. Four of them, and as much again for the rounding that is not quite uniform.
constexpr double chi_square_tolerance = 0.08;

TEST_F(TwinOnLoopback, ShowsThePositionThatTheStageTrulyHas) {
    station.home();
    station.prepare(4500us);
    const std::vector<std::vector<double>> targets{
        {7.0, 5.0 * deg}, {-21.0, -12.0 * deg}, {7.0, 5.0 * deg}};
    Radiance before = twin.picture() * 0.9;
    for (const std::vector<double>& target : targets) {
        station.stage->move(target, {});
        const CodeImage image = station.frame();
        const std::vector<double> position = twin.stage().true_positions();
        const Radiance expected =
            twin.physics().radiance(base_from_carriage(twin.stage().axes(), position)) * 0.9;
        int pixels = 0;
        EXPECT_NEAR(chi_square(image, expected, pixels), 1.0, chi_square_tolerance);
        EXPECT_GT(pixels, 15000);
        EXPECT_GT(chi_square(image, before, pixels), 5.0) << "the picture before fits as well";
        before = expected;
    }
}

TEST_F(TwinOnLoopback, PutsItsErrorsBetweenTheTruthAndWhatTheStationReads) {
    EXPECT_NEAR(twin.physics().camera().intrinsics.fx, 190 * 1.005, 1e-9);
    EXPECT_NEAR(twin.physics().camera().intrinsics.fy, 187 * 1.005, 1e-9);
    station.home();
    station.stage->move(std::vector<double>{20.0, 0.0}, {});
    EXPECT_NEAR(station.stage->position()[0], 20.0, 0.002);
    EXPECT_NEAR(twin.stage().true_positions()[0], 20.0 * 1.002, 0.002);  // came from below
}

TEST_F(TwinOnLoopback, IsExposedInProportionToTimeAndGain) {
    const cv::Rect corner(2, 2, 12, 12);  // background, radiance 0.6
    const auto mean_at = [&](std::chrono::microseconds exposure, double gain_db) {
        station.prepare(exposure, gain_db);
        const double mean = cv::mean(station.frame().pixels(corner))[0];
        station.camera->disarm();
        return mean;
    };
    // 144 pixels with a standard deviation of at most 2.5: five standard errors are 1.0.
    EXPECT_NEAR(mean_at(2500us, 0.0), 255 * 0.6 * 0.5, 1.0);
    EXPECT_NEAR(mean_at(5000us, 0.0), 255 * 0.6, 1.0);
    EXPECT_NEAR(mean_at(2500us, 6.0), 255 * 0.3 * std::pow(10.0, 0.3), 1.0);
    EXPECT_EQ(mean_at(20000us, 0.0), 255.0);
}

TEST_F(TwinOnLoopback, GivesEveryFrameItsOwnNoise) {
    station.prepare(5000us);
    const CodeImage first = station.frame(), second = station.frame();
    EXPECT_GT(cv::norm(first.pixels, second.pixels, cv::NORM_L1), 1000.0);
}

TEST(TwinProgram, SaysWhenItIsReadyAndEndsWith0OnASignal) {
    const TwinFolder folder;
    for (const int signal : {SIGTERM, SIGINT}) {
        Program twin("etalon-twin", {folder.file("twin.yaml").string(), "--seed", "11",
                                     "--ready-file", folder.file("ready").string()});
        const std::string line = twin.line();
        EXPECT_EQ(line.rfind("twin ready: stage 127.0.0.1:", 0), 0u) << line;
        EXPECT_NE(line.find(", camera 127.0.0.1 (GigE Vision)"), std::string::npos) << line;
        twin.send(signal);
        EXPECT_EQ(twin.exit_code(), 0);
        EXPECT_EQ(read_text(folder.file("ready")), line + "\n");
    }
}

// A vendor's profile on a serial line: one unit for each axis.
TEST(TwinProgram, OffersAControllerOnASerialLine) {
    const TwinFolder folder;
    std::string text = twin_yaml_with("  port: 0\n", "  serial: line\n  profile: iai-pcon\n");
    text.replace(text.find("speed: 400}"), 11, "speed: 400, unit: 3}");
    text.replace(text.find("speed_deg: 200}"), 15, "speed_deg: 200, unit: 5}");
    folder.write("twin.yaml", text);
    const std::string line = folder.file("line").string();
    folder.write("station.yaml", "etalon: station/1\nstage:\n  link: {device: " + line + R"(}
  profile: iai-pcon
  axes:
    - {name: x, kind: linear, direction: [1, 0, 0], travel: [-30, 30], speed: 400, unit: 3}
    - {name: rz, kind: rotary, direction: [0, 0, 1], point_mm: [0, 0, 0],
       travel_deg: [-20, 20], speed_deg: 200, unit: 5}
)");
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string ready = twin.line();
    EXPECT_EQ(ready.rfind("twin ready: stage " + line + ", camera ", 0), 0u) << ready;

    const std::string station = folder.file("station.yaml").string();
    Program status("etalon", {"stage", "status", station});
    const std::string printed = status.rest();
    EXPECT_EQ(status.exit_code(), 0);
    EXPECT_NE(printed.find("0.0000 mm"), std::string::npos) << printed;
    EXPECT_EQ(Program("etalon", {"stage", "home", station, "--yes"}).exit_code(), 0);
    Program move("etalon", {"stage", "move", station, "x=7.5", "rz=-3"});
    const std::string moved = move.rest();
    EXPECT_EQ(move.exit_code(), 0);
    EXPECT_NE(moved.find("7.5000 mm"), std::string::npos) << moved;
    twin.send(SIGTERM);
    EXPECT_EQ(twin.exit_code(), 0);
    EXPECT_FALSE(std::filesystem::is_symlink(line));
}

TEST(TwinProgram, EndsWith3AndTheLineOfAMistakeInItsFile) {
    const TwinFolder folder;
    folder.write("twin.yaml", twin_yaml_with("background: 0.6", "background: 1.6"));
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string line = twin.line();
    EXPECT_NE(line.find("twin.yaml:17: scene.background"), std::string::npos) << line;
    EXPECT_EQ(twin.exit_code(), 3);
}

TEST(TwinProgram, EndsWith3OnAWrongCommandLine) {
    EXPECT_EQ(Program("etalon-twin", {}).exit_code(), 3);
    EXPECT_EQ(Program("etalon-twin", {"twin.yaml", "--speed", "3"}).exit_code(), 3);
    EXPECT_EQ(Program("etalon-twin", {"missing.yaml"}).exit_code(), 3);
}

// Sockets and files get other numbers than what is printed goes to.
TEST(TwinProgram, ReservesClosedStandardDescriptorsAsEveryProgramDoes) {
    const TwinFolder folder;
    for (const std::string& command :
         {built_program("etalon-twin") + " '" + folder.file("twin.yaml").string() + "'",
          built_program("gige-camera") + " 64 48 8 1"}) {
        Program shell("/bin/sh", {"-c", "'" + replaced(command, " ", "' ") + " <&- >&- 2>&-; :"});
        const auto all_are_reserved = [&] {
            const int child = shell.child();
            std::error_code ended;
            for (const int number : {0, 1, 2})
                if (child == 0 || std::filesystem::read_symlink(
                                      fmt::format("/proc/{}/fd/{}", child, number), ended) != "/")
                    return false;
            return true;
        };
        for (int i = 0; i < 2000 && !all_are_reserved(); ++i)
            SteadyClock().wait_for(5ms, {});
        EXPECT_TRUE(all_are_reserved()) << command;
        if (const int child = shell.child(); child != 0)
            kill(child, SIGTERM);
        shell.exit_code();
    }
}

TEST(TwinProgram, EndsWith4WhenTheCameraPortIsTaken) {
    const TwinFolder folder;
    const GigeCamera other({}, [](const CaptureSettings&) { return CodeImage{}; });
    Program twin("etalon-twin", {folder.file("twin.yaml").string()});
    const std::string line = twin.line();
    EXPECT_NE(line.find("127.0.0.1:3956"), std::string::npos) << line;
    EXPECT_EQ(twin.exit_code(), 4);
}

}  // namespace
}  // namespace etalon
