// Edges of photographs by the reference integrator, with shot, read and quantisation noise, that
// differ from the prediction by known amounts: each must come out within its stated deviation, and
// not in place of another.
#include "compare/edges/edge_shifts.h"

#include <cstdio>
#include <ctime>

#include "compare/edges/edge_summary.h"
#include "core/statistics/distributions.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

// By how much photograph and prediction differ. Levels in gray.
struct Difference {
    const char* name;
    Eigen::Vector2d moved_px = Eigen::Vector2d::Zero();  // about: at the board's depth of 500 mm
    double variance_px2 = 0.0;                           // of the Gaussian, in px along x
    double black = 0.0, white = 0.0;
};

constexpr double sigma_px = 0.5;

// Twice the noise of the other tests of edges: the integrator's error is small beside it.
EdgeScene noisy_board() {
    EdgeScene scene = small_board(sigma_px);
    scene.camera.sensor->gain_e_per_dn = 0.2;
    scene.camera.sensor->read_noise_e = 3.5;
    return scene;
}

struct Prediction {
    EdgeScene scene = noisy_board();
    PhotometricCamera camera{scene.camera};
    cv::Mat use =
        pixel_uses(camera.projector(), scene.pose, compared_area(scene.board, {}, "test"));

    Eigen::Vector3d translation(const Difference& difference) const {
        const Intrinsics& k = scene.camera.intrinsics;
        return {difference.moved_px.x() * 500.0 / k.fx, difference.moved_px.y() * 500.0 / k.fy, 0};
    }

    // What the board at the displaced pose looks like behind the wider blur.
    Radiance radiance(const Difference& difference, int samples) const {
        EdgeScene other = scene;
        other.pose.translation += translation(difference);
        set_gaussian(other.camera, std::sqrt(sigma_px * sigma_px + difference.variance_px2));
        return other.reference(samples);
    }

    PhotoState state(const Difference& difference) const {
        const double black_gray = scene.camera.sensor->black_dn / 4095.0 * 255.0;
        PhotoState state{scene.pose, {}};
        state.photometry.black[0] = black_gray - difference.black;
        state.photometry.white[0] = 255.0 - difference.white;
        return state;
    }

    std::vector<EdgeShift> shifts(const cv::Mat& gray, const Difference& difference) const {
        const PhotoOfMarker photo{gray, scene.board.grid, use, pixel_fitted, 0.3};
        return edge_shifts(photo, camera, state(difference));
    }

    cv::Mat photo(const Radiance& radiance, int seed) const {
        const NoiseKey key{23, static_cast<std::uint32_t>(seed)};
        return gray_of(SensorModel(scene.camera).expose(radiance, key));
    }
    std::vector<EdgeShift> shifts_without_noise(const Difference& difference, int samples) const {
        return shifts(predicted_gray(state({}).photometry, radiance(difference, samples), {}),
                      difference);
    }

    // How far the edge's middle moved along its normal.
    double true_shift(const EdgeShift& edge, const Difference& difference) const {
        Eigen::Vector3d point = camera.projector().unproject(edge.middle_px).value().homogeneous();
        point *= edge.depth_mm;
        return (camera.projector().project(point + translation(difference)).value() -
                edge.middle_px)
            .dot(edge.normal);
    }
    // The Gaussian is round on the sensor: wider in px along y by fy / fx.
    double true_variance(const EdgeShift& edge, const Difference& difference) const {
        const double ratio = scene.camera.intrinsics.fy / scene.camera.intrinsics.fx;
        return difference.variance_px2 *
               Eigen::Vector2d(edge.normal.x(), edge.normal.y() * ratio).squaredNorm();
    }
};

// 49 edges, 24 draws. The integrator's error is common to all draws: 0.0022 px, a fifth of an
// edge's deviation. Means within 3.5 sqrt(1/1176 + 0.04/49) = 0.14, and 0.05 for what the second
// order in blur leaves. Deviations are multiplied by max(1, sqrt(chi^2)), which is 1.02 on average
// for the 180 pixels of an edge: mean squares 0.95 + 0.04 +- 3.5 sqrt(2/1176).
void expect_fair(const char* name, const char* what, const Pulls& pulls) {
    EXPECT_LT(std::abs(pulls.mean()), 0.19) << name << ", " << what;
    EXPECT_GT(pulls.square(), 0.84) << name << ", " << what;
    EXPECT_LT(pulls.square(), 1.14) << name << ", " << what;
}

class KnownDifferences : public ::testing::TestWithParam<Difference> {};

TEST_P(KnownDifferences, ComeOutWithinTheirDeviationsAndNotInPlaceOfEachOther) {
    constexpr int draws = 24;
    const Prediction predicted;
    const Difference& known = GetParam();
    const Radiance radiance = predicted.radiance(known, 128);
    Pulls shift, blur, black, white;
    for (int seed = 0; seed < draws; ++seed) {
        const std::vector<EdgeShift> found =
            predicted.shifts(predicted.photo(radiance, seed), known);
        ASSERT_EQ(found.size(), 49u);  // 16 + 15 between inner corners, and 18 beside them
        for (const EdgeShift& edge : found) {
            ASSERT_FALSE(edge.is_beyond_range);
            shift.add(edge.shift_px - predicted.true_shift(edge, known), edge.shift_deviation_px);
            blur.add(edge.blur_variance_px2 - predicted.true_variance(edge, known),
                     edge.blur_deviation_px2);
            black.add(edge.black_gray - known.black, edge.black_deviation_gray);
            white.add(edge.white_gray - known.white, edge.white_deviation_gray);
        }
    }
    expect_fair(known.name, "shift", shift);
    expect_fair(known.name, "blur", blur);
    expect_fair(known.name, "black", black);
    expect_fair(known.name, "white", white);
}

INSTANTIATE_TEST_SUITE_P(Edges, KnownDifferences,
                         ::testing::Values(Difference{"none"}, Difference{"moved", {0.17, -0.11}},
                                           Difference{"blurred", {0, 0}, 0.07},
                                           Difference{"levels", {0, 0}, 0.0, 1.5, -3.5},
                                           Difference{"all", {-0.23, 0.31}, 0.05, -2.0, 3.0}),
                         [](const auto& known) { return std::string(known.param.name); });

// RMS over the edges of a figure's error.
template <typename Error>
double rms(const std::vector<EdgeShift>& found, const Error& error) {
    double squares = 0.0;
    for (const EdgeShift& edge : found)
        squares += error(edge) * error(edge);
    return std::sqrt(squares / static_cast<double>(found.size()));
}

// Without noise. Half a pixel along both axes is up to 0.5 px along the normals; the blurs are a
// third of the rendered edge's variance (0.33 px^2 with the pixel), either way. The integrator's
// own error is 0.0031 px of an edge at these samples (two of its seeds against each other); the
// method adds less (against renderings of displaced boards: 0.0004 px at most).
TEST(EdgeShifts, OfHalfAPixelAndOfAThirdOfTheBlurAreRight) {
    const Prediction predicted;
    for (const Difference& known : {Difference{"half a pixel", {-0.36, -0.5}},
                                    {"narrower", {0, 0}, -0.1},
                                    {"wider", {0, 0}, 0.1}}) {
        const auto found = predicted.shifts_without_noise(known, 64);
        double largest = 0.0, blur_ratio = 0.0;
        for (const EdgeShift& edge : found) {
            largest = std::max(largest, std::abs(edge.shift_px));
            if (known.variance_px2 != 0.0)
                blur_ratio += edge.blur_variance_px2 / predicted.true_variance(edge, known) / 49.0;
        }
        const double shift = rms(found, [&](const EdgeShift& edge) {
            return edge.shift_px - predicted.true_shift(edge, known);
        });
        const double blur =
            rms(found, [](const EdgeShift& edge) { return edge.blur_variance_px2; });
        EXPECT_LT(shift, 0.0045) << known.name;
        if (known.variance_px2 == 0.0) {
            EXPECT_GT(largest, 0.45);
            EXPECT_LT(blur, 0.012);
        } else {
            EXPECT_NEAR(blur_ratio, 1.0, 0.05) << known.name;
        }
    }
}

TEST(EdgeShifts, BeyondTheirRangeAreSaidToBe) {
    const Prediction predicted;
    const Difference known{"", {1.3, 0.2}};
    const auto found = predicted.shifts_without_noise(known, 32);
    int beyond = 0;
    for (const EdgeShift& edge : found) {
        if (std::abs(predicted.true_shift(edge, known)) > 1.0) {
            EXPECT_TRUE(edge.is_beyond_range) << edge.shift_px;
        }
        beyond += edge.is_beyond_range;
    }
    EXPECT_GE(beyond, 20);
    EXPECT_EQ(edge_summary(found).beyond_range, beyond);
}

// Each part times the residual, summed, is that part's share: they add up to the residual's sum of
// squares, and the part that is the cause has all of it but what the integrator's error adds (at
// these samples 0.8 gray a pixel on the edges).
TEST(EdgeShifts, PartsAddUpAndNameTheirCause) {
    const Prediction predicted;
    const auto square = [](double part) { return part * std::abs(part); };
    for (const Difference& known : {Difference{"", {0.3, 0.4}}, Difference{"", {0, 0}, 0.1},
                                    Difference{"", {0, 0}, 0, 4, 7}}) {
        const EdgeParts parts = edge_summary(predicted.shifts_without_noise(known, 64)).parts;
        const double whole = square(parts.residual_gray);
        EXPECT_NEAR(square(parts.shift_gray) + square(parts.blur_gray) +
                        square(parts.photometric_gray) + square(parts.rest_gray),
                    whole, 1e-9 * whole);
        const double cause = known.moved_px.norm() > 0 ? parts.shift_gray
                             : known.variance_px2 > 0  ? parts.blur_gray
                                                       : parts.photometric_gray;
        EXPECT_NEAR(square(cause), whole, 0.02 * whole + 0.6);
        EXPECT_GT(whole, 4.0);
    }
}

// A board of 9 x 6 corners in a VGA photograph; CPU time of all threads.
TEST(EdgeShifts, OfABoardTakeLessThanAThirdOfASecond) {
    EdgeScene scene{edge_camera(640, 480), gray_board("chessboard:9x6@25mm"),
                    pose_of(0.1, -0.2, 0.05, -100.0, -60.0, 480.0)};
    scene.camera.lens.reset();
    const PhotometricCamera camera(scene.camera);
    const cv::Mat use =
        pixel_uses(camera.projector(), scene.pose, compared_area(scene.board, {}, "test"));
    PhotoState state{scene.pose, {}};
    state.photometry.white[0] = 255.0;
    state.photometry.psf_sigma_px = 0.7;
    const cv::Mat gray = predicted_gray(state.photometry, scene.rendered(), {});
    const PhotoOfMarker photo{gray, scene.board.grid, use, pixel_fitted, 0.3};
    const auto start = std::clock();
    const std::vector<EdgeShift> found = edge_shifts(photo, camera, state);
    const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    EXPECT_EQ(found.size(), 123u);
    EXPECT_LT(seconds, 1.0);  // 0.3 s, with room for a sanitizer
}

TEST(EdgeShifts, RefuseWhatIsNoPhotograph) {
    const Prediction predicted;
    cv::Mat gray(predicted.use.size(), CV_32FC1, cv::Scalar(100));
    EXPECT_THROW(predicted.shifts(gray.rowRange(0, 20), {}), NumericalError);
    gray.at<float>(3, 4) = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THROW(predicted.shifts(gray, {}), NumericalError);
    gray.setTo(100);
    // Nothing but gray: the four unknowns are determined by the prediction, and no edge is there.
    for (const EdgeShift& edge : predicted.shifts(gray, {})) {
        EXPECT_TRUE(std::isfinite(edge.shift_px) && std::isfinite(edge.shift_deviation_px));
        EXPECT_TRUE(std::isfinite(edge.step_gray) && std::isfinite(edge.shares.total()));
    }
}

// ---- defocus profile

// A tilted board through focus, photographed by the reference integrator with noise, against
// renderings with the right lens, a wrong focus distance and a wrong f-number.

constexpr double true_focus_mm = 303.0;

// The photograph is always of defocused_board().
const Radiance& reference_radiance() {
    static const Radiance radiance = defocused_board().reference(64);
    return radiance;
}

struct Claim {
    const char* name;
    double focus_distance_mm, f_number;
};

struct Comparison {
    DefocusProfile profile;
    EdgeSummary summary;
    double median_chi_square;
};

Comparison compared(const Claim& claim, int seed) {
    EdgeScene scene = defocused_board();
    const CodeImage photo =
        SensorModel(scene.camera)
            .expose(reference_radiance(), NoiseKey{31, static_cast<std::uint32_t>(seed)});
    scene.camera.lens->focus_distance_mm = claim.focus_distance_mm;
    scene.camera.lens->f_number = claim.f_number;
    const PhotometricCamera camera(scene.camera);
    const ComparedArea area = compared_area(scene.board, {}, "test");
    PhotoState state{scene.pose, {}};
    state.photometry.black[0] = scene.camera.sensor->black_dn / 4095.0 * 255.0;
    state.photometry.white[0] = 255.0;
    const PhotoOfMarker with{gray_of(photo), scene.board.grid,
                             pixel_uses(camera.projector(), scene.pose, area), pixel_fitted, 0.3};
    const std::vector<EdgeShift> shifts = edge_shifts(with, camera, state);
    std::vector<double> chi_squares;
    for (const EdgeShift& edge : shifts)
        chi_squares.push_back(edge.reduced_chi_square);
    return {defocus_profile(photo, scene.rendered(), camera.projector(), scene.board.grid,
                            scene.pose, area, shifts),
            edge_summary(shifts), median(chi_squares)};
}

void print(const Claim& claim, const Comparison& found) {
    const DefocusProfile& profile = found.profile;
    std::printf("%s: focus by the photograph %.2f +- %.2f mm, by the rendering %.2f +- %.2f mm\n",
                claim.name, profile.photo.focus_distance_mm, profile.photo.standard_uncertainty_mm,
                profile.rendering.focus_distance_mm, profile.rendering.standard_uncertainty_mm);
    std::printf("  depth mm  edges  measured px^2     rendered  residual gray\n");
    for (const DepthBin& bin : profile.bins)
        std::printf("  %7.1f  %5d  %6.3f +- %.3f  %8.3f  %6.2f\n", bin.depth_mm, bin.edges,
                    bin.measured_px2, bin.measured_deviation_px2, bin.rendered_px2,
                    bin.residual_rms_gray);
}

// The photograph's noise is 3 gray on the edges, the integrator's own error 0.8 gray: chi-square
// 1.08. The integrator's error is common to all draws: a mean pull within 1.2 as in
// characterise_statistics_test.cpp, where also the focus distance's 0.05 mm have room by which a
// parabola misses it.
TEST(DefocusProfile, OfTheRightLensIsTheRenderingsAndTheResidualIsNoise) {
    constexpr int draws = 8;
    Pulls focus, widths;
    for (int seed = 0; seed < draws; ++seed) {
        const Claim claim{"right lens", true_focus_mm, 1.4};
        const Comparison found = compared(claim, seed);
        if (seed == 0)
            print(claim, found);
        ASSERT_TRUE(found.profile.photo.is_determined) << found.profile.photo.undetermined;
        EXPECT_GT(found.profile.edges, 70);
        EXPECT_NEAR(found.median_chi_square, 1.08, 0.08);
        EXPECT_LT(found.summary.shift.rms_px, 0.005);
        focus.add(found.profile.photo.focus_distance_mm - true_focus_mm,
                  found.profile.photo.standard_uncertainty_mm);
        for (const DepthBin& bin : found.profile.bins)
            widths.add(bin.measured_px2 - bin.rendered_px2, bin.measured_deviation_px2);
    }
    std::printf("pulls: focus %.2f (mean square %.2f), widths %.2f (mean square %.2f)\n",
                focus.mean(), focus.square(), widths.mean(), widths.square());
    EXPECT_LT(std::abs(focus.mean()), 1.2);
    EXPECT_LT(focus.square(), 3.5);  // 99.9 % of chi-square with 8: 3.3
    EXPECT_LT(widths.square(), 1.9);
    EXPECT_GT(widths.square(), 0.4);
}

TEST(DefocusProfile, ShowsAWrongFocusDistanceAndWhereTheTrueOneIs) {
    const Claim claim{"focus 4 mm short", true_focus_mm - 4.0, 1.4};
    const Comparison found = compared(claim, 0);
    print(claim, found);
    const DefocusProfile& profile = found.profile;
    EXPECT_NEAR(profile.photo.focus_distance_mm, true_focus_mm,
                4.0 * profile.photo.standard_uncertainty_mm);
    EXPECT_LT(profile.photo.standard_uncertainty_mm, 0.3);
    EXPECT_NEAR(profile.rendering.focus_distance_mm, true_focus_mm - 4.0, 0.3);
    ASSERT_EQ(profile.bins.size(), 8u);
    const DepthBin &nearest = profile.bins.front(), &farthest = profile.bins.back();
    EXPECT_GT(nearest.measured_px2 - nearest.rendered_px2, 5.0 * nearest.measured_deviation_px2);
    EXPECT_LT(farthest.measured_px2 - farthest.rendered_px2,
              -5.0 * farthest.measured_deviation_px2);
    EXPECT_GT(nearest.residual_rms_gray, 1.1 * profile.bins[4].residual_rms_gray);
    EXPECT_GT(farthest.residual_rms_gray, 1.1 * profile.bins[4].residual_rms_gray);
}

// Thin lens: the disk's variance goes with 1 / N^2 (the focal length hardly changes): the widths
// beyond that in focus, where both have 0.25 px^2 and a rest, are about 2.04 times the rendering's.
TEST(DefocusProfile, ShowsAWrongFNumberOnBothSidesOfFocus) {
    const Claim claim{"f-number 2", true_focus_mm, 2.0};
    const Comparison found = compared(claim, 0);
    print(claim, found);
    const DefocusProfile& profile = found.profile;
    EXPECT_NEAR(profile.photo.focus_distance_mm, true_focus_mm,
                4.0 * profile.photo.standard_uncertainty_mm);
    ASSERT_EQ(profile.bins.size(), 8u);
    for (const DepthBin& bin : {profile.bins.front(), profile.bins.back()}) {
        EXPECT_NEAR((bin.measured_px2 - 0.25) / (bin.rendered_px2 - 0.25), 2.04, 0.15);
        EXPECT_GT(bin.residual_rms_gray, 1.3 * profile.bins[4].residual_rms_gray);
    }
    EXPECT_NEAR(profile.bins[4].measured_px2, profile.bins[4].rendered_px2, 0.015);
    EXPECT_GT(found.summary.mean_blur_px2, 5.0 * found.summary.mean_blur_deviation_px2);
}

TEST(DefocusProfile, SaysWhenAWidthHasNoLeastValue) {
    const EdgeScene scene = small_board(0.6);  // within 8 mm of depth, in focus
    const Radiance rendering = scene.rendered();
    const CodeImage photo = SensorModel(scene.camera).expose(rendering, NoiseKey{5, 1});
    const DefocusProfile profile =
        defocus_profile(photo, rendering, Projector(scene.camera), scene.board.grid, scene.pose,
                        compared_area(scene.board, {}, "test"), {});
    EXPECT_FALSE(profile.photo.is_determined);
    EXPECT_FALSE(profile.photo.undetermined.empty());
    EXPECT_EQ(profile.photo.focus_distance_mm, 0.0);
    EXPECT_GT(profile.edges, 40);
    CameraModel telecentric = scene.camera;
    telecentric.projection.kind = Projection::telecentric;
    EXPECT_THROW(defocus_profile(photo, rendering, Projector(telecentric), scene.board.grid,
                                 scene.pose, compared_area(scene.board, {}, "test"), {}),
                 NumericalError);
}

}  // namespace
}  // namespace etalon
