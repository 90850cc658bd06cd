#include "compare/match/shown_pattern.h"

#include <fmt/format.h>

#include <Eigen/QR>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "compare/photometric/photometric_model.h"
#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

namespace etalon {
bool is_tag(const Marker& marker) {
    return marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco;
}

namespace {

// A cell (or, on boards of very many, every n-th) and what the photograph shows there.
struct CellSample {
    int row, column;
    double gray;
    Vector6d light;  // terms of smooth light
};

struct CellSamples {
    std::vector<CellSample> cells;
    int places = 0;  // in the area, inside the image or not
    double cell_px = 0.0;
    double white_gray = 0.0, clipped_white = 0.0;
};

double interpolated(const cv::Mat& gray, const Eigen::Vector2d& pixel) {
    const int x = std::min(static_cast<int>(pixel.x()), gray.cols - 2);
    const int y = std::min(static_cast<int>(pixel.y()), gray.rows - 2);
    const double u = pixel.x() - x, v = pixel.y() - y;
    return std::lerp(std::lerp<double>(gray.at<float>(y, x), gray.at<float>(y, x + 1), u),
                     std::lerp<double>(gray.at<float>(y + 1, x), gray.at<float>(y + 1, x + 1), u),
                     v);
}

// Where a point of the grid (in cells) lands, if that is inside the image.
std::optional<Eigen::Vector2d> pixel_of(const Projector& projector, const Rigid& pose,
                                        const CellGrid& grid, double u, double v) {
    const auto pixel = projector.project(pose * grid.point_mm(u, v));
    const CameraModel& camera = projector.camera();
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width - 1 ||
        pixel->y() > camera.height - 1)
        return std::nullopt;
    return pixel;
}

bool is_compared(const CellGrid& grid, const ComparedArea& area, int row, int column) {
    const Eigen::Vector2d middle = grid.point_mm(column + 0.5, row + 0.5).head<2>();
    return (middle.array() > area.low_mm.array()).all() &&
           (middle.array() < area.high_mm.array()).all();
}

// Nine places in the middle half of a cell.
void sample_cell(const cv::Mat& gray, double saturation_gray, const Projector& projector,
                 const CellGrid& grid, const Rigid& pose, int row, int column,
                 CellSamples& samples) {
    ++samples.places;
    CellSample sample{row, column, 0.0, Vector6d::Zero()};
    int clipped = 0;
    for (int i = 0; i < 9; ++i) {
        const double u = column + 0.25 + 0.25 * (i % 3), v = row + 0.25 + 0.25 * (i / 3);
        const auto pixel = pixel_of(projector, pose, grid, u, v);
        if (!pixel)
            return;
        const double value = interpolated(gray, *pixel);
        sample.gray += value / 9.0;
        clipped += value >= saturation_gray ? 1 : 0;
        sample.light += level_terms(pixel->x(), pixel->y(), gray.size()) / 9.0;
    }
    if (grid.cells.at<float>(row, column) > 0.5f) {
        samples.white_gray += sample.gray;
        samples.clipped_white += clipped / 9.0;
    }
    const auto right = pixel_of(projector, pose, grid, column + 0.75, row + 0.25);
    const auto origin = pixel_of(projector, pose, grid, column + 0.25, row + 0.25);
    const auto down = pixel_of(projector, pose, grid, column + 0.25, row + 0.75);
    if (right && origin && down) {
        const Eigen::Vector2d a = *right - *origin, b = *down - *origin;
        samples.cell_px += std::sqrt(std::abs(a.x() * b.y() - a.y() * b.x())) / 0.5;
    }
    samples.cells.push_back(sample);
}

CellSamples sample_cells(const cv::Mat& gray, double saturation_gray, const Projector& projector,
                         const CellGrid& grid, const ComparedArea& area, const Rigid& pose) {
    constexpr int max_per_side = 64;
    const int step = std::max(1, std::max(grid.rows(), grid.columns()) / max_per_side);
    CellSamples samples;
    for (int row = 0; row < grid.rows(); row += step)
        for (int column = 0; column < grid.columns(); column += step)
            if (is_compared(grid, area, row, column))
                sample_cell(gray, saturation_gray, projector, grid, pose, row, column, samples);
    double white = 0.0;
    for (const CellSample& sample : samples.cells)
        white += grid.cells.at<float>(sample.row, sample.column) > 0.5f ? 1.0 : 0.0;
    if (!samples.cells.empty())
        samples.cell_px /= static_cast<double>(samples.cells.size());
    if (white > 0) {
        samples.white_gray /= white;
        samples.clipped_white /= white;
    }
    return samples;
}

// Scores patterns against the samples. Smooth light is taken out of both once and for all.
class Scorer {
public:
    explicit Scorer(const std::vector<CellSample>& samples)
        : samples_(samples), light_(samples.size(), 6), gray_(samples.size()) {
        for (std::size_t i = 0; i < samples.size(); ++i) {
            light_.row(static_cast<Eigen::Index>(i)) = samples[i].light;
            gray_[static_cast<Eigen::Index>(i)] = samples[i].gray;
        }
        // An orthonormal basis of the light's terms.
        const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(light_);
        light_ = Eigen::MatrixXd(qr.householderQ() *
                                 Eigen::MatrixXd::Identity(light_.rows(), qr.rank()));
        gray_ = without_light(gray_);
    }

    // With light and dark that change over the marker: the pattern times 1, x and y.
    PatternScore score(const cv::Mat& cells) const { return fitted(cells, nullptr); }

    // The score of the expected pattern, with the cells that are on the other side.
    void expect(const cv::Mat& cells, ShownPattern& shown) const {
        shown.expected = fitted(cells, &shown);
    }

private:
    PatternScore fitted(const cv::Mat& cells, ShownPattern* flips) const {
        const auto n = static_cast<Eigen::Index>(samples_.size());
        Eigen::MatrixXd terms(n, 3);
        for (Eigen::Index i = 0; i < n; ++i) {
            const CellSample& sample = samples_[static_cast<std::size_t>(i)];
            const double radiance = cells.at<float>(sample.row, sample.column);
            terms.row(i) = radiance * (sample.light.head<3>() - middle()).transpose();
            terms(i, 0) = radiance;
        }
        for (int column = 0; column < 3; ++column)
            terms.col(column) = without_light(terms.col(column));
        const Eigen::VectorXd fit = terms.colPivHouseholderQr().solve(gray_);
        const double all = gray_.squaredNorm();
        const Eigen::VectorXd residual = gray_ - terms * fit;
        const double rest = residual.squaredNorm();
        for (Eigen::Index i = 0; flips && i < n; ++i) {
            const CellSample& sample = samples_[static_cast<std::size_t>(i)];
            const bool dark = cells.at<float>(sample.row, sample.column) < 0.5f;
            flips->flipped_to_light += dark && residual[i] > 0.5 * fit[0] ? 1 : 0;
            flips->flipped_to_dark += !dark && residual[i] < -0.5 * fit[0] ? 1 : 0;
        }
        return {all > 0 ? std::clamp(1.0 - rest / all, 0.0, 1.0) : 0.0, fit[0]};
    }

    Eigen::VectorXd without_light(const Eigen::VectorXd& values) const {
        return values - light_ * (light_.transpose() * values);
    }
    Eigen::Vector3d middle() const {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (const CellSample& sample : samples_)
            sum += sample.light.head<3>();
        return sum / static_cast<double>(samples_.size());
    }

    const std::vector<CellSample>& samples_;
    Eigen::MatrixXd light_;
    Eigen::VectorXd gray_;
};

// The cells as seen from the front after mirroring and turning.
cv::Mat placed(const cv::Mat& cells, bool mirrored, int quarter_turns) {
    constexpr int rotations[] = {cv::ROTATE_90_CLOCKWISE, cv::ROTATE_180,
                                 cv::ROTATE_90_COUNTERCLOCKWISE};
    cv::Mat result = cells.clone();  // not into the marker's own cells
    if (mirrored)
        cv::flip(cells, result, 1);
    if (quarter_turns == 0)
        return result;
    cv::Mat turned;
    cv::rotate(result, turned, rotations[quarter_turns - 1]);
    return turned;
}

// Takes what explains clearly more; a board may look the same in several positions.
void try_positions(const Scorer& scorer, const cv::Mat& cells, int id, bool mirrored_too,
                   ShownPattern& shown) {
    constexpr double clearly = 1e-3;
    const int step = cells.rows == cells.cols ? 1 : 2;
    for (const bool mirrored : {false, true})
        for (int turns = 0; turns < 4 && (mirrored_too || !mirrored); turns += step) {
            const PatternScore score = scorer.score(placed(cells, mirrored, turns));
            if (score.explained < shown.best.explained + clearly)
                continue;
            shown.best = score;
            shown.mirrored = mirrored;
            shown.quarter_turns = turns;
            shown.id = id;
        }
}

void try_other_ids(const Scorer& scorer, const Marker& marker, ShownPattern& shown) {
    constexpr int max_ids = 5000;
    const bool apriltag = marker.kind == Marker::Kind::apriltag;
    const int ids = apriltag ? apriltag_count(marker.family) : aruco_count(marker.family);
    if (ids > max_ids)
        return;
    for (int id = 0; id < ids; ++id) {
        const TagPattern pattern =
            apriltag ? apriltag_pattern(marker.family, id) : aruco_pattern(marker.family, id);
        if (id != marker.id && pattern.cells.size() == marker.grid.cells.size())
            try_positions(scorer, pattern.cells, id, false, shown);
    }
}

}  // namespace

bool ShownPattern::is_another() const {
    return quarter_turns != 0 || mirrored || best.explained > expected.explained;
}

ShownPattern shown_pattern(const cv::Mat& photo_gray, double saturation_gray,
                           const Projector& projector, const Marker& marker,
                           const ComparedArea& area, const Rigid& camera_from_marker) {
    constexpr double well_explained = 0.9;
    constexpr std::size_t min_cells = 12;  // beside six terms of light and three of the pattern
    const CameraModel& camera = projector.camera();
    if (photo_gray.type() != CV_32FC1 || photo_gray.size() != cv::Size(camera.width, camera.height))
        throw NumericalError(fmt::format("photograph {} x {} px for a camera of {} x {}",
                                         photo_gray.cols, photo_gray.rows, camera.width,
                                         camera.height));
    const CellSamples samples =
        sample_cells(photo_gray, saturation_gray, projector, marker.grid, area, camera_from_marker);
    ShownPattern shown;
    shown.id = marker.id;
    shown.visible =
        samples.places > 0 ? static_cast<double>(samples.cells.size()) / samples.places : 0.0;
    shown.cell_px = samples.cell_px;
    shown.white_gray = samples.white_gray;
    shown.clipped_white = samples.clipped_white;
    if (samples.cells.size() < min_cells)
        return shown;
    const Scorer scorer(samples.cells);
    scorer.expect(marker.grid.cells, shown);
    shown.best = shown.expected;
    if (shown.expected.explained > well_explained && shown.expected.contrast_gray > 0)
        return shown;
    try_positions(scorer, marker.grid.cells, marker.id, true, shown);
    if (is_tag(marker) && shown.best.explained < well_explained)
        try_other_ids(scorer, marker, shown);
    return shown;
}

}  // namespace etalon
