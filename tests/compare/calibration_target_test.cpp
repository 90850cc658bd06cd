// Truth: targets rendered exactly at known poses; points where the projector puts them.
#include "compare/calibration_target.h"

#include <gtest/gtest.h>

#include "core/errors.h"
#include "rendered_tags.h"

namespace etalon {
namespace {

TEST(CalibrationTarget, ChessboardPointsAreWhereTheProjectorPutsThem) {
    const CalibrationTarget target = parse_calibration_target("chessboard:7x4@11mm", "--target");
    const auto photo =
        test::render_tag(test::sharp_camera(), target.board, {0.2, -0.3, 0.4, -30, -20, 250});
    const auto view = observe(target, photo.image);
    ASSERT_TRUE(view);
    ASSERT_EQ(view->pixels.size(), 28u);
    EXPECT_EQ(view->points_mm, target.board.points_mm);
    for (std::size_t i = 0; i < view->pixels.size(); ++i)
        EXPECT_LT((view->pixels[i] - photo.corners[i]).norm(), 0.1) << i;
}

TEST(CalibrationTarget, RefusesWhatIsNoBoard) {
    for (const char* spec : {"apriltag:36h11:5@50mm", "aruco:4X4_50:7@50mm", "chessboard:2x5@25mm",
                             "chessboard:9x6@0mm", "board:9x6@25mm", ""})
        EXPECT_THROW(parse_calibration_target(spec, "--target"), ConfigError) << spec;
}

}  // namespace
}  // namespace etalon
