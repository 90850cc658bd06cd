// The program `etalon study`, killed with SIGKILL at moments all over its run: the same command
// goes on with the poses that are missing, and the end is the folder of a study that nobody
// disturbed.

#include "core/statistics/random.h"
#include "tests/loopback/program.h"

namespace etalon {
namespace {

constexpr int poses = 40, rows_per_pose = 2;
constexpr int killed = -1;  // the exit code that Program gives to the victim of a signal

constexpr const char* killed_camera_text = R"(etalon: camera/1
serial: "S7"
image: {width: 320, height: 240}
intrinsics: {fx: 300, fy: 300, cx: 161.5, cy: 118.25}
lens: {f_number: 2, focus_distance_mm: 400, wavelength_nm: 550, psf: ideal}
sensor: {pixel_pitch_um: 6, bits: 8, transfer: linear, black: 0, gain_e_per_dn: 100,
         read_noise_e: 10, illumination: {cos4: false}}
)";

// Far enough away that some poses are missed.
constexpr const char* killed_study_text = R"(etalon: study/1
id: killed
camera: camera.yml
poses: {{count: {}, seed: 5, z_mm: [300, 900], roll_deg: [-40, 40], yaw_deg: [-180, 180]}}
detectors:
  - {{detector: apriltag, marker: "apriltag:36h11:5@50mm"}}
  - {{detector: aruco, marker: "aruco:4X4_50:7@45mm"}}
disturbances: {{jpeg: [60, 100]}}
)";

class KilledStudy : public testing::Test {
protected:
    KilledStudy() {
        write_text(folder_ / "camera.yml", killed_camera_text);
        write_study(poses);
    }

    void write_study(int count) const {
        write_text(folder_ / "study.yaml", fmt::format(killed_study_text, count));
    }

    std::unique_ptr<Program> begin(const std::string& out) const {
        return start_program("etalon", {"study", (folder_ / "study.yaml").string(), "--out",
                                        (folder_ / out).string()});
    }

    void finish(const std::string& out) const {
        const auto program = begin(out);
        const std::string text = program->rest();
        ASSERT_EQ(program->exit_code(), 0) << text;
    }

    // Ends the program as soon as the condition holds; whether it has not ended by itself before.
    template <class Condition>
    static bool kill_when(Program& program, Condition holds) {
        while (!holds() && !program.has_ended())
            std::this_thread::yield();
        program.send(SIGKILL);
        const int code = program.exit_code();
        EXPECT_TRUE(code == killed || code == 0) << code;
        return code == killed;
    }

    bool kill_at_file(const std::string& out, const std::string& file) const {
        const auto program = begin(out);
        return kill_when(*program, [&] { return std::filesystem::exists(folder_ / out / file); });
    }

    std::size_t bytes(const std::string& out) const {
        std::error_code error;
        const auto size = std::filesystem::file_size(folder_ / out / "results.csv", error);
        return error ? 0 : static_cast<std::size_t>(size);
    }
    // Of which every row is in the file.
    int whole_poses(const std::string& out) const {
        const std::string text = read_text(folder_ / out / "results.csv");
        return static_cast<int>(std::count(text.begin(), text.end(), '\n') - 1) / rows_per_pose;
    }

    // Names and content of all files but the times.
    std::map<std::string, std::string> files(const std::string& out) const {
        std::map<std::string, std::string> result;
        for (const auto& entry : std::filesystem::directory_iterator(folder_ / out))
            if (entry.path().filename() != "times.json")
                result[entry.path().filename().string()] = read_text(entry.path());
        return result;
    }

    void expect_like_undisturbed(const std::string& out) const {
        const auto expected = files("undisturbed"), found = files(out);
        for (const auto& [name, content] : expected) {
            ASSERT_TRUE(found.contains(name)) << name << " is missing";
            EXPECT_TRUE(found.at(name) == content) << name << " differs";
        }
        EXPECT_EQ(found.size(), expected.size());
    }

    TemporaryFolder folder_;
};

TEST_F(KilledStudy, GoesOnWithWhatIsMissingAndEndsWithTheSameBytes) {
    finish("undisturbed");
    ASSERT_EQ(whole_poses("undisturbed"), poses);
    RandomStream random(31, 4);
    std::set<std::size_t> moments;  // sizes of results.csv, in order
    while (moments.size() < 8)
        moments.insert(static_cast<std::size_t>(0.95 * random.uniform() *
                                                static_cast<double>(bytes("undisturbed"))));
    int kills = 0;
    for (const std::size_t moment : moments) {
        const int kept = bytes("out") == 0 ? 0 : whole_poses("out");
        const auto program = begin("out");
        if (kept < poses) {
            EXPECT_THAT(program->line(), StartsWith(fmt::format("study: 0 of {},", poses - kept)));
        }
        kills += kill_when(*program, [&] { return bytes("out") >= moment; });
    }
    finish("out");
    expect_like_undisturbed("out");
    // One that the machine holds up for as long as a report takes is too late.
    EXPECT_GE(kills, 5);
}

// What is made of the results, and the first files of a folder: each is there at once or not at
// all, and a folder that has only some of them is gone on with.
TEST_F(KilledStudy, IsNotHarmedWhereItWritesItsOtherFiles) {
    write_study(8);
    finish("undisturbed");
    int kills = 0, folders = 0;
    for (const char* file : {".", "results.csv", "study.json"}) {
        const std::string out = fmt::format("begun-{}", ++folders);
        kills += kill_at_file(out, file);
        finish(out);
        expect_like_undisturbed(out);
    }
    for (const char* file :
         {"pairs-apriltag.svg", "pairs-aruco.svg", "summary.csv", "summary.json"}) {
        for (const auto& [name, content] : files("begun-1"))
            if (name != "study.json" && name != "results.csv")
                std::filesystem::remove(folder_ / "begun-1" / name);
        kills += kill_at_file("begun-1", file);
    }
    finish("begun-1");
    expect_like_undisturbed("begun-1");
    EXPECT_GE(kills, 3);  // of 7, as above
}

}  // namespace
}  // namespace etalon
