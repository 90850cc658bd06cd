#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/image/image.h"
#include "station/render/commands.h"
#include "tests/error_text.h"
#include "tests/read_bytes.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using testing::HasSubstr;

std::filesystem::path temporary(const std::string& name) {
    static const TemporaryFolder folder;
    return folder / name;
}

std::string complaint(const MarkerArguments& arguments) {
    return config_error_of([&] { run_marker(arguments); });
}

TEST(MarkerCommand, WritesEachFormatByItsExtension) {
    for (const auto& [name, beginning] :
         {std::pair{"a.svg", "<?xml"}, {"a.pdf", "%PDF-1."}, {"a.png", "\x89PNG"}}) {
        EXPECT_EQ(run_marker({"apriltag:36h11:5@50mm", temporary(name), 10.0}), 0);
        EXPECT_THAT(read_bytes(temporary(name)), testing::StartsWith(beginning));
    }
}

TEST(MarkerCommand, TellsInJsonWhatIsOnThePage) {
    testing::internal::CaptureStdout();
    run_marker({"aruco:4X4_50:7@30mm", temporary("b.svg"), 40.0, true});
    const auto json = nlohmann::json::parse(testing::internal::GetCapturedStdout());
    EXPECT_EQ(json["etalon"], "marker/1");
    EXPECT_EQ(json["page_mm"], nlohmann::json({210.0, 297.0}));
    EXPECT_EQ(json["cells"], nlohmann::json({8, 8}));  // 4 data, 2 black, 2 white
    EXPECT_EQ(json["cell_mm"], nlohmann::json({5.0, 5.0}));
    EXPECT_EQ(json["points_mm"][1], nlohmann::json({15.0, -15.0, 0.0}));
}

TEST(MarkerCommand, RefusesInOneLineAndWritesNothing) {
    const auto out = temporary("c.svg");
    EXPECT_THAT(complaint({"aruco:4X4_51:7@30mm", out}), HasSubstr("MARKER: aruco:4X4_51:7@30mm"));
    EXPECT_FALSE(std::filesystem::exists(out));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", temporary("c.gif")}), HasSubstr(".svg, .pdf"));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", "/nowhere/c.svg"}),
                HasSubstr("cannot be written"));
    EXPECT_THAT(complaint({"aruco:4X4_50:7@30mm", temporary("c.png"), -1.0}),
                HasSubstr("not a resolution"));
}

}  // namespace
}  // namespace etalon
