// The built program as a user meets it: exit codes, one-line errors, nothing half-written.
#include <unistd.h>

#include <cerrno>
#include <future>

#include "core/file/file_writing.h"
#include "core/image/image.h"
#include "station/shell/signals.h"
#include "tests/station/built_program.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

TEST(CommandLine, HelpFits80ColumnsAndNamesEveryCommand) {
    const TemporaryFolder folder;
    const std::string main_help = etalon_with(folder, "--help").out;
    for (const char* command : {"", "qualify", "compare", "calibrate", "render", "detect", "marker",
                                "devices", "study"}) {
        EXPECT_THAT(main_help, HasSubstr(command));
        const Finished help = etalon_with(folder, std::string(command) + " --help");
        EXPECT_EQ(help.exit_code, 0);
        EXPECT_EQ(help.err, "");
        expect_80_columns(help.out);
    }
}

TEST(CommandLine, VersionNamesLibrariesAndBackends) {
    const TemporaryFolder folder;
    const Finished version = etalon_with(folder, "--version");
    EXPECT_EQ(version.exit_code, 0);
    for (const char* word : {"etalon ", "OpenCV ", "libmodbus ", "genicam ", "modbus-tcp "})
        EXPECT_THAT(version.out, HasSubstr(word));
}

TEST(CommandLine, UsageErrorsAreOneLineAndExitCode3) {
    const TemporaryFolder folder;
    expect_one_line_error(etalon_with(folder, ""), 3, "no command given");
    expect_one_line_error(etalon_with(folder, "qualfy"), 3, "qualfy");
    expect_one_line_error(etalon_with(folder, "qualify"), 3, "required");
    expect_one_line_error(etalon_with(folder, "qualify a.yaml --ot x"), 3, "");
    expect_one_line_error(
        etalon_with(folder, "calibrate a.png --board 9x6 --square-mm nan --out c.yml"), 3,
        "--square-mm: must be a number above 0, not 'nan'");
    expect_one_line_error(etalon_with(folder, "calibrate a.png --board 9x6 --square-mm -1 --out c"),
                          3, "--square-mm");
}

// Words that programs read from stdout, docs/files.md.
TEST(CommandLine, NoNameForgesALine) {
    const TemporaryFolder folder;
    write_station(folder, replaced(station_text, "id: test-station", "id: \"a\\nverdict PASS\""));
    expect_one_line_error(etalon_with(folder, "plan station.yaml"), 3,
                          "station.yaml:2: id: must be a line of text: 'a\\nverdict PASS'");
    expect_one_line_error(etalon_with(folder, "detect \"$(printf 'a\\nverdict PASS')\" --marker x"),
                          3, "'a\\nverdict PASS' holds a control character");
    write_text(folder / "a\nverdict PASS.png", "");
    expect_one_line_error(etalon_with(folder, "detect '*.png' --marker apriltag:36h11:5@50mm"), 3,
                          "a\\nverdict PASS.png: holds a control character");
}

TEST(CommandLine, SaysWhatIsNoFileAndWhatAFileLacks) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "d");
    for (const char* command :
         {"plan d", "camera show d", "detect d --marker apriltag:36h11:5@50mm",
          "calibrate d --board 9x6 --square-mm 25 --out c.yml"})
        expect_one_line_error(etalon_with(folder, command), 3, "d: is a folder, not a file");
    write_station(folder);
    write_text(folder / "camera.yml", replaced(camera_text, "etalon: camera/1\n", ""));
    expect_one_line_error(etalon_with(folder, "camera show camera.yml"), 3,
                          "camera.yml:1: must begin with 'etalon: camera/1'");
    write_text(folder / "station.yaml", replaced(station_text, "etalon: station/1\n", ""));
    expect_one_line_error(etalon_with(folder, "plan station.yaml"), 3,
                          "station.yaml:1: must begin with 'etalon: station/1'");
}

// TEST-NET-1 (RFC 5737) is nobody's.
TEST(CommandLine, ServeNamesTheOptionThatIsWrong) {
    const TemporaryFolder folder;
    write_station(folder);
    expect_one_line_error(etalon_with(folder, "serve station.yaml --listen 192.0.2.7"), 3,
                          "--listen: 192.0.2.7:7530 cannot be listened on: it is no address");
}

// Nobody listens on port 9 of the loopback interface.
TEST(CommandLine, AStopThatIsNotConfirmedSaysWhy) {
    const TemporaryFolder folder;
    write_station(folder, replaced(station_text, "port: 1599", "port: 9"));
    expect_one_line_error(etalon_with(folder, "stage stop station.yaml"), 4,
                          "its axes stand still; last request: unit 2: ");
    EXPECT_THAT(read_text(folder / "err.txt"), EndsWith("cannot connect: Connection refused\n"));
}

TEST(CommandLine, SaysWhatIsNotKnownAndWhatWasMeant) {
    const TemporaryFolder folder;
    const auto refused = [&](const std::string& arguments, const std::string& message) {
        const Finished finished = etalon_with(folder, arguments);
        expect_one_line_error(finished, 3, "");
        EXPECT_EQ(finished.err, "etalon: " + message + "\n");
    };
    refused("qualfy", "'qualfy' is no command of etalon; did you mean 'qualify'?");
    refused("cal", "'cal' is no command of etalon; did you mean 'calibrate'?");
    refused("stage stat x", "'stat' is no command of stage; did you mean 'status'?");
    refused("--versoin", "'--versoin' is no option of etalon; did you mean '--version'?");
    // before what is missing, which it may be meant to be
    refused("calibrate a.png --ot=x", "'--ot' is no option of calibrate; did you mean '--out'?");
    refused("qualify a.yaml b.yaml", "'b.yaml' is one argument too many");
    refused("render --camera a --camera b", "--camera is given more than once: it takes one value");
    refused("study a.yaml --shard", "--shard needs a value");
    EXPECT_THAT(etalon_with(folder, "stage").err,
                StartsWith("etalon: stage needs one of status, "));
    EXPECT_THAT(etalon_with(folder, "calibrate a.png --board 9x6 --square-mm 1,5 --out c").err,
                EndsWith("not '1,5'; a decimal point is a dot: 1.5\n"));
}

TEST(CommandLine, NamesTheLineAndKeyOfABadCameraFile) {
    const TemporaryFolder folder;
    write_station(folder);
    const auto refused = [&](const std::string& what, const std::string& by,
                             const std::string& message) {
        write_text(folder / "camera.yml", replaced(camera_text, what, by));
        expect_one_line_error(
            etalon_with(folder,
                        "render --camera camera.yml --marker apriltag:36h11:5@50mm "
                        "--pose 0,0,0,0,0,300 --out r.png"),
            3, message);
        EXPECT_FALSE(std::filesystem::exists(folder / "r.png")) << by;
    };
    refused("fx: 275.0", "fx: .nan", "camera.yml:4: intrinsics.fx: ");
    refused("fx: 275.0, ", "", "intrinsics.fx: missing");
    refused("distortion:", "distorsion:", "camera.yml:5: distorsion: unknown key");
    refused("cx: 158.3", "cx: 158.3, cx: 158.3", "intrinsics.cx: doubled key");
    refused("distortion: {k1: -0.05}",
            "lens: {f_number: 0, focus_distance_mm: 300, wavelength_nm: 550}\n"
            "sensor: {pixel_pitch_um: 5}",
            "camera.yml:5: lens.f_number: ");
}

TEST(CommandLine, QualifyRefusesBadInputBeforeAnythingIsTouched) {
    const TemporaryFolder folder;
    const auto refused = [&](const std::string& what, const std::string& by,
                             const std::string& message) {
        write_station(folder, replaced(station_text, what, by));
        expect_one_line_error(etalon_with(folder, "qualify station.yaml --out record"), 3, message);
        EXPECT_FALSE(std::filesystem::exists(folder / "record")) << by;
    };
    refused("frames: 2", "frames: two", "station.yaml:28: plan.frames: must be a finite number");
    refused("frames: 2", "frames: &a [*a]", "station.yaml:28: an alias of the value");
    refused("frames: 2", "frames: \xe9", "station.yaml:28: is not UTF-8: a byte 0xe9");
    refused("y: [-40, 45]", "y: [-40, 56]", "station.yaml:25: plan.volume.y: ");
    refused("calibration: camera.yml", "calibration: c.yml",
            "station.yaml:5: camera.calibration: ");
    expect_one_line_error(etalon_with(folder, "qualify nothing.yaml --out record"), 3,
                          "nothing.yaml: no such file");
}

TEST(CommandLine, QualifyRefusesAFolderWithSomethingInIt) {
    const TemporaryFolder folder;
    write_station(folder);
    std::filesystem::create_directories(folder / "record");
    write_text(folder / "record/other.txt", "precious");
    const Finished finished = etalon_with(folder, "qualify station.yaml --out record");
    EXPECT_EQ(finished.exit_code, 3);
    EXPECT_THAT(finished.err, EndsWith("etalon: --out: record is not empty\n"));
    EXPECT_EQ(read_text(folder / "record/other.txt"), "precious");
}

// The lock is that of a program that is at work there.
TEST(CommandLine, ARecordInUseIsNeitherResumedNorReported) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder / "record");
    write_text(folder / "record/events.jsonl", "");
    const auto first_line = [&](const std::string& command) {
        const Finished finished = etalon_with(folder, command);
        EXPECT_EQ(finished.exit_code, 3) << finished.err;
        return finished.err;
    };
    {
        const FolderLock held(folder / "record");
        for (const char* command : {"qualify --resume record", "report record"})
            EXPECT_EQ(first_line(command),
                      "etalon: record: is in use: another etalon is writing to this folder\n");
    }
    EXPECT_THAT(first_line("qualify --resume record"), Not(HasSubstr("in use")));
}

// /dev/full takes what is written to it as a full disk does.
TEST(CommandLine, AResultThatCannotBeWrittenIsExitCode4) {
    const TemporaryFolder folder;
    write_station(folder);
    const int status = std::system(fmt::format("cd '{}' && '{}' camera show camera.yml "
                                               ">/dev/full 2>err.txt",
                                               (folder / "").string(), built_program("etalon"))
                                       .c_str());
    EXPECT_EQ(WEXITSTATUS(status), 4);
    EXPECT_EQ(read_text(folder / "err.txt"), "etalon: stdout: cannot be written\n");
    std::filesystem::create_symlink("/dev/full", folder / "x.yml");
    const Finished full = etalon_with(folder, "camera convert camera.yml --to etalon --out x.yml");
    EXPECT_EQ(full.exit_code, 4);
    EXPECT_THAT(full.err, HasSubstr("x.yml: cannot be written: No space left on device"));
}

constexpr const char* tag_in_view = "--marker apriltag:36h11:5@60mm --pose 0,0,0,5,-7,330 ";

// What was done is done, whether or not somebody reads how far it is.
TEST(CommandLine, ALostWordOfProgressEndsNothing) {
    const TemporaryFolder folder;
    write_station(folder);
    const std::string render =
        fmt::format("render --camera camera.yml {}--out tag.png", tag_in_view);
    ASSERT_EQ(etalon_with(folder, render).exit_code, 0);
    const std::string picture = read_bytes(folder / "tag.png");
    const std::string detect = "detect tag.png --marker apriltag:36h11:5@60mm";
    const std::string corners = etalon_with(folder, detect).out;
    EXPECT_NE(corners, "");
    for (const char* lost : {"2>/dev/full", "2>&-"}) {
        const auto exit_code_of = [&](const std::string& command) {
            const int status =
                std::system(fmt::format("cd '{}' && '{}' {} >out.txt {}", (folder / "").string(),
                                        built_program("etalon"), command, lost)
                                .c_str());
            return WEXITSTATUS(status);
        };
        std::filesystem::remove(folder / "tag.png");
        EXPECT_EQ(exit_code_of(render), 0) << lost;
        EXPECT_EQ(read_bytes(folder / "tag.png"), picture) << lost;
        EXPECT_EQ(exit_code_of(detect), 0) << lost;
        EXPECT_EQ(read_text(folder / "out.txt"), corners) << lost;
        EXPECT_EQ(exit_code_of("camera show none.yml"), 3) << lost;
    }
}

// Under its own name, through a link and by a second name.
TEST(CommandLine, AnInputIsNotWrittenOver) {
    const TemporaryFolder folder;
    write_station(folder);
    write_image(folder / "bg.png", {cv::Mat(240, 320, CV_8UC1, cv::Scalar(120)), 8});
    const std::string camera = read_text(folder / "camera.yml");
    const std::string background = read_bytes(folder / "bg.png");
    std::filesystem::create_symlink("camera.yml", folder / "link.yml");
    std::filesystem::create_hard_link(folder / "camera.yml", folder / "second.yml");
    const std::string convert = "camera convert camera.yml --to etalon --out ";
    const std::string render = fmt::format("render --camera camera.yml {}", tag_in_view);
    for (const std::string& command :
         {convert + "camera.yml", convert + "link.yml", convert + "second.yml",
          convert + "./camera.yml", render + "--background bg.png --out bg.png",
          std::string("marker bitmap:bg.png@64x48mm --out bg.png")}) {
        const Finished finished = etalon_with(folder, command);
        EXPECT_EQ(finished.exit_code, 3) << command;
        EXPECT_THAT(finished.err, HasSubstr("is an input of this command and stays")) << command;
    }
    EXPECT_EQ(read_text(folder / "camera.yml"), camera);
    EXPECT_EQ(read_bytes(folder / "bg.png"), background);
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "link.yml"));
    EXPECT_EQ(etalon_with(folder, convert + "other.yml").exit_code, 0);
}

TEST(CommandLine, APipeIsWrittenToAndStays) {
    const TemporaryFolder folder;
    write_station(folder);
    const int status = std::system(
        fmt::format("cd '{}' && '{}' camera convert camera.yml --to ros --out /dev/stdout "
                    "2>err.txt | cat >out.txt",
                    (folder / "").string(), built_program("etalon"))
            .c_str());
    EXPECT_EQ(WEXITSTATUS(status), 0);
    EXPECT_THAT(read_text(folder / "out.txt"), HasSubstr("distortion_model"));
    EXPECT_TRUE(std::filesystem::is_symlink("/dev/stdout"));
}

// Whatever a command writes there.
TEST(CommandLine, AFolderInUseIsWrittenByNoOtherProgram) {
    const TemporaryFolder folder;
    write_station(folder);
    write_text(folder / "poses.csv", "rx,ry,rz,tx,ty,tz\n0,0,0,5,-7,330\n");
    ASSERT_EQ(
        etalon_with(folder, fmt::format("render --camera camera.yml {}--out tag.png", tag_in_view))
            .exit_code,
        0);
    const FolderLock held = claim_folder(folder / "out");
    for (const char* command :
         {"render --camera camera.yml --marker apriltag:36h11:5@60mm --poses poses.csv --out out",
          "compare tag.png --camera camera.yml --marker apriltag:36h11:5@60mm --out out",
          "capture --camera files:. --frames 1 --out out", "schema camera.yml --out out",
          "init out --camera files:. --calibration camera.yml --stage 127.0.0.1:9 "
          "--profile generic --axes x,y,z --marker apriltag:36h11:5@60mm"}) {
        const Finished finished = etalon_with(folder, command);
        EXPECT_EQ(finished.exit_code, 3) << command << finished.err;
        EXPECT_THAT(finished.err,
                    EndsWith("etalon: out: is in use: another etalon is writing to this folder\n"))
            << command;
    }
    EXPECT_TRUE(std::filesystem::is_empty(folder / "out"));
}

// Nobody listens on port 9 of the loopback interface.
TEST(CommandLine, ADeviceThatDoesNotAnswerIsExitCode4) {
    const TemporaryFolder folder;
    write_image(folder / "a.png", {cv::Mat(240, 320, CV_8UC1, cv::Scalar(9)), 8});
    const std::string text =
        replaced(replaced(station_text, "uri: \"genicam:127.0.0.1\"", "uri: \"files:.\""),
                 "port: 1599", "port: 9");
    write_station(folder, text);
    const Finished finished = etalon_with(folder, "qualify station.yaml --out record");
    EXPECT_EQ(finished.exit_code, 4) << finished.err;
    EXPECT_FALSE(std::filesystem::exists(folder / "record"));
}

TEST(CommandLine, APhotographCountsOnce) {
    const TemporaryFolder folder;
    write_image(folder / "a.png", {cv::Mat(240, 320, CV_8UC1, cv::Scalar(9)), 8});
    std::filesystem::create_symlink("a.png", folder / "b.png");
    for (const char* twice : {"a.png ./a.png", "a.png b.png", "'*.png'"})
        expect_one_line_error(
            etalon_with(folder, std::string("detect --marker apriltag:36h11:5@50mm ") + twice), 3,
            "is given twice");
}

// A JPEG's head with EXIF's orientation 6, which viewers turn by a right angle.
TEST(CommandLine, TellsOfPhotographsThatAreMarkedAsRotated) {
    const TemporaryFolder folder;
    write_image(folder / "a.png", {cv::Mat(240, 320, CV_8UC1, cv::Scalar(9)), 8});
    constexpr char head[] =
        "\xff\xd8\xff\xe1\0\x22"
        "Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    write_text(folder / "b.jpg", {head, sizeof head - 1});
    EXPECT_THAT(etalon_with(folder, "detect --marker apriltag:36h11:5@50mm a.png b.jpg").err,
                StartsWith("1 of 2 photographs are marked as rotated (EXIF): "));
}

// ---- signals

bool requests_stop(int signal) {
    std::stop_source source;
    std::promise<void> requested;
    const std::stop_callback callback(source.get_token(), [&] { requested.set_value(); });
    const StopOnSignals signals(source);
    kill(getpid(), signal);
    return requested.get_future().wait_for(std::chrono::seconds(10)) == std::future_status::ready;
}

TEST(StopOnSignals, RequestsAStopForWhateverWouldEndTheProgram) {
    EXPECT_TRUE(requests_stop(SIGINT));
    EXPECT_TRUE(requests_stop(SIGTERM));
    EXPECT_TRUE(requests_stop(SIGQUIT));
    EXPECT_TRUE(requests_stop(SIGHUP));
}

TEST(StopOnSignals, OutlivesTheReaderOfItsOutput) {
    const StopOnSignals signals({});
    std::array<int, 2> ends{};
    ASSERT_EQ(pipe(ends.data()), 0);
    close(ends[0]);
    EXPECT_EQ(write(ends[1], "x", 1), -1);
    EXPECT_EQ(errno, EPIPE);
    close(ends[1]);
}

}  // namespace
}  // namespace etalon
