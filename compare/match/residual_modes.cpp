#include "compare/match/residual_modes.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double huber_threshold = 3.0;
constexpr double min_eigenvalue = 1e-9;  // of a direction that is determined

constexpr int dark_at = 0, light_at = 6, tone_at = 12;
constexpr int blur_at = 13;  // and its change along x and y
constexpr int pose_at = 16;
constexpr int rows_at = 22;
constexpr int calibration_at = 24;
constexpr int blur_along_at = 29;
constexpr int sharpening_at = 31;
constexpr int column_count = 32;

cv::Mat filtered(const cv::Mat& image, const cv::Mat& kernel) {
    cv::Mat result;
    cv::filter2D(image, result, -1, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
    return result;
}

std::vector<int> range(int first, int count) {
    std::vector<int> columns(static_cast<std::size_t>(count));
    std::iota(columns.begin(), columns.end(), first);
    return columns;
}

Eigen::MatrixXd part(const Eigen::MatrixXd& matrix, const std::vector<int>& rows,
                     const std::vector<int>& columns) {
    return matrix(rows, columns);
}

// Inverse on the directions that are determined, of a matrix with a unit diagonal before what the
// others know was taken out.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& matrix, double least) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix);
    const Eigen::VectorXd inverse = solver.eigenvalues().unaryExpr(
        [&](double value) { return value > least ? 1.0 / value : 0.0; });
    return solver.eigenvectors() * inverse.asDiagonal() * solver.eigenvectors().transpose();
}

void require_alike(const PhotoFit& fit, const cv::Mat& counted, const cv::Size& size,
                   double noise_scale) {
    constexpr int min_pixels = 4 * column_count;
    if (fit.predicted.size() != size || fit.residual.size() != size || counted.size() != size ||
        counted.type() != CV_8UC1 || !(noise_scale > 0) || cv::countNonZero(counted) < min_pixels)
        throw NumericalError(fmt::format(
            "no modes from {} pixels of {} x {} px, a prediction of {} x {} px and noise scale {}",
            cv::countNonZero(counted), counted.cols, counted.rows, fit.predicted.cols,
            fit.predicted.rows, noise_scale));
}

}  // namespace

// All that a row is made of, within `region`: the prediction in gray and how it would change.
struct ResidualModes::Images {
    cv::Size size;                // of the photograph
    cv::Rect box, region;         // of the counted pixels, and with what they need around them
    cv::Mat image;                // the prediction
    cv::Mat by_x, by_y;           // displaced by a px
    cv::Mat by_xx, by_yy, by_xy;  // blurred: by the variances (twice the first two) and covariance
    cv::Mat detail;               // sharpened

    Images(const cv::Mat& predicted, const cv::Mat& counted)
        : size(predicted.size()), box(cv::boundingRect(counted)) {
        constexpr int room = 8;  // what the Gaussian of the detail reaches
        region = padded(box, room, size);
        image = predicted(region);
        const cv::Matx<double, 1, 5> slope(1.0 / 12, -8.0 / 12, 0, 8.0 / 12, -1.0 / 12);
        by_x = filtered(image, cv::Mat(slope));
        by_y = filtered(image, cv::Mat(slope.t()));
        by_xx = filtered(image, cv::Mat(cv::Matx13d(1, -2, 1)));
        by_yy = filtered(image, cv::Mat(cv::Matx31d(1, -2, 1)));
        by_xy = filtered(image, cv::Mat(cv::Matx33d(0.25, 0, -0.25, 0, 0, 0, -0.25, 0, 0.25)));
        detail = image - blurred(image, sharpening_sigma_px);
    }

    double at(const cv::Mat& values, int x, int y) const {
        return values.at<float>(y - region.y, x - region.x);
    }

    Eigen::RowVector2d gradient(int x, int y) const { return {at(by_x, x, y), at(by_y, x, y)}; }

    // `moves` by the calibration's six and the pose's.
    void fill_row(int x, int y, const PhotometricModel& model, const CameraModel& camera,
                  const Eigen::RowVectorXd& moves, Eigen::VectorXd& row) const {
        const Vector6d terms = level_terms(x, y, size);
        const double black = model.at(terms, 0.0).gray;
        const double contrast = model.at(terms, 1.0).gray - black;
        const double t = contrast != 0 ? (at(image, x, y) - black) / contrast : 0.0;
        const double xx = at(by_xx, x, y), yy = at(by_yy, x, y);
        const double u = 2.0 * (x - box.x) / box.width - 1.0;
        const double v = 2.0 * (y - box.y) / box.height - 1.0;
        row.segment<6>(dark_at) = (1.0 - t) * terms;
        row.segment<6>(light_at) = t * terms;
        row[tone_at] = contrast * t * (1.0 - t);
        row.segment<3>(blur_at) = 0.5 * (xx + yy) * Eigen::Vector3d(1.0, u, v);
        row.segment<6>(pose_at) = moves.tail<6>();
        row.segment<2>(rows_at) = -v * gradient(x, y);
        row[calibration_at] = moves[0] + camera.intrinsics.fy / camera.intrinsics.fx * moves[1];
        row.segment<4>(calibration_at + 1) = moves.segment<4>(2);
        row.segment<2>(blur_along_at) << 0.5 * (xx - yy), at(by_xy, x, y);
        row[sharpening_at] = at(detail, x, y);
    }
};

bool ModeFit::is_significant() const {
    const double root = 5.0 + std::sqrt(std::max(freedom - 1, 0));
    return freedom > 0 && chi_square > root * root;
}

ResidualModes::ResidualModes(const PhotoFit& fit, const cv::Mat& counted,
                             const PhotometricCamera& camera, const Rigid& camera_from_marker,
                             double noise_scale)
    : has_lens_(camera.model().lens.has_value()) {
    constexpr int block_px = 8, enough_pixels = 500'000;
    require_alike(fit, counted, {camera.model().width, camera.model().height}, noise_scale);
    const Images images(fit.predicted, counted);
    const cv::Rect& box = images.box;
    const ImageMotion motion(camera.projector(), camera_from_marker,
                             {"", {"fx", "fy", "cx", "cy", "k1", "k2"}}, images.region);
    Eigen::Matrix2Xd moved(2, motion.columns());
    Eigen::VectorXd row(column_count);
    information_ = Eigen::MatrixXd::Zero(column_count, column_count);
    score_ = Eigen::VectorXd::Zero(column_count);

    const auto add_pixel = [&](int x, int y, Block& block) {
        if (counted.at<uchar>(y, x) == 0 || !motion.at(x, y, moved))
            return;
        const double gray = fit.predicted.at<float>(y, x);
        const double noise = noise_scale * camera.noise_gray(gray);
        const Eigen::RowVector2d gradient = images.gradient(x, y);
        images.fill_row(x, y, fit.state.photometry, camera.model(), -gradient * moved, row);
        row /= noise;
        const double residual = fit.residual.at<float>(y, x) / noise;
        const double limited = std::clamp(residual, -huber_threshold, huber_threshold);
        const double weight = residual != 0 ? limited / residual : 1.0;
        block.information.selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
        block.score += limited * row;
        squares_ += limited * residual;
        per_px2_ += weight * gradient.squaredNorm() / (noise * noise);
        ++pixels_;
    };

    // Of many blocks one in `every`: their rows shift, so that no column of blocks stays unseen.
    const int every = (cv::countNonZero(counted) + enough_pixels - 1) / enough_pixels;
    constexpr int row_shift = 3;
    for (int top = box.y / block_px * block_px; top < box.br().y; top += block_px)
        for (int left = box.x / block_px * block_px; left < box.br().x; left += block_px) {
            if ((left / block_px + row_shift * (top / block_px)) % every != 0)
                continue;
            Block block{Eigen::MatrixXd::Zero(column_count, column_count),
                        Eigen::VectorXd::Zero(column_count)};
            const int before = pixels_;
            for (int y = std::max(top, box.y); y < std::min(top + block_px, box.br().y); ++y)
                for (int x = std::max(left, box.x); x < std::min(left + block_px, box.br().x); ++x)
                    add_pixel(x, y, block);
            if (pixels_ == before)
                continue;
            block.information = Eigen::MatrixXd(block.information.selfadjointView<Eigen::Lower>());
            information_ += block.information;
            score_ += block.score;
            blocks_.push_back(std::move(block));
        }
    if (!information_.allFinite() || !score_.allFinite())
        throw NumericalError("a pixel of the photograph or its rendering is not finite");
}

ResidualModes::Columns ResidualModes::columns_of(ResidualMode mode) const {
    constexpr std::pair<int, int> first_and_count[residual_mode_count] = {
        {rows_at, 2}, {calibration_at, 5}, {blur_along_at, 2}, {sharpening_at, 1}, {blur_at, 1}};
    const auto [first, count] = first_and_count[static_cast<std::size_t>(mode)];
    return mode == ResidualMode::blur && !has_lens_ ? Columns{} : range(first, count);
}

Eigen::MatrixXd ResidualModes::block_scatter(const Columns& own, const Columns& others,
                                             const Eigen::MatrixXd& imitation,
                                             const Eigen::VectorXd& scale,
                                             const Eigen::VectorXd& unscaled) const {
    const auto columns = static_cast<Eigen::Index>(own.size());
    Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(columns, columns);
    for (const Block& block : blocks_) {
        const Eigen::VectorXd rest =
            scale.cwiseProduct(Eigen::VectorXd(block.score - block.information * unscaled));
        const Eigen::VectorXd own_rest =
            Eigen::VectorXd(rest(own)) - imitation.transpose() * Eigen::VectorXd(rest(others));
        scatter += own_rest * own_rest.transpose();
    }
    return scatter;
}

ModeFit ResidualModes::fit(ResidualMode mode, const std::vector<ResidualMode>& known) const {
    ModeFit result{mode, {}, 0.0, 0, 0.0};
    const Columns own = columns_of(mode);
    Columns others = range(0, rows_at);
    for (const ResidualMode one : known) {
        const Columns more = columns_of(one);
        others.insert(others.end(), more.begin(), more.end());
    }
    for (const int column : own)
        std::erase(others, column);
    if (own.empty())
        return result;

    // Everything in units of each column's own norm.
    const Eigen::VectorXd scale =
        information_.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = scale.asDiagonal() * information_ * scale.asDiagonal();
    const Eigen::VectorXd score = scale.cwiseProduct(score_);
    const Eigen::MatrixXd others_inverse =
        pseudo_inverse(part(scaled, others, others), min_eigenvalue);
    const Eigen::MatrixXd imitation = others_inverse * part(scaled, others, own);
    const Eigen::MatrixXd information =
        part(scaled, own, own) - imitation.transpose() * part(scaled, others, own);
    const Eigen::VectorXd own_score =
        Eigen::VectorXd(score(own)) - imitation.transpose() * Eigen::VectorXd(score(others));
    const Eigen::MatrixXd inverse = pseudo_inverse(information, min_eigenvalue);
    const Eigen::VectorXd values = inverse * own_score;
    const double explained = own_score.dot(values);

    // Of all columns, for what remains of each block's score.
    Eigen::VectorXd all = Eigen::VectorXd::Zero(column_count);
    all(own) = values;
    all(others) = others_inverse * Eigen::VectorXd(score(others)) - imitation * values;
    const Eigen::VectorXd unscaled = scale.cwiseProduct(all);
    const double freedom = pixels_ - static_cast<double>(own.size() + others.size());
    const double variance = std::max(squares_ - score.dot(all), 0.0) / std::max(freedom, 1.0);

    const Eigen::MatrixXd scatter = block_scatter(own, others, imitation, scale, unscaled);
    const double blocks = static_cast<double>(blocks_.size());
    const double parameters = static_cast<double>(own.size() + others.size());
    const double formal = variance > 0 ? explained / variance : 0.0;
    double robust = formal;
    if (blocks > parameters + 10.0) {
        const Eigen::MatrixXd covariance =
            inverse * scatter * inverse * blocks / (blocks - parameters);
        robust =
            values.dot(pseudo_inverse(covariance, min_eigenvalue * covariance.trace()) * values);
    }
    result.values = scale(own).cwiseProduct(values);
    result.freedom = static_cast<int>(own.size());
    result.chi_square = std::min(formal, robust);
    if (per_px2_ > 0)
        result.size_px = std::sqrt(std::max(explained - variance * result.freedom, 0.0) / per_px2_);
    return result;
}

std::vector<ModeFit> ResidualModes::significant() const {
    std::vector<ModeFit> found;
    std::vector<ResidualMode> known;
    for (;;) {
        ModeFit best;
        for (int i = 0; i < residual_mode_count; ++i) {
            const auto mode = static_cast<ResidualMode>(i);
            if (std::ranges::count(known, mode) > 0)
                continue;
            const ModeFit one = fit(mode, known);
            if (one.is_significant() && one.size_px > best.size_px)
                best = one;
        }
        if (best.freedom == 0)
            return found;
        known.push_back(best.mode);
        found.push_back(best);
    }
}

}  // namespace etalon
