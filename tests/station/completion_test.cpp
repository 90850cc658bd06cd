// What shells are told: from the declared commands and the tables of the program.

#include "compare/make_detector.h"
#include "station/commands.h"
#include "tests/test.h"

namespace etalon {
namespace {

using Words = std::vector<std::string>;

const DescribedCommand& program() {
    static const DescribedCommand described = describe_program(declare_commands);
    return described;
}

Words completed(const Words& words) {
    return completed_words(program(), words);
}

TEST(Completion, NamesCommandsAndThoseBelowThem) {
    EXPECT_THAT(completed({"qua"}), ElementsAre(StartsWith("qualify\tqualify a camera")));
    EXPECT_THAT(completed({}), Contains(StartsWith("devices\t")));
    EXPECT_THAT(completed({"camera", "c"}),
                ElementsAre(StartsWith("convert\t"), StartsWith("check\t")));
    EXPECT_THAT(completed({"camera", "show", "c"}), ElementsAre(":files"));
}

TEST(Completion, NamesOptionsOfTheCommandThatIsTyped) {
    EXPECT_THAT(completed({"qualify", "--re"}), ElementsAre(StartsWith("--resume\tin place of")));
    EXPECT_THAT(completed({"qualify", "station.yaml", "--"}), Contains(StartsWith("--homed\t")));
    EXPECT_THAT(completed({"demo", "--", "--"}), IsEmpty());
}

TEST(Completion, KnowsFilesFoldersAndStations) {
    EXPECT_THAT(completed({"qualify", ""}), ElementsAre(":files yaml|yml"));
    EXPECT_THAT(completed({"qualify", "--out", "r"}), ElementsAre(":folders"));
    EXPECT_THAT(completed({"compare", "--camera", ""}), ElementsAre(":files"));
    EXPECT_THAT(completed({"stage", "move", ""}), ElementsAre(":files yaml|yml"));
}

TEST(Completion, KnowsFamiliesDetectorsModelsToolsAndProfiles) {
    EXPECT_THAT(completed({"render", "--marker", "apriltag:36h11"}),
                ElementsAre("apriltag:36h11:"));
    EXPECT_THAT(completed({"marker", "stag:HD1"}), ElementsAre("stag:HD17:", "stag:HD19:"));
    EXPECT_THAT(completed({"detect", "--detector", "aruco-"}),
                ElementsAre("aruco-none", "aruco-contour", "aruco-apriltag"));
    EXPECT_THAT(completed({"calibrate", "--model", "kan"}), ElementsAre("kannala_brandt"));
    EXPECT_THAT(completed({"camera", "convert", "--to", "m"}), ElementsAre("mrcal", "matlab"));
    EXPECT_THAT(completed({"render", "--method", "r"}), ElementsAre("reference"));
    EXPECT_THAT(completed({"stage", "check", "leadshine-e"}),
                ElementsAre("leadshine-em2rs", ":files yaml|yml"));
}

// What is offered is taken: the lists cannot fall behind.
TEST(Completion, OffersOnlyWhatTheProgramTakes) {
    const Marker marker = parse_marker("apriltag:36h11:5@50mm", "test");
    for (const std::string& name : detector_names())
        try {
            make_detector(name, marker, "test");
        } catch (const ConfigError& error) {
            EXPECT_THAT(error.what(), Not(HasSubstr("there is no detector"))) << name;
        }
    for (const std::string& kind : marker_kinds())
        try {
            parse_marker(kind + ":x@50mm", "test");
        } catch (const ConfigError& error) {
            EXPECT_THAT(error.what(), Not(HasSubstr("unknown kind"))) << kind;
        }
}

TEST(Completion, ListsEveryCommandButNoGroup) {
    const Words lines = command_lines(program());
    for (const char* command : {"qualify\t", "camera convert\t", "oc\t", "oc merge\t", "demo\t"})
        EXPECT_THAT(lines, Contains(StartsWith(command)));
    EXPECT_THAT(lines, Each(Not(StartsWith("camera\t"))));
}

}  // namespace
}  // namespace etalon
