#include <sched.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>
#include <unistd.h>

#include "compare/expect/expected_view.h"
#include "core/file/sha256.h"
#include "station/setup/plan.h"
#include "station/setup/station_lock.h"
#include "tests/station/stations.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr double deg = std::numbers::pi / 180.0;

// The message for station_text with `what` replaced by `by`; empty if it was read.
std::string fault(const std::string& what, const std::string& by) {
    const TemporaryFolder folder;
    return config_error_of(
        [&] { read_station(write_station(folder, replaced(station_text, what, by))); });
}

TEST(StationFile, GivesWhatItSays) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    EXPECT_EQ(station.id, "test-station");
    EXPECT_EQ(station.camera.uri, "genicam:127.0.0.1");
    EXPECT_EQ(station.camera.model.serial, "CAM-7");
    EXPECT_EQ(station.camera.settings.width, 320);
    EXPECT_EQ(station.camera.settings.bits, 8);
    EXPECT_EQ(station.camera.settings.exposure, std::chrono::microseconds(2000));
    EXPECT_EQ(station.camera.link.frame_timeout, std::chrono::milliseconds(900));
    EXPECT_EQ(station.camera.retries, 3);
    EXPECT_EQ(std::get<TcpAddress>(station.stage.link.address).port, 1599);
    EXPECT_EQ(station.stage.link.unit, 2);
    ASSERT_EQ(station.stage.axes.size(), 4u);
    EXPECT_EQ(station.marker.id, 5);
    EXPECT_DOUBLE_EQ(*station.marker_size_uncertainty, 50e-6);
    EXPECT_DOUBLE_EQ(*station.marker_flatness_mm, 0.004);
    ASSERT_TRUE(station.temperature);
    EXPECT_DOUBLE_EQ(station.temperature->standard_uncertainty_k, 0.3);
    EXPECT_DOUBLE_EQ(station.temperature->marker_expansion_per_k, 9e-6);
    EXPECT_DOUBLE_EQ(station.temperature->stage_expansion_per_k, 11e-6);
    EXPECT_EQ(station.limits.id, "test-limits-5");
    EXPECT_EQ(station.plan.poses, 25);
    EXPECT_EQ(station.plan.settle, std::chrono::milliseconds(40));
}

TEST(StationFile, GivesWhatElseTheCameraIsTold) {
    const TemporaryFolder folder;
    const StationFile station = read_station(
        write_station(folder, replaced(station_text, "  packet_size: 1400\n",
                                       "  format: Mono12p\n  black_level: 5\n  trigger: Line1\n"
                                       "  controls: {Gamma: 0.7, Sharpness: 0}\n"
                                       "  packet_delay_us: 3\n  interface: 192.168.7.1\n")));
    const StationCamera& camera = station.camera;
    EXPECT_EQ(camera.settings.format, "Mono12p");
    EXPECT_EQ(camera.settings.black_level, 5.0);
    EXPECT_EQ(camera.settings.trigger, "Line1");
    EXPECT_EQ(camera.settings.controls,
              (std::map<std::string, double>{{"Gamma", 0.7}, {"Sharpness", 0.0}}));
    EXPECT_EQ(camera.link.packet_delay, std::chrono::microseconds(3));
    EXPECT_EQ(camera.link.interface, "192.168.7.1");
}

TEST(StationFile, GivesWhereTheAxesMayNotGo) {
    const TemporaryFolder folder;
    const std::string rules =
        "  forbidden: [{name: lens, x: [-5, 7], rz: [0, 90]}]\n"
        "  slow_near: {margin: {y: 3}, speed_share: 0.25}\n";
    const StationFile station = read_station(write_station(
        folder, replaced(station_text, "  profile: generic\n", "  profile: generic\n" + rules)));
    ASSERT_EQ(station.stage.rules.forbidden.size(), 1u);
    EXPECT_EQ(station.stage.rules.forbidden[0].sides.at(0).high, 7.0);
    EXPECT_NEAR(station.stage.rules.forbidden[0].sides.at(3).high, 90 * deg, 1e-12);
    EXPECT_EQ(station.stage.rules.slow_margin, (std::vector<double>{0, 3, 0, 0}));
    EXPECT_THAT(fault("  profile: generic\n", "  profile: generic\n  forbidden: [{name: lens}]\n"),
                HasSubstr(":14: stage.forbidden[0]: names no axis"));
}

TEST(StationFile, TurnsDegreesIntoRadians) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    EXPECT_NEAR(station.plan.volume.at(3).high, 175 * deg, 1e-12);
    EXPECT_NEAR(station.plan.volume.at(1).high, 45, 1e-12);
    const Vector6d mount = vector_from_rigid(station.carriage_from_marker_nominal);
    EXPECT_NEAR(mount[0], 20 * deg, 1e-12);
    EXPECT_NEAR(mount[4], -7, 1e-12);
}

constexpr const char* wide_camera = R"(etalon: camera/1
serial: "CAM-7"
image: {width: 320, height: 240}
projection: equidistant
intrinsics: {fx: 95.0, fy: 95.0, cx: 158.3, cy: 121.6}
distortion: {k1: 0.03, k7: -0.0002}
)";

// The marker may stand aside, where a tangent has run away, but not beyond what is rendered.
TEST(StationFile, TakesAWideLensWithAPlanThatIsRendered) {
    const TemporaryFolder folder;
    write_station(folder,
                  std::string(station_text) +
                      "camera_mount: {rotation_deg: [0, 62, 0], translation_mm: [280, 0, 120]}\n");
    write_text(folder / "camera.yml", wide_camera);
    const StationFile station = read_station(folder / "station.yaml");
    EXPECT_EQ(station.camera.model.projection.kind, Projection::equidistant);
    double widest = 0.0;
    for (const PlannedPose& pose : plan_of(station).poses) {
        const Rigid at = expected_pose(station, pose.target);
        EXPECT_TRUE(is_rendered(station.marker.grid, at, station.camera.model));
        widest = std::max(widest, std::acos(at.translation.normalized().z()));
    }
    EXPECT_GT(widest, 60.0 * deg);
    EXPECT_LT(widest, 80.0 * deg);
}

TEST(StationFile, RefusesATelecentricCamera) {
    const TemporaryFolder folder;
    write_station(folder);
    write_text(folder / "camera.yml", replaced(wide_camera, "equidistant", "telecentric"));
    EXPECT_THAT(config_error_of([&] { read_station(folder / "station.yaml"); }),
                HasSubstr("a distance is not in its images"));
}

TEST(StationFile, NamesItsInputsByContent) {
    const TemporaryFolder folder;
    const StationFile station = read_station(write_station(folder));
    ASSERT_EQ(station.inputs.size(), 3u);
    EXPECT_EQ(station.inputs[0].sha256, sha256(station_text));
    EXPECT_EQ(station.inputs[1].role, "calibration");
    EXPECT_EQ(station.inputs[1].sha256, sha256(camera_text));
    EXPECT_EQ(station.inputs[2].sha256, sha256(limits_text));
}

TEST(StationFile, NamesTheLineAndTheKeyOfEachFault) {
    const std::pair<std::pair<const char*, const char*>, const char*> faults[] = {
        {{"gain_db: 0", "gain_db: .nan"}, ":7: camera.gain_db: must be a"},
        {{"exposure_us: 2000", "exposure_us: 0"}, ":6: camera.exposure_us: must be"},
        {{"port: 1599", "port: 0"}, ":12: stage.link.port: must be"},
        {{"  frames: 2\n", ""}, "plan.frames: missing"},
        {{"  frames: 2\n", "  frames: 2\n  frames: 2\n"}, "plan.frames: doubled key"},
        {{"id: test-station", "id: \"\""}, ":2: id: must not be empty"},
        {{"calibration: camera.yml", "calibration: camara.yml"},
         ":5: camera.calibration: no such file: "},
        {{"limits: limits.yaml", "limits: nothing.yaml"}, "limits: no such file: "},
        {{"hold_out: 0.6", "hold_out: 1.0"}, "plan.hold_out: must be"},
        {{"background: 0.7", "background: 1.2"}, "background: must be"},
        // a volume that leaves the soft limits
        {{"rz: [-170, 175]", "rz: [-170, 195]"},
         "plan.volume.rz: [-170, 195] leaves the soft limits [-190, 190] of axis rz"},
        {{"x: [-60, 50]", "x: [50, -60]"}, "plan.volume.x: must be [low, high]"},
        {{"x: [-60, 50], ", ""}, "plan.volume.x: missing"},
        {{"x: [-60, 50]", "x: [-60, 50], w: [1, 2]"}, "plan.volume.w: unknown key"},
        // a marker that the detector cannot see
        {{"apriltag:36h11:5@60mm", "apriltag:37h11:5@60mm"}, "station.yaml:19: marker: "},
        {{"detector: auto", "detector: aruco"}, "station.yaml:31: detector: "}};
    for (const auto& [change, message] : faults)
        EXPECT_THAT(fault(change.first, change.second), HasSubstr(message));
    EXPECT_THAT(fault("retries: 3", "retrys: 3"),
                EndsWith("station.yaml:10: camera.retrys: unknown key; did you mean 'retries'?"));
}

StationFile read_with(const std::string& references) {
    const TemporaryFolder folder;
    return read_station(write_station(folder, station_text + references));
}

std::string refusal(const std::string& what, const std::string& by) {
    return config_error_of([&] { read_with(replaced(traced_text, what, by)); });
}

TEST(References, AreReadWithTheirUnits) {
    const auto references = read_with(traced_text).references;
    ASSERT_EQ(references.size(), 7u);
    const TracedReference* scale = reference_named(references, "stage scale y");
    ASSERT_TRUE(scale);
    EXPECT_EQ(scale->value, -7.0);
    EXPECT_EQ(scale->expanded_uncertainty, 24.0);
    EXPECT_EQ(scale->unit, "ppm");
    EXPECT_EQ(scale->certificate, "S-2");
    EXPECT_EQ(scale->laboratory, "Laboratory A");
    EXPECT_EQ(scale->date, "2026-01-12");
    EXPECT_EQ(scale->due, "2999-01-12");
    EXPECT_EQ(reference_named(references, "thermometer")->unit, "K");
    EXPECT_FALSE(reference_named(references, "stage scale w"));
}

// By hand: sqrt(7^2 + 12^2).
TEST(References, CountTheDeviationThatNothingCorrectsFor) {
    const auto references = read_with(traced_text).references;
    EXPECT_NEAR(reference_named(references, "stage scale y")->standard_uncertainty(), 13.8924,
                1e-4);
}

TEST(References, AreInForceFromTheirDateToTheDayTheyAreDue) {
    TracedReference reference;
    reference.date = "2026-01-12";
    reference.due = "2027-01-12";
    EXPECT_TRUE(reference.in_force_on("2026-01-12"));
    EXPECT_TRUE(reference.in_force_on("2027-01-12"));
    EXPECT_FALSE(reference.in_force_on("2026-01-11"));
    EXPECT_FALSE(reference.in_force_on("2027-01-13"));
}

TEST(References, AreRefusedWithTheKeyThatIsWrong) {
    const std::string y = "y: {value_ppm: -7, U_ppm: 24, certificate: S-2";
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, certificate: S-2"), HasSubstr("stage_scale.y"));
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, U_um: 24, certificate: S-2"), HasSubstr("U_ppm"));
    EXPECT_THAT(refusal(y, "y: {value_ppm: -7, U_ppm: 0, certificate: S-2"), HasSubstr("U_ppm"));
    EXPECT_THAT(refusal("certificate: S-2", "certificate: \" \""), HasSubstr("must not be empty"));
    EXPECT_THAT(refusal("    y: {", "    w: {"), HasSubstr("stage_scale.w"));
    EXPECT_THAT(refusal("date: 2026-01-12", "date: 2026-02-30"), HasSubstr("no day"));
    EXPECT_THAT(refusal("due: 2999-01-12", "due: 2026-01-12"), HasSubstr("must be after"));
    EXPECT_THAT(refusal("  marker_size:", "  marker_sizes:"), HasSubstr("marker_sizes"));
}

// The budget must not claim less than the certificates leave.
TEST(References, ThatLeaveMoreThanTheStationDeclaresAreRefused) {
    EXPECT_THAT(refusal("value_ppm: -7, U_ppm: 24", "value_ppm: -28, U_ppm: 24"),
                HasSubstr("leaves a standard uncertainty of 30.46 ppm"));
    EXPECT_THAT(refusal("U_um: 6", "U_um: 9"), HasSubstr("marker_flatness_um"));
    EXPECT_THROW(
        read_station(write_station(
            TemporaryFolder(),
            replaced(station_text, "marker_size_uncertainty_ppm: 50\n", "") + traced_text)),
        ConfigError);
}

const std::string by_hand =
    "environment: {temperature_c: [19.9, 20.5], humidity_percent: [40, 52]}";
const std::string by_sensor =
    "environment: {link: {host: 127.0.0.1, port: 1503, unit: 7},\n"
    "  temperature: {input_register: 5, type: int16, scale: 0.01, offset: -2},\n"
    "  humidity: {register: 8, type: float32, word_order: low_first}}";

StationFile station_in(const std::string& environment) {
    const TemporaryFolder folder;
    return read_station(
        write_station(folder, station_text + replaced(traced_text, by_hand, environment)));
}

std::string refusal(const std::string& environment) {
    return config_error_of([&] { station_in(environment); });
}

TEST(Environment, KnowsWhereItsSensorKeepsWhat) {
    const StationEnvironment environment = *station_in(by_sensor).environment;
    ASSERT_TRUE(environment.sensor);
    EXPECT_EQ(environment.sensor->link.unit, 7);
    const SensorRegister& temperature = environment.sensor->temperature_c;
    EXPECT_EQ(temperature.space, RegisterSpace::input_registers);
    EXPECT_EQ(temperature.address, 5);
    EXPECT_EQ(temperature.type, NumberType::int16);
    EXPECT_EQ(temperature.scale, 0.01);
    EXPECT_EQ(temperature.offset, -2.0);
    const SensorRegister& humidity = environment.sensor->humidity_percent.value();
    EXPECT_EQ(humidity.space, RegisterSpace::holding_registers);
    EXPECT_EQ(humidity.order, WordOrder::low_first);
    EXPECT_EQ(humidity.scale, 1.0);
}

TEST(Environment, RefusesWhatNoRoomAndNoSensorHas) {
    EXPECT_THAT(refusal("environment: {temperature_c: [20.5, 19.9]}"),
                HasSubstr("[lowest, highest]"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19.9, 290]}"), HasSubstr("temperature_c"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19, 20], humidity_percent: [40, 101]}"),
                HasSubstr("humidity_percent"));
    EXPECT_THAT(refusal("environment: {humidity_percent: [40, 50]}"), HasSubstr("temperature_c"));
    EXPECT_THAT(refusal(replaced(by_sensor, "scale: 0.01", "scale: 0")), HasSubstr("scale"));
    EXPECT_THAT(refusal(replaced(by_sensor, "int16", "int8")), HasSubstr("type"));
    EXPECT_THAT(refusal(replaced(by_sensor, "register: 8", "register: 65535")), HasSubstr("65534"));
    EXPECT_THAT(refusal(replaced(by_sensor, "  humidity:", "  moisture:")), HasSubstr("moisture"));
    EXPECT_THAT(refusal("environment: {temperature_c: [19, 20], link: {host: a, port: 1}}"),
                HasSubstr("temperature"));
}

// By hand: the middle of 19.9 and 20.5 is 0.2 K from 20 C; 0.6 / sqrt(12); hypot(0.03, 0.04).
TEST(Environment, ByHandReplacesTheDeclaredTemperature) {
    const StationFile station = station_in(by_hand);
    const DeclaredTemperature temperature = temperature_of_run(station, {}).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::sqrt(0.04 + 0.36 / 12.0 + 0.0009 + 0.0016),
                1e-12);
    EXPECT_TRUE(std::isinf(temperature.degrees_of_freedom));
    EXPECT_EQ(temperature.marker_expansion_per_k, 9e-6);
    EXPECT_THAT(temperature.basis, HasSubstr("T-1"));
    EXPECT_NEAR(room_humidity(station, {})->mean, 46.0, 1e-12);
}

RunEnvironment readings(std::initializer_list<double> temperatures) {
    RunEnvironment environment;
    for (const double temperature : temperatures)
        environment.readings.push_back({7.0, temperature, 45.0});
    return environment;
}

// By hand: mean 20.5, s = 0.2; u^2 = 0.25 + 0.04 + 0.0025, nu = (u/s)^4 * 2.
TEST(Environment, ReadingsReplaceTheDeclaredTemperature) {
    const StationFile station = station_in(by_sensor);
    const RunEnvironment environment = readings({20.3, 20.7, 20.5});
    const DeclaredTemperature temperature = temperature_of_run(station, environment).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::sqrt(0.2925), 1e-12);
    EXPECT_NEAR(temperature.degrees_of_freedom, 2.0 * std::pow(0.2925 / 0.04, 2), 1e-6);
    EXPECT_EQ(room_temperature(station, environment)->lowest, 20.3);
    EXPECT_EQ(room_temperature(station, environment)->highest, 20.7);
}

TEST(Environment, LeavesTheDeclaredTemperatureWhereItIsNotMeasured) {
    const double declared = 0.3;
    const auto of = [](const StationFile& station, const RunEnvironment& environment) {
        return temperature_of_run(station, environment)->standard_uncertainty_k;
    };
    const StationFile station = station_in(by_sensor);
    EXPECT_EQ(of(station, readings({20.5})), declared);  // one reading has no spread
    RunEnvironment lost = readings({20.3, 20.7, 20.5});
    lost.lost = "no answer";
    EXPECT_EQ(of(station, lost), declared);
    StationFile untraced = station;
    untraced.references.clear();
    EXPECT_EQ(of(untraced, readings({20.1, 20.3, 20.2})), declared);
    StationFile without = station;
    without.environment.reset();
    EXPECT_EQ(of(without, {}), declared);
}

// It may be wrong itself, but what it says cannot be left out. By hand: mean 64.1, s = 0.3.
TEST(Environment, ReadingsWithoutACertificateOnlyWidenTheDeclaredTemperature) {
    StationFile station = station_in(by_sensor);
    station.references.clear();
    const DeclaredTemperature temperature =
        temperature_of_run(station, readings({64.1, 63.8, 64.4})).value();
    EXPECT_NEAR(temperature.standard_uncertainty_k, std::hypot(44.1, 0.3), 1e-9);
    EXPECT_THAT(temperature.basis, HasSubstr("without a certificate"));
}

// ---- station lock

constexpr uid_t other_user = 65534;

class StationLockTest : public testing::Test {
protected:
    StationLockTest() {
        std::filesystem::permissions(folder_ / "", std::filesystem::perms::all);
        use_folder(folder_ / "");
    }
    ~StationLockTest() override { unsetenv("ETALON_LOCK_FOLDER"); }

    static void use_folder(const std::filesystem::path& folder) {
        setenv("ETALON_LOCK_FOLDER", folder.c_str(), 1);
    }

    // A stage of two axes, driven by these units.
    static StationStage stage(const std::string& host = "192.0.2.1", int port = 502, int unit = 1,
                              std::optional<int> second_unit = std::nullopt) {
        StationStage stage;
        stage.link.address = TcpAddress{host, port};
        stage.link.unit = unit;
        stage.axes.resize(2);
        stage.axes[1].unit = second_unit;
        return stage;
    }
    static StationStage serial_stage(const std::filesystem::path& device) {
        StationStage stage;
        stage.link.address = SerialPort{device.string()};
        stage.axes.resize(1);
        return stage;
    }

    static std::string refusal(const StationStage& stage) {
        return config_error_of([&] { const StationLock second(stage, "x"); });
    }

    // The refusal in another process, after `prepare` has made it somebody else's; "skipped" where
    // that is not permitted.
    template <class Prepare>
    static std::string refusal_elsewhere(const StationStage& stage, Prepare prepare) {
        std::array<int, 2> ends{};
        EXPECT_EQ(pipe(ends.data()), 0);
        const pid_t child = fork();
        if (child == 0) {
            const std::string text = prepare() ? refusal(stage) : "skipped";
            const ssize_t count = write(ends[1], text.data(), text.size());
            _exit(count < 0);
        }
        close(ends[1]);
        std::string text;
        for (char c = 0; ::read(ends[0], &c, 1) == 1;)
            text += c;
        close(ends[0]);
        waitpid(child, nullptr, 0);
        return text;
    }

    static bool become_other_user() { return setgid(other_user) == 0 && setuid(other_user) == 0; }
    static bool leave_network() { return unshare(CLONE_NEWNET) == 0; }

    TemporaryFolder folder_;
};

TEST_F(StationLockTest, TellsASecondOneWhoHasTheFirst) {
    const StationLock first(stage(), "a qualification by Anna");
    EXPECT_EQ(refusal(stage()), "stage 192.0.2.1:502: is in use by a qualification by Anna");
}

TEST_F(StationLockTest, EndsWithItsHolder) {
    { const StationLock first(stage(), "a qualification by somebody with a long name"); }
    const StationLock again(stage(), "short");
    EXPECT_THAT(refusal(stage()), EndsWith("is in use by short"));
}

// However its address is spelled.
TEST_F(StationLockTest, IsOneForAStageWithTwoNames) {
    const StationLock first(stage("127.0.0.1"), "a motion");
    for (const char* host : {"localhost", "127.1"})
        EXPECT_THAT(refusal(stage(host)), HasSubstr("is in use by a motion")) << host;
}

// Stages behind one gateway share its address.
TEST_F(StationLockTest, IsForTheControllersOfTheAxes) {
    const StationLock first(stage("192.0.2.1", 502, 1, 2), "a motion");
    EXPECT_THAT(refusal(stage("192.0.2.1", 502, 2)), HasSubstr("is in use"));
    EXPECT_THAT(refusal(stage("192.0.2.1", 502, 3, 1)), HasSubstr("is in use"));
    EXPECT_EQ(refusal(stage("192.0.2.1", 502, 3, 4)), "no error");
    EXPECT_EQ(refusal(stage("192.0.2.1", 503, 1)), "no error");
    EXPECT_EQ(refusal(stage("192.0.2.2", 502, 1)), "no error");
}

// A serial line has one master: its units do not matter.
TEST_F(StationLockTest, OfASerialLineIsForTheDeviceBehindAnyName) {
    std::filesystem::create_symlink("/dev/null", folder_ / "by-id");
    const StationLock first(serial_stage("/dev/null"), "a motion");
    EXPECT_THAT(refusal(serial_stage(folder_ / "by-id")), HasSubstr("is in use by a motion"));
    EXPECT_EQ(refusal(serial_stage("/dev/zero")), "no error");
    struct stat null {};
    ASSERT_EQ(stat("/dev/null", &null), 0);
    if (mknod((folder_ / "node").c_str(), S_IFCHR | 0666, null.st_rdev) != 0)
        GTEST_SKIP() << "no device node can be made here";
    EXPECT_THAT(refusal(serial_stage(folder_ / "node")), HasSubstr("is in use by a motion"));
}

TEST_F(StationLockTest, HoldsAmongTwoUsers) {
    const StationLock first(stage(), "a motion by Anna");
    const std::string other = refusal_elsewhere(stage(), become_other_user);
    if (other == "skipped")
        GTEST_SKIP() << "needs the right to become another user";
    EXPECT_THAT(other, HasSubstr("is in use by a motion by Anna"));
    EXPECT_EQ(refusal_elsewhere(stage("192.0.2.7"), become_other_user), "no error");
    const StationLock file_of_the_other(stage("192.0.2.7"), "a motion by Bert");
    EXPECT_THAT(refusal_elsewhere(stage("192.0.2.7"), become_other_user),
                HasSubstr("is in use by a motion by Bert"));
}

// As of two containers that share the folder. Only the loopback interface is another one in each.
TEST_F(StationLockTest, HoldsAmongTwoNetworkNamespaces) {
    const StationLock first(stage(), "a motion"), own(stage("127.0.0.1"), "a motion");
    const std::string other = refusal_elsewhere(stage(), leave_network);
    if (other == "skipped")
        GTEST_SKIP() << "needs the right to make a network namespace";
    EXPECT_THAT(other, HasSubstr("is in use by a motion"));
    EXPECT_EQ(refusal_elsewhere(stage("127.0.0.1"), leave_network), "no error");
}

TEST_F(StationLockTest, ThatCannotBeTakenIsAnErrorThatNamesTheWayOn) {
    use_folder(folder_ / "none");
    EXPECT_THAT(refusal(stage()), StartsWith((folder_ / "none/etalon-stage-").string()));
    EXPECT_THAT(refusal(stage()), HasSubstr(".lock: cannot be locked: No such file or directory"));
    EXPECT_THAT(refusal(stage()), HasSubstr("Set ETALON_LOCK_FOLDER to a folder that"));
    const std::string denied = refusal_elsewhere(stage(), [&] {
        std::filesystem::create_directory(folder_ / "none");
        return become_other_user();
    });
    if (denied == "skipped")
        GTEST_SKIP() << "needs the right to become another user";
    EXPECT_THAT(denied, HasSubstr(".lock: cannot be locked: Permission denied"));
}

TEST_F(StationLockTest, FollowsNoLink) {
    { const StationLock first(stage(), "a motion"); }
    const auto file = std::filesystem::directory_iterator(folder_ / "")->path();
    std::filesystem::rename(file, folder_ / "elsewhere");
    std::filesystem::create_symlink(folder_ / "elsewhere", file);
    EXPECT_THAT(refusal(stage()), HasSubstr("cannot be locked: Too many levels of symbolic links"));
}

TEST(StationLock, HolderIsNamed) {
    EXPECT_THAT(stage_holder("homing", "Carl"), StartsWith("homing by Carl since "));
    EXPECT_THAT(stage_holder("homing", "Carl"), EndsWith("process " + std::to_string(getpid())));
}

}  // namespace
}  // namespace etalon
