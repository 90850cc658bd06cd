// Photographs made by the reference integrator, blurred by steps of the diffusion equation, with
// levels, clipping and noise: the renderer and the model that are fitted have no part in them.
#include "compare/photometric/photo_match.h"

#include <tbb/global_control.h>

#include <opencv2/imgproc.hpp>

#include "sim/render/reference_integrator.h"
#include "tests/calib/cameras.h"
#include "tests/image_of.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr double sigma_x_px = 1.15, sigma_y_px = 0.85;
constexpr double variance_difference = sigma_x_px * sigma_x_px - sigma_y_px * sigma_y_px;
const double mean_width = std::sqrt(0.5 * (sigma_x_px * sigma_x_px + sigma_y_px * sigma_y_px));

CameraModel camera_of(int scale) {
    return camera_with(
        160 * scale, 120 * scale,
        {203.0 * scale, 199.0 * scale, (77.0 + 0.5) * scale - 0.5, (61.0 + 0.5) * scale - 0.5},
        {.k1 = -0.2, .k2 = 0.05});
}

const Marker& board() {
    static const Marker marker = parse_marker("chessboard:7x5@10mm", "test");
    return marker;
}

const ComparedArea& area() {
    static const ComparedArea result = compared_area(board(), {0.3, 0.65}, "test");
    return result;
}

Rigid true_pose() {
    return {rotation_from_vector({0.3, -0.2, 0.1}), {-31.0, -18.0, 120.0}};
}

cv::Mat integrated(int scale) {
    const CameraModel camera = camera_of(scale);
    return integrate_reference(camera, {{{board().grid, true_pose()}}, 1.0},
                               {0, 0, camera.width, camera.height},
                               {.samples_per_scramble = 64, .stop_at_gray = 0.3})
        .mean;
}

// Many small steps in time, with the second difference of fourth order.
cv::Mat diffused(cv::Mat image) {
    constexpr int steps = 400;
    const cv::Matx<double, 1, 5> second(-1 / 12.0, 16 / 12.0, -30 / 12.0, 16 / 12.0, -1 / 12.0);
    image.convertTo(image, CV_64F);
    for (int i = 0; i < steps; ++i) {
        cv::Mat by_xx, by_yy;
        cv::filter2D(image, by_xx, -1, second, {-1, -1}, 0, cv::BORDER_REPLICATE);
        cv::filter2D(image, by_yy, -1, second.t(), {-1, -1}, 0, cv::BORDER_REPLICATE);
        image += (0.5 * sigma_x_px * sigma_x_px / steps) * by_xx +
                 (0.5 * sigma_y_px * sigma_y_px / steps) * by_yy;
    }
    image.convertTo(image, CV_32F);
    return image;
}

const cv::Mat& reference() {
    static const cv::Mat radiance = diffused(integrated(1));
    return radiance;
}

// Blurred before the pixels integrate it, as by a lens.
cv::Mat behind_a_lens() {
    constexpr int fine = 3;
    cv::Mat image = integrated(fine);
    cv::GaussianBlur(image, image, {0, 0}, sigma_x_px * fine, sigma_y_px * fine);
    cv::resize(image, image, {}, 1.0 / fine, 1.0 / fine, cv::INTER_AREA);
    return image;
}

struct Truth {
    Vector6d black, white;
    double clip_gray = 1e9;
};

Truth unclipped() {
    Truth truth;
    truth.black << 26.0, -9.0, 6.0, -7.0, 5.0, 11.0;
    truth.white << 198.0, 18.0, -23.0, -41.0, 13.0, -29.0;
    return truth;
}

// White of some 300 gray in the middle, clipped at 246.
Truth clipped() {
    Truth truth = unclipped();
    truth.white[0] = 300.0;
    truth.clip_gray = 246.0;
    return truth;
}

CodeImage photo_of(const Truth& truth, double noise_gray, std::uint64_t seed,
                   const cv::Mat& seen = reference()) {
    RandomStream random(seed, 11);
    const cv::Mat gray = image_of(seen.size(), [&](int x, int y) {
        const Vector6d terms = level_terms(x, y, seen.size());
        const double black = truth.black.dot(terms), white = truth.white.dot(terms);
        const double lit =
            black + (white - black) * seen.at<float>(y, x) + noise_gray * random.normal();
        return std::clamp(lit, 0.0, std::min(truth.clip_gray, 255.0));
    });
    CodeImage image{{}, 12};
    gray.convertTo(image.pixels, CV_16U, image.full_scale() / 255.0);
    return image;
}

const std::shared_ptr<const PhotometricCamera>& camera() {
    static const auto result = std::make_shared<const PhotometricCamera>(camera_of(1));
    return result;
}

PhotoMatch matched(const CodeImage& image, const Rigid& pose) {
    return match_photo(image, board().grid, area(), camera(), pose);
}

const MatchParameter& parameter(const PhotoFit& fit, const std::string& name) {
    for (const MatchParameter& one : fit.parameters)
        if (one.name == name)
            return one;
    throw NumericalError("no parameter " + name);
}

TEST(PhotoMatch, FindsLevelsAndWidths) {
    const Truth truth = unclipped();
    const PhotoMatch match = matched(photo_of(truth, 1.0, 1), true_pose());
    for (const PhotoFit* fit : {&match.calibrated, &match.refined}) {
        const PhotometricModel& model = fit->state.photometry;
        EXPECT_NEAR(model.black[0], 26.0, 0.4);
        EXPECT_NEAR(model.white[0], 198.0, 0.4);
        EXPECT_NEAR(model.psf_sigma_px, mean_width, 0.01);
        EXPECT_NEAR(2.0 * model.psf_anisotropy_px2, variance_difference, 0.03);
        EXPECT_FALSE(model.saturation) << "nothing clips";
        EXPECT_EQ(fit->parameters.size(), 14u);
        EXPECT_NEAR(fit->scored.rms_gray, 1.0, 0.05);
        EXPECT_EQ(fit->noise_source, NoiseSource::residuals);
        EXPECT_LT(fit->scored.significant.value(), 0.006);
    }
}

TEST(PhotoMatch, NamesWhatCameFromTheCalibration) {
    CameraModel model = camera_of(1);
    model.covariance = ParameterCovariance{{"fx", "cx"}, Eigen::Vector2d(0.25, 4.0).asDiagonal()};
    const std::vector<MatchParameter> parameters = calibration_parameters(model);
    ASSERT_EQ(parameters.size(), 6u) << "fx fy cx cy k1 k2";
    EXPECT_EQ(parameters[0].name, "fx");
    EXPECT_EQ(parameters[0].value, 203.0);
    EXPECT_EQ(parameters[0].deviation, 0.5);
    EXPECT_FALSE(parameters[1].deviation);
    EXPECT_EQ(parameters[2].deviation, 2.0);
    EXPECT_EQ(parameters[4].name, "k1");
    for (const MatchParameter& one : parameters)
        EXPECT_STREQ(one.source, "calibration");
}

// A Gaussian on the pixel grid is not quite one before the pixels: what an edge's place within a
// pixel does to its width is lost. At this contrast of 172 gray that leaves 1.1 gray.
TEST(PhotoMatch, TakesALensForAGaussianOnThePixelGrid) {
    const PhotoMatch match = matched(photo_of(unclipped(), 1.0, 2, behind_a_lens()), true_pose());
    const PhotometricModel& model = match.calibrated.state.photometry;
    EXPECT_NEAR(model.psf_sigma_px, mean_width, 0.05);
    EXPECT_NEAR(2.0 * model.psf_anisotropy_px2, variance_difference, 0.1);
    EXPECT_NEAR(model.black[0], 26.0, 1.0);
    EXPECT_NEAR(model.white[0], 198.0, 1.0);
    EXPECT_LT(match.calibrated.scored.rms_gray, 1.6);
}

// The sum of squared errors over stated deviations, of 14 parameters of 20 photographs, has the
// mean 1 by parameter. The parameters of one photograph go together: were they all one, it would
// have a standard deviation of sqrt(2 / 20) = 0.32; as they are, 0.06 to 0.15. The mean of a single
// parameter's errors is within 3.5 of its standard errors of zero.
TEST(PhotoMatch, StatesDeviationsThatHold) {
    const Truth truth = unclipped();
    constexpr int photos = 20;
    std::vector<double> truths(truth.black.data(), truth.black.data() + 6);
    truths.insert(truths.end(), truth.white.data(), truth.white.data() + 6);
    truths.insert(truths.end(), {mean_width, variance_difference});
    std::vector<double> sums(truths.size(), 0.0);
    double squares = 0.0;
    for (std::uint64_t seed = 1; seed <= photos; ++seed) {
        const PhotoFit fit = matched(photo_of(truth, 4.0, seed), true_pose()).calibrated;
        for (std::size_t i = 0; i < truths.size(); ++i) {
            const MatchParameter& one = fit.parameters[i];
            const double error = (one.value - truths[i]) / one.deviation.value();
            sums[i] += error;
            squares += error * error;
        }
    }
    for (std::size_t i = 0; i < truths.size(); ++i)
        EXPECT_LT(std::abs(sums[i]) / std::sqrt(1.0 * photos), 3.5) << "parameter " << i;
    const double mean_square = squares / (photos * static_cast<double>(truths.size()));
    EXPECT_GT(mean_square, 0.7);
    EXPECT_LT(mean_square, 1.4);
}

// Clipped hard, noise included: the shoulder is as wide as the noise. Without it the white level
// would be 246 and the widths wrong.
TEST(PhotoMatch, FindsWhereWhiteClipsAndTheLevelBeyond) {
    const PhotoFit fit = matched(photo_of(clipped(), 2.0, 7), true_pose()).calibrated;
    ASSERT_EQ(fit.parameters.size(), 16u);
    const PhotometricModel& model = fit.state.photometry;
    EXPECT_NEAR(model.saturation->level_gray, 246.0, 0.2);
    EXPECT_NEAR(model.saturation->knee_gray, 2.0, 2.0);
    EXPECT_NEAR(model.white[0], 300.0, 4.0 * parameter(fit, "white level").deviation.value());
    EXPECT_LT(parameter(fit, "white level").deviation.value(), 5.0);
    EXPECT_NEAR(model.psf_sigma_px, mean_width, 0.03);
    EXPECT_LT(fit.scored.rms_gray, 2.1);
}

// A pose that is wrong by half a pixel shows at the given pose and not at the refined one.
TEST(PhotoMatch, TellsAWrongPoseFromAWrongCamera) {
    const Vector6d delta{0.002, -0.003, 0.001, 0.3, -0.2, 0.4};
    const CodeImage image = photo_of(unclipped(), 2.0, 3);
    const PhotoMatch match = matched(image, left_perturbed(true_pose(), delta));
    EXPECT_GT(match.calibrated.scored.rms_gray, 8.0);
    EXPECT_NEAR(match.refined.scored.rms_gray, 2.0, 0.1);
    EXPECT_NEAR(vector_from_rigid(match.refined.state.camera_from_marker).z(),
                vector_from_rigid(true_pose()).z(), 1e-3);
}

TEST(PhotoMatch, DoesNotDependOnTheNumberOfThreads) {
    const CodeImage image = photo_of(clipped(), 2.0, 5);
    const auto bytes = [&](std::size_t threads) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        return matched(image, true_pose());
    };
    const PhotoMatch one = bytes(1), two = bytes(2);
    EXPECT_EQ(vector_from_rigid(one.pose.camera_from_marker),
              vector_from_rigid(two.pose.camera_from_marker));
    for (const auto fit : {&PhotoMatch::calibrated, &PhotoMatch::refined}) {
        EXPECT_EQ(cv::norm((one.*fit).residual, (two.*fit).residual, cv::NORM_INF), 0.0);
        EXPECT_EQ((one.*fit).state.photometry.white, (two.*fit).state.photometry.white);
    }
}

TEST(PhotoMatch, RefusesWhatShowsNoMarker) {
    const CodeImage image = photo_of(unclipped(), 2.0, 6);
    Rigid beside = true_pose();
    beside.translation.x() += 900.0;
    EXPECT_THROW(matched(image, beside), NumericalError);
    const CodeImage flat{cv::Mat(120, 160, CV_8UC1, cv::Scalar(120)), 8};
    EXPECT_THROW(matched({cv::Mat(20, 30, CV_8UC1, cv::Scalar(9)), 8}, true_pose()),
                 NumericalError);
    // Nothing is found on a flat picture, and nothing that is no number is said.
    try {
        const PhotoMatch match = matched(flat, true_pose());
        EXPECT_TRUE(std::isfinite(match.calibrated.scored.rms_gray));
        EXPECT_TRUE(match.refined.state.camera_from_marker.translation.allFinite());
    } catch (const NumericalError&) {
    }
}

}  // namespace
}  // namespace etalon
