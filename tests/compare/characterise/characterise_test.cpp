// What measures black level, noise, tone and shading refuses, and what it says then; values with
// known answers. How often the truth is within U: characterise_statistics_test.cpp.
#include <opencv2/imgproc.hpp>

#include "compare/characterise/code_statistics.h"
#include "compare/characterise/illumination_estimate.h"
#include "compare/characterise/photon_transfer.h"
#include "compare/characterise/slanted_edge.h"
#include "sim/render/renderer.h"
#include "tests/compare/characterise/level_scenes.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

template <class Action>
std::string refusal(Action action) {
    return text_of_error<NumericalError>(action);
}

CodeImage codes(int rows, int columns, std::initializer_list<int> values) {
    CodeImage image{cv::Mat(rows, columns, CV_8UC1), 8};
    std::copy(values.begin(), values.end(), image.pixels.begin<std::uint8_t>());
    return image;
}

TEST(CodeStatistics, RoundingIsUniformWithoutNoiseAndGoneWithMuch) {
    // Without noise the error is uniform over a code: 1/sqrt(12). Its harmonics fall as
    // exp(-2 pi^2 sigma^2): at 0.5 DN the first alone counts, 0.00718 / pi / sqrt 2.
    EXPECT_NEAR(rounding_uncertainty_of_mean(0.0), 1.0 / std::sqrt(12.0), 1e-3);
    EXPECT_NEAR(rounding_uncertainty_of_mean(0.5), 0.00719 / M_PI / std::sqrt(2.0), 1e-5);
    EXPECT_LT(rounding_uncertainty_of_mean(1.0), 1e-8);
    EXPECT_LT(rounding_uncertainty_of_variance(1.2), 1e-9);
}

// A second method: rounding many normal deviates about many fractions of a code.
TEST(CodeStatistics, RoundingAgreesWithRoundedDeviates) {
    const double sigma = 0.35;
    double square_of_mean = 0.0;
    constexpr int fractions = 64, deviates = 4000;
    for (int f = 0; f < fractions; ++f) {
        double sum = 0.0;
        RandomStream random(5, 0, static_cast<std::uint64_t>(f));
        for (int i = 0; i < deviates; ++i)
            sum +=
                std::round(f / double(fractions) + sigma * random.normal()) - f / double(fractions);
        square_of_mean += std::pow(sum / deviates, 2) / fractions;
    }
    // The deviates' own scatter is (0.35^2 + 1/12)/4000; what remains is known to
    // 2/sqrt(2 * 64) of itself plus that.
    const double own = (sigma * sigma + 1.0 / 12.0) / deviates;
    EXPECT_NEAR(std::sqrt(square_of_mean - own), rounding_uncertainty_of_mean(sigma), 0.004);
}

TEST(CodeStatistics, FindsWhereAScaleEnds) {
    cv::Mat ramp(50, 200, CV_8UC1);
    for (int x = 0; x < ramp.cols; ++x)
        ramp.col(x) = std::min(30 + x, 190);
    const CodeImage limited{ramp, 8};
    EXPECT_EQ(saturation_code({&limited, 1}), 190);
    const CodeImage free{ramp.colRange(0, 150).clone(), 8};
    EXPECT_EQ(saturation_code({&free, 1}), 255);
    EXPECT_DOUBLE_EQ(share_at_saturation(limited, 190), 40.0 / 200.0);
}

TEST(BlackLevel, OfCodesByHand) {
    // Means 7 and 8 of 4 pixels; each pixel rises by 1: temporal variance 1/2. The drift of 1 DN is
    // over half of the noise.
    const std::vector<CodeImage> drifting{codes(2, 2, {5, 6, 8, 9}), codes(2, 2, {6, 7, 9, 10})};
    EXPECT_THAT(refusal([&] { measure_black_level(drifting); }), HasSubstr("drift by 1 DN"));
    const std::vector<CodeImage> steady{codes(2, 2, {5, 6, 8, 9}), codes(2, 2, {6, 5, 9, 8})};
    const BlackLevel black = measure_black_level(steady);
    EXPECT_DOUBLE_EQ(black.dn, 7.0);
    EXPECT_DOUBLE_EQ(black.temporal_variance_dn2, 0.5);
    EXPECT_DOUBLE_EQ(black.drift_dn, 0.0);
    // Pixels' means 5.5, 5.5, 8.5, 8.5: variance 2.25, less half of the temporal one.
    EXPECT_DOUBLE_EQ(black.fixed_pattern_dn, std::sqrt(2.25 - 0.25));
}

TEST(BlackLevel, RefusesWhatIsNoDarkPhoto) {
    EXPECT_THAT(refusal([] { measure_black_level({}); }), HasSubstr("no dark photos"));
    CameraModel camera = noisy_camera();
    EXPECT_THAT(refusal([&] { measure_black_level(exposed(camera, squares(camera, 0.5), 2, 1)); }),
                HasSubstr("is the lens covered?"));
    camera.sensor->black_dn = 1.0;
    EXPECT_THAT(refusal([&] { measure_black_level(exposed(camera, even(camera, 0.0), 2, 1)); }),
                HasSubstr("at code 0"));
    std::vector<CodeImage> sizes{codes(2, 2, {5, 6, 8, 9}), codes(1, 4, {5, 6, 8, 9})};
    EXPECT_THAT(refusal([&] { measure_black_level(sizes); }), HasSubstr("image 2 has 4 x 1 px"));
}

std::string photon_refusal(const RepeatedView& view, const CameraModel& camera = noisy_camera()) {
    return refusal(
        [&] { measure_photon_transfer(std::vector<RepeatedView>{view}, camera, std::nullopt); });
}

TEST(PhotonTransfer, NeedsDarkPhotosForTheReadNoiseOnly) {
    const CameraModel camera = noisy_camera();
    const std::vector<RepeatedView> views{exposed(camera, squares(camera, 0.85), 4, 7)};
    const PhotonTransfer photon = measure_photon_transfer(views, camera, std::nullopt);
    EXPECT_FALSE(photon.read_noise_e);
    EXPECT_THAT(photon.read_noise_remark, HasSubstr("no dark photos"));
    EXPECT_NEAR(photon.gain_e_per_dn, 12.0, 4.0 * photon.gain_standard_uncertainty);
    EXPECT_LT(photon.shift_px, 0.01);
}

TEST(PhotonTransfer, TakesOutASmallChangeOfTheLight) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    RepeatedView view = exposed(camera, scene, 2, 3);
    const RepeatedView brighter = exposed(camera, scene * 1.01, 2, 3, 10);
    view.insert(view.end(), brighter.begin(), brighter.end());
    const PhotonTransfer photon =
        measure_photon_transfer(std::vector<RepeatedView>{view}, camera, std::nullopt);
    // 1 % of 200 DN is 2 DN beside 4 DN of noise: untreated the gain would be a tenth too low.
    EXPECT_NEAR(photon.brightness_drift, 0.01, 0.001);
    EXPECT_NEAR(photon.gain_e_per_dn, 12.0, 4.0 * photon.gain_standard_uncertainty);
}

TEST(PhotonTransfer, RefusesWhatAreNoRepeats) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    RepeatedView view = exposed(camera, scene, 2, 3);
    EXPECT_THAT(photon_refusal({view[0]}), HasSubstr("two photos at least"));
    const auto with = [&](const Radiance& other) {
        return photon_refusal({view[0], exposed(camera, other, 1, 3, 9).front()});
    };
    EXPECT_THAT(with(scene * 1.05), HasSubstr("brightness drifts by"));
    cv::Mat moved;
    const cv::Mat to_the_right = (cv::Mat_<double>(2, 3) << 1, 0, 40, 0, 1, 0);
    cv::warpAffine(scene, moved, to_the_right, scene.size(), cv::INTER_LINEAR,
                   cv::BORDER_REPLICATE);
    EXPECT_THAT(with(moved), HasSubstr("repeats: "));
    Radiance with_a_hand = scene.clone();
    with_a_hand(cv::Rect(100, 50, 40, 30)) *= 0.6;
    EXPECT_THAT(with(with_a_hand), HasSubstr("changed by more than noise"));
    RepeatedView smoothed = view;
    for (CodeImage& image : smoothed)
        cv::GaussianBlur(image.pixels, image.pixels, {3, 3}, 0.6);
    EXPECT_THAT(photon_refusal(smoothed), HasSubstr("correlated"));
}

TEST(PhotonTransfer, RefusesACurveThatTheCameraFileDoesNotHave) {
    CameraModel camera = with_tone_curve(noisy_camera());
    camera.sensor->read_noise_e = 6.0;
    const RepeatedView view = exposed(camera, squares(camera, 0.8), 4, 3);
    EXPECT_THAT(photon_refusal(view, noisy_camera()), HasSubstr("photon transfer: "));
}

TEST(TransferEstimate, RefusesWhatIsNoExposureSeries) {
    const CameraModel camera = noisy_camera();
    const Radiance scene = squares(camera, 0.8);
    const auto error = [&](const Radiance& picture, const std::vector<double>& times) {
        return refusal([&] {
            estimate_transfer(exposure_series(camera, picture, times), *camera.sensor, 0.0);
        });
    };
    EXPECT_THAT(error(scene, {100, 400, 1000}), HasSubstr("3 different times"));
    EXPECT_THAT(error(scene, {500, 600, 800, 1000}), HasSubstr("over a factor of 2"));
    EXPECT_THAT(error(scene * 0.3, {100, 300, 600, 1000}), HasSubstr("% of full scale"));
    const Radiance texture = scene.mul(image_of(
        scene.size(), [](int x, int y) { return (x / 4 + y / 4) % 2 == 0 ? 0.6f : 1.0f; }));
    EXPECT_THAT(error(texture, {100, 300, 600, 1000}), HasSubstr("0 uniform parts"));
    std::vector<ExposedPhoto> drifting =
        exposure_series(camera, scene, {100, 300, 600, 1000, 1000});
    drifting.back().image = exposed(camera, scene * 1.03, 1, 5, 77).front();
    EXPECT_THAT(refusal([&] { estimate_transfer(drifting, *camera.sensor, 0.0); }),
                HasSubstr("the light is not steady"));
    std::vector<ExposedPhoto> automatic =
        exposure_series(camera, scene, {700, 700, 700, 700, 1000});
    for (std::size_t i = 0; i < automatic.size(); ++i)
        automatic[i].exposure_us = 100.0 * std::pow(2.0, static_cast<double>(i));
    EXPECT_NE(refusal([&] { estimate_transfer(automatic, *camera.sensor, 0.0); }), "no error");
}

TEST(TransferEstimate, FindsWhereTheCameraLimitsItsScale) {
    const CameraModel camera = noisy_camera();
    std::vector<ExposedPhoto> photos =
        exposure_series(camera, squares(camera, 1.0), {60, 120, 250, 500, 700, 850, 1200});
    for (ExposedPhoto& photo : photos)
        cv::min(photo.image.pixels, 235, photo.image.pixels);
    const TransferEstimate estimate = estimate_transfer(photos, *camera.sensor, 0.0);
    EXPECT_EQ(estimate.saturation_code, 235);
    EXPECT_LE(estimate.highest_code, (235 - 9.3) / (255 - 9.3));
}

TEST(IlluminationEstimate, RefusesWhatIsNoFlatField) {
    const CameraModel camera = noisy_camera();
    const auto error = [&](const Radiance& radiance) {
        return refusal(
            [&] { flat_patches(exposed(camera, radiance, 1, 3).front(), camera, 0, "flat.png"); });
    };
    EXPECT_EQ(error(even(camera, 0.7)), "no error");
    EXPECT_THAT(error(even(camera, 1.0)), HasSubstr("flat.png: 5"));  // half are at full scale
    EXPECT_THAT(error(even(camera, 1.0)), HasSubstr("are saturated"));
    Radiance lamp = even(camera, 0.02);
    lamp.colRange(0, 160) = 0.8f;
    EXPECT_THAT(error(lamp), HasSubstr("no photo of a uniform field"));
    std::vector<WhitePatch> middle;
    for (const WhitePatch& patch :
         flat_patches(exposed(camera, even(camera, 0.7), 1, 3).front(), camera, 0, "flat.png"))
        if ((patch.centre_px - Eigen::Vector2d(160, 120)).norm() < 80.0)
            middle.push_back(patch);
    EXPECT_THAT(refusal([&] { estimate_illumination(middle, camera); }),
                HasSubstr("of the way to the image's corners"));
    EXPECT_THAT(refusal([&] { estimate_illumination({}, camera); }),
                HasSubstr("0 even white parts"));
}

// A board that covers the image, in five places, under light that comes from another side each
// time.
std::vector<WhitePatch> white_squares(const CameraModel& camera) {
    const Marker board = parse_marker("chessboard:9x7@10mm", "test");
    const Renderer renderer(camera);
    const SensorModel sensor(camera);
    const Projector projector(camera);
    std::vector<WhitePatch> patches;
    for (int i = 0; i < 5; ++i) {
        PlacedMarker placed{board.grid, rigid_from_vector({0.02 * i, -0.03, 0.01, -43.0 + 3 * i,
                                                           -33.0 + 2 * i, 122.0})};
        placed.grid.cells = cv::Mat(0.1 + 0.6 * board.grid.cells);  // a picture of its own
        Radiance radiance = renderer.render({{placed}, 0.3}).radiance;
        for (int x = 0; x < radiance.cols; ++x)
            radiance.col(x) *= 1.0 + 0.05 * (i - 2) * x / radiance.cols;
        const CodeImage photo = sensor.expose(radiance, NoiseKey{3, static_cast<std::uint32_t>(i)});
        const auto more =
            white_cell_patches(photo, projector, board.grid, placed.camera_from_marker, i);
        patches.insert(patches.end(), more.begin(), more.end());
    }
    return patches;
}

TEST(IlluminationEstimate, OfATargetsWhiteSquares) {
    CameraModel camera = noisy_camera();
    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.3, 0.05, -0.05}};
    const std::vector<WhitePatch> patches = white_squares(camera);
    // Inner white squares: half of 8 x 6, those that lie in the image, in five photographs.
    EXPECT_GT(patches.size(), 80u);
    EXPECT_LE(patches.size(), 5u * 40u);
    const IlluminationEstimate estimate = estimate_illumination(patches, camera);
    EXPECT_EQ(estimate.photos, 5);
    const double corner = illumination_radius_squared(camera, {-0.5, 239.5});
    const double truth = polynomial_illumination(camera.sensor->illumination.polynomial, corner);
    // One value, 3.5 standard uncertainties: wrong once in 2000.
    EXPECT_NEAR(estimate.at_corner, truth, 3.5 * estimate.at_corner_standard_uncertainty);
    EXPECT_LT(estimate.at_corner_standard_uncertainty, 0.02);
    EXPECT_LT(estimate.reduced_chi_square, 2.0);
}

// ---- slanted edge

const cv::Size edge_size(40, 64);

// Of a radiance by pixel, nothing clipped.
LinearPhoto photo_of(cv::Size size, double noise, const auto& radiance) {
    RandomStream random(5, 1);
    return {image_of(size, radiance) + normal_noise(size, noise, random),
            cv::Mat::zeros(size, CV_8UC1),
            {}};
}

LinearPhoto edge_photo(double degrees, double noise = 0.0) {
    const double angle = degrees * std::numbers::pi / 180.0;
    const Eigen::Vector2d normal(std::cos(angle), std::sin(angle));
    return photo_of(edge_size, noise, [&](int x, int y) {
        const double distance = normal.dot(Eigen::Vector2d(x - 19.3, y - 31.6));
        return 0.1 + 0.7 * gaussian_edge(distance, normal, 0.5);
    });
}

LinearPhoto flat(cv::Size size) {
    return photo_of(size, 0.0, [](int, int) { return 0.4; });
}

SlantedEdge measure(const LinearPhoto& photo) {
    return slanted_edge(photo, {0, 0, photo.radiance.cols, photo.radiance.rows});
}

TEST(SlantedEdge, FindsAngleLevelsAndModulation) {
    const SlantedEdge edge = measure(edge_photo(5.0));
    EXPECT_NEAR(edge.angle_deg, 5.0, 0.02);
    EXPECT_NEAR(edge.dark, 0.1, 1e-4);
    EXPECT_NEAR(edge.light, 0.8, 1e-4);
    EXPECT_DOUBLE_EQ(edge.modulation.front().modulation, 1.0);
    for (const ModulationRow& row : edge.modulation) {
        const double f = row.cycles_per_px;
        EXPECT_NEAR(row.modulation, pixel_transfer_across(5.0, f) * gaussian_transfer(0.5, f),
                    0.004)
            << f;
    }
}

// Mirrored, upside down, turned by a quarter, bright and dark exchanged: the same edge.
TEST(SlantedEdge, DoesNotDependOnWhichWayTheEdgeRuns) {
    const LinearPhoto photo = edge_photo(7.0);
    const SlantedEdge first = measure(photo);
    const auto expect_same = [&](const cv::Mat& radiance) {
        const SlantedEdge edge =
            measure({radiance.clone(), cv::Mat::zeros(radiance.size(), CV_8UC1), {}});
        EXPECT_NEAR(edge.angle_deg, first.angle_deg, 1e-3);
        EXPECT_NEAR(edge.at_nyquist, first.at_nyquist, 0.003);
        EXPECT_NEAR(edge.mtf50_cycles_per_px, first.mtf50_cycles_per_px, 0.003);
    };
    cv::Mat turned;
    for (const int code : {-1, 0, 1}) {
        cv::flip(photo.radiance, turned, code);
        expect_same(turned);
    }
    expect_same(photo.radiance.t());
    expect_same(0.9 - photo.radiance);
}

TEST(SlantedEdge, RefusesRegionsThatHoldNoSlantedEdge) {
    LinearPhoto photo = edge_photo(5.0);
    EXPECT_THROW(slanted_edge(photo, {0, 0, 15, 64}), NumericalError);
    EXPECT_THROW(slanted_edge(photo, {8, 0, 40, 64}), NumericalError);   // outside
    EXPECT_THROW(slanted_edge(photo, {16, 0, 20, 64}), NumericalError);  // too near to a side
    EXPECT_THROW(measure(edge_photo(0.0)), NumericalError);
    EXPECT_THROW(measure(edge_photo(5.0, 0.5)), NumericalError);  // below its noise
    EXPECT_THROW(measure(flat(edge_size)), NumericalError);
    photo.clipped.at<uchar>(3, 3) = 255;
    EXPECT_THROW(measure(photo), NumericalError);
}

// How far the band reaches on the side where it reaches less.
double nearer_reach(const StraightEdge& edge) {
    double reach[2] = {};
    for (const EdgePixel& pixel : edge.pixels) {
        double& side = reach[pixel.distance_px > 0.0];
        side = std::max(side, std::abs(pixel.distance_px));
    }
    return std::min(reach[0], reach[1]);
}

// Of a board's long edges, the distances from the projector; sigma 0.55 px behind the pixel box.
// The renderer is right to 0.1 gray of 190, a bin of few pixels passes on a part of that.
TEST(SlantedEdge, TakesTheEdgesOfATarget) {
    EdgeScene scene{edge_camera(220, 170), gray_board("chessboard:3x3@40mm"),
                    pose_of(0.0, 0.0, 0.09, -40.0, -38.0, 500.0)};
    set_gaussian(scene.camera, 0.55);
    const CodeImage photo = SensorModel(scene.camera).expose(scene.rendered());
    int measured = 0;
    for (const StraightEdge& edge : scene.edges(photo, {.half_width_px = 12.0})) {
        if (edge.length_px < 40.0 || nearer_reach(edge) < 9.0)
            continue;
        const SlantedEdge found = slanted_edge(edge);
        EXPECT_NEAR(found.angle_deg, 0.09 * 180.0 / std::numbers::pi, 0.7);
        for (const ModulationRow& row : found.modulation) {
            const double f = row.cycles_per_px;
            if (f <= 0.5) {
                EXPECT_NEAR(row.modulation, sinc(f) * gaussian_transfer(0.55, f), 0.02);
            }
        }
        ++measured;
    }
    EXPECT_GE(measured, 4);
}

// Slanted edges of a picture of which nothing is known.

constexpr double sigma_px = 0.8;  // of the square

// A light quadrilateral: the product of four half planes behind a Gaussian, turned by `degrees`.
LinearPhoto photo_of_a_square(double degrees, double noise) {
    const double angle = degrees * std::numbers::pi / 180.0, half_side = 61.3;
    const auto half_plane = [](double distance) {
        return 0.5 * std::erfc(-distance / sigma_px / std::numbers::sqrt2);
    };
    return photo_of({230, 190}, noise, [&](int x, int y) {
        const double u = (x - 113.4) * std::cos(angle) + (y - 96.8) * std::sin(angle),
                     v = (y - 96.8) * std::cos(angle) - (x - 113.4) * std::sin(angle);
        return 0.12 + 0.55 * half_plane(half_side - u) * half_plane(half_side + u) *
                          half_plane(half_side - v) * half_plane(half_side + v);
    });
}

// exp(-2 (pi sigma f)^2) is one half at sqrt(ln 2 / 2) / (pi sigma).
TEST(EdgeSearch, FindsTheFourSidesOfASquareAndTheirSharpness) {
    const double truth = std::sqrt(std::numbers::ln2 / 2.0) / (std::numbers::pi * sigma_px);
    for (const double degrees : {-7.3, 3.4, 12.1}) {
        const SlantedEdges found = find_slanted_edges(photo_of_a_square(degrees, 0.004));
        EXPECT_EQ(found.edges.size(), 4u) << degrees;
        for (const FoundSlantedEdge& each : found.edges) {
            EXPECT_NEAR(each.edge.angle_deg, std::abs(degrees), 0.2);
            EXPECT_NEAR(each.edge.mtf50_cycles_per_px, truth,
                        0.01 * truth + 4.0 * each.edge.mtf50_standard_uncertainty);
        }
    }
}

TEST(EdgeSearch, TakesNoEdgeAlongThePixelsNorOneFarFromThem) {
    for (const double degrees : {0.0, 31.0}) {
        const SlantedEdges found = find_slanted_edges(photo_of_a_square(degrees, 0.004));
        EXPECT_TRUE(found.edges.empty()) << degrees;
        EXPECT_EQ(found.reason, "");
    }
}

TEST(EdgeSearch, SaysWhyAnEdgeCannotBeMeasured) {
    LinearPhoto photo = photo_of_a_square(5.2, 0.004);
    photo.clipped.setTo(255);
    const SlantedEdges found = find_slanted_edges(photo);
    EXPECT_TRUE(found.edges.empty());
    EXPECT_NE(found.reason.find("clipped pixels"), std::string::npos);
}

TEST(EdgeSearch, FindsNothingInImagesWithoutContent) {
    EXPECT_TRUE(find_slanted_edges(flat({80, 60})).edges.empty());
}

}  // namespace
}  // namespace etalon
