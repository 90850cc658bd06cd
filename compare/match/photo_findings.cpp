#include "compare/match/photo_findings.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <Eigen/QR>

#include "compare/characterise/blur_estimate.h"
#include "compare/characterise/code_statistics.h"
#include "compare/match/residual_modes.h"
#include "core/program/errors.h"
#include "sim/marker/tag_pattern.h"

namespace etalon {
namespace {

// A single square tag, which has an id, and not a board.
bool is_tag(const Marker& marker) {
    return marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco;
}

// Not from a pile-up of equal codes below full scale: in a noise-free rendering white is one.
constexpr double saturation = 0.99 * 255.0;

// How well a pattern, with smooth light (a surface of second order), fits the cells' mean gray
// values. Random cells explain 1/n of n cells on average, the best of 5000 in 64 cells a quarter.
struct PatternScore {
    double explained = 0.0;      // 0 .. 1, of the variance without smooth light
    double contrast_gray = 0.0;  // of white over black; below 0: light and dark are exchanged
};

// Which pattern a photograph shows where the marker should be.
struct ShownPattern {
    double visible = 0.0;         // share of the compared area that is inside the image
    double cell_px = 0.0;         // side of a square with the mean area of a cell in the image
    double clipped_white = 0.0;   // share of the expected light cells' samples at the scale's end
    PatternScore expected, best;  // the best is the expected one unless another explains more
    int quarter_turns = 0;        // of the best, clockwise
    bool mirrored = false;        // of the best, before it is turned
    int id = 0;                   // of the best; only tags
    // Cells on the other side of the middle between light and dark than the expected pattern's.
    int flipped_to_light = 0, flipped_to_dark = 0;

    // The best is not the expected one, or its negative.
    bool is_another() const {
        return quarter_turns != 0 || mirrored || best.explained > expected.explained;
    }
};

// A cell (or, on boards of very many, every n-th) and what the photograph shows there.
struct CellSample {
    int row, column;
    double gray;
    Vector6d light;  // terms of smooth light
};

bool is_white(const CellGrid& grid, const CellSample& sample) {
    return grid.cells.at<float>(sample.row, sample.column) > 0.5f;
}

// Bilinear; the pixel is inside the image.
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

// Nine places in the middle half of a cell, all in the image. Adds to the sums of `shown`.
std::optional<CellSample> sample_cell(const cv::Mat& gray, const Projector& projector,
                                      const CellGrid& grid, const Rigid& pose, int row, int column,
                                      ShownPattern& shown) {
    CellSample sample{row, column, 0.0, Vector6d::Zero()};
    int clipped = 0;
    std::array<Eigen::Vector2d, 9> pixels;
    for (int i = 0; i < 9; ++i) {
        const double u = column + 0.25 + 0.25 * (i % 3), v = row + 0.25 + 0.25 * (i / 3);
        const auto pixel = pixel_of(projector, pose, grid, u, v);
        if (!pixel)
            return {};
        pixels[static_cast<std::size_t>(i)] = *pixel;
        const double value = interpolated(gray, *pixel);
        sample.gray += value / 9.0;
        clipped += value >= saturation ? 1 : 0;
        sample.light += level_terms(pixel->x(), pixel->y(), gray.size()) / 9.0;
    }
    if (is_white(grid, sample))
        shown.clipped_white += clipped / 9.0;
    const Eigen::Vector2d a = pixels[2] - pixels[0], b = pixels[6] - pixels[0];
    shown.cell_px += std::sqrt(std::abs(a.x() * b.y() - a.y() * b.x())) / 0.5;
    return sample;
}

// With the means of what is seen in `shown`.
std::vector<CellSample> sample_cells(const cv::Mat& gray, const Projector& projector,
                                     const CellGrid& grid, const ComparedArea& area,
                                     const Rigid& pose, ShownPattern& shown) {
    constexpr int max_per_side = 64;
    const int step = std::max(1, std::max(grid.rows(), grid.columns()) / max_per_side);
    std::vector<CellSample> cells;
    int places = 0;
    for (int row = 0; row < grid.rows(); row += step)
        for (int column = 0; column < grid.columns(); column += step) {
            const Eigen::Array2d middle = grid.point_mm(column + 0.5, row + 0.5).head<2>();
            if (!((middle > area.low_mm.array()).all() && (middle < area.high_mm.array()).all()))
                continue;
            ++places;
            if (const auto cell = sample_cell(gray, projector, grid, pose, row, column, shown))
                cells.push_back(*cell);
        }
    const auto count = static_cast<double>(cells.size());
    const auto white = static_cast<double>(
        std::ranges::count_if(cells, [&](const CellSample& cell) { return is_white(grid, cell); }));
    shown.visible = places > 0 ? count / places : 0.0;
    shown.cell_px /= std::max(count, 1.0);
    shown.clipped_white /= std::max(white, 1.0);
    return cells;
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

    // With light and dark that change over the marker: the pattern times 1, x and y. Into `flips`
    // come the numbers of cells that are on the other side.
    PatternScore score(const cv::Mat& cells, ShownPattern* flips = nullptr) const {
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

private:
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

// Ids are searched, in families of up to 5000, where the marker in any position explains little.
ShownPattern shown_pattern(const cv::Mat& photo_gray, const Projector& projector,
                           const Marker& marker, const ComparedArea& area,
                           const Rigid& camera_from_marker) {
    constexpr double well_explained = 0.9;
    constexpr std::size_t min_cells = 12;  // beside six terms of light and three of the pattern
    const CameraModel& camera = projector.camera();
    if (photo_gray.size() != cv::Size(camera.width, camera.height))
        throw NumericalError(fmt::format("photograph {} x {} px for a camera of {} x {}",
                                         photo_gray.cols, photo_gray.rows, camera.width,
                                         camera.height));
    ShownPattern shown;
    shown.id = marker.id;
    const std::vector<CellSample> cells =
        sample_cells(photo_gray, projector, marker.grid, area, camera_from_marker, shown);
    if (cells.size() < min_cells)
        return shown;
    const Scorer scorer(cells);
    shown.expected = scorer.score(marker.grid.cells, &shown);
    shown.best = shown.expected;
    if (shown.expected.explained > well_explained && shown.expected.contrast_gray > 0)
        return shown;
    try_positions(scorer, marker.grid.cells, marker.id, true, shown);
    if (is_tag(marker) && shown.best.explained < well_explained)
        try_other_ids(scorer, marker, shown);
    return shown;
}

// White minus black, and white, at every pixel.
struct Levels {
    cv::Mat white, contrast;

    Levels(const PhotometricModel& model, cv::Size size)
        : white(size, CV_32FC1), contrast(size, CV_32FC1) {
        for (int y = 0; y < size.height; ++y) {
            const LevelRow row(model, y, size);
            for (int x = 0; x < size.width; ++x) {
                const double black = row.black(x), full = row.white(x);
                const double light = model.between(black, full, 1.0).gray,
                             dark = model.between(black, full, 0.0).gray;
                white.at<float>(y, x) = static_cast<float>(light);
                contrast.at<float>(y, x) = static_cast<float>(std::max(light - dark, 1.0));
            }
        }
    }
};

cv::Mat change_per_px(const cv::Mat& gray) {
    cv::Mat by_x, by_y;
    constexpr double per_px = 1.0 / 8.0;  // of Sobel's filter
    cv::Sobel(gray, by_x, CV_32F, 1, 0, 3, per_px);
    cv::Sobel(gray, by_y, CV_32F, 0, 1, 3, per_px);
    return cv::abs(by_x) + cv::abs(by_y);
}

// Means over windows, of the used pixels among them; 0 where fewer than a sixth are used. The
// values are averaged over `step` x `step` px first, and the windows stand that far apart.
cv::Mat window_means(const cv::Mat& values, const cv::Mat& used, int side, int step) {
    constexpr double min_share = 1.0 / 6.0;
    const cv::Size size((values.cols + step - 1) / step, (values.rows + step - 1) / step);
    cv::Mat weight, weighted, sum, count;
    used.convertTo(weight, CV_32F, 1.0 / 255.0);
    cv::resize(values.mul(weight), weighted, size, 0, 0, cv::INTER_AREA);
    cv::resize(weight, weight, size, 0, 0, cv::INTER_AREA);
    const cv::Size window(side / step, side / step);
    cv::boxFilter(weighted, sum, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::boxFilter(weight, count, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::Mat means = sum / cv::max(count, 0.01f);
    means.setTo(0.0f, count < min_share);
    return means;
}

// Something covers the marker, or shines on it: a good part of the contrast over a wide place.
struct CoveredAreas {
    double largest = 0.0;       // of all windows, in parts of the contrast
    double share = 0.0;         // of the compared pixels that lie in windows above the limit
    double bright_share = 0.0;  // of those that are brighter than the marker's white or clipped
    cv::Mat pixels;             // CV_8UC1, 255: in such a window, or within a pixel of it
};

// The residual is averaged over square windows of this side away from edges; cells of 4 px and less
// have none. `limit` in parts of the photometric model's contrast.
CoveredAreas covered_areas(const cv::Mat& photo_gray, const PhotoFit& fit, double window_px,
                           double limit) {
    constexpr int enough_steps = 12;  // in a window
    const int side = std::max(3, static_cast<int>(std::lround(window_px)));
    const int step = std::max(1, side / enough_steps);
    const cv::Mat used = fit.use != pixel_outside;
    const Levels levels(fit.state.photometry, used.size());
    // Not near an edge, where a displacement of a px leaves a residual as large as a cover's.
    const cv::Mat flat = change_per_px(fit.predicted) < 0.05 * levels.contrast;
    const cv::Mat means = window_means(fit.residual / levels.contrast, used & flat, side, step);
    const cv::Mat size = cv::abs(means);

    CoveredAreas areas;
    cv::Mat used_windows, large;
    cv::resize(used, used_windows, size.size(), 0, 0, cv::INTER_NEAREST);
    cv::minMaxLoc(size, nullptr, &areas.largest, nullptr, nullptr, used_windows);
    cv::dilate(size > limit, large,
               cv::getStructuringElement(cv::MORPH_RECT, {side / step + 2, side / step + 2}));
    cv::resize(large, areas.pixels, used.size(), 0, 0, cv::INTER_NEAREST);
    const cv::Mat covered = areas.pixels & used;
    const int count = cv::countNonZero(covered), all = cv::countNonZero(used);
    if (count == 0)
        return areas;
    areas.share = static_cast<double>(count) / all;
    const cv::Mat brighter =
        (photo_gray > levels.white + 0.1 * levels.contrast) | (photo_gray >= saturation);
    areas.bright_share = static_cast<double>(cv::countNonZero(brighter & covered)) / count;
    return areas;
}

// RMS difference of neighbouring pixels' residuals, gray, across the borders of JPEG's blocks of
// 8 x 8 px and inside them; 0 without flat pairs, whose prediction changes by less than 1 % of
// `contrast_gray` per px. Not for cut or scaled photographs.
struct BlockSteps {
    double across_gray = 0.0, inside_gray = 0.0;
};

BlockSteps block_steps(const PhotoFit& fit, double contrast_gray) {
    constexpr int block_px = 8;
    const cv::Mat flat =
        (change_per_px(fit.predicted) < 0.01 * contrast_gray) & (fit.use != pixel_outside);
    std::array<double, 2> squares{}, pairs{};  // inside, across
    const auto add = [&](int x, int y, int before_x, int before_y, bool across) {
        if (!flat.at<uchar>(y, x) || !flat.at<uchar>(before_y, before_x))
            return;
        const double step =
            fit.residual.at<float>(y, x) - fit.residual.at<float>(before_y, before_x);
        squares[across ? 1 : 0] += step * step;
        pairs[across ? 1 : 0] += 1.0;
    };
    for (int y = 1; y < flat.rows; ++y)
        for (int x = 1; x < flat.cols; ++x) {
            add(x, y, x - 1, y, x % block_px == 0);
            add(x, y, x, y - 1, y % block_px == 0);
        }
    if (pairs[0] == 0 || pairs[1] == 0)
        return {};
    return {std::sqrt(squares[1] / pairs[1]), std::sqrt(squares[0] / pairs[0])};
}

// The limits; docs/match-outcome.md has the reasons.
constexpr double min_explained = 0.5;       // of the cells' variance, by any pattern
constexpr double max_clipped = 0.05;        // of the light cells' samples
constexpr double hopelessly_clipped = 0.5;  // their median is no level any more
constexpr double min_contrast_gray = 20.0;  // 8-bit steps are 5 % of it
constexpr double max_blur_cells = 0.35;     // sigma: a cell's middle misses its level by 15 %
constexpr double max_covered = 0.25;        // of the contrast, in a window
constexpr double bright_part = 0.3;         // of a covered area, for it to be called glare
// Of 26 photographs of a printed board (hand-held, JPEG at quality 50) the largest were 0.041 px,
// 0.066 px, 2.5 px, 4.0 gray and 0.034: what good work leaves, times 1.1 or more.
constexpr double max_rows_px = 0.06, max_calibration_px = 0.09;
constexpr double max_smear_px = 3.0;
constexpr double max_block_step_gray = 4.5;
constexpr double max_rest = 0.06;            // RMS residual, of the contrast
constexpr double max_rest_over_noise = 2.0;  // where the camera's noise is known
constexpr double max_blur_difference = 0.2;  // px^2, where the camera's file gives the blur

Finding refusal(std::string name, double value, double limit, std::string unit,
                std::string sentence) {
    return {std::move(name), value, limit, std::move(unit), std::move(sentence), true};
}

Finding not_in_image(double visible) {
    return {"not_in_image",
            100.0 * visible,
            100.0,
            "%",
            fmt::format("only {:.0f} % of the marker's cells are inside the image", 100 * visible),
            visible < 0.5};
}

Finding saturated(double clipped) {
    return {"saturated",
            100.0 * clipped,
            100.0 * max_clipped,
            "%",
            fmt::format("{:.0f} % of the light cells are at the end of the scale: expose less",
                        100.0 * clipped),
            clipped > hopelessly_clipped};
}

Finding other_pattern(const Marker& marker, const ShownPattern& shown) {
    Finding finding{"", shown.expected.explained, shown.best.explained, "", "", true};
    std::string position = shown.mirrored ? "mirrored" : "";
    if (shown.quarter_turns != 0)
        position += fmt::format("{}turned by {} degrees clockwise", shown.mirrored ? ", then " : "",
                                90 * shown.quarter_turns);
    if (is_tag(marker) && shown.id != marker.id) {
        finding.name = "wrong_marker";
        finding.sentence = fmt::format("this is id {} of {}, not {}{}", shown.id, marker.family,
                                       marker.id, position.empty() ? "" : ", " + position);
    } else {
        finding.name = shown.mirrored             ? "mirrored"
                       : shown.quarter_turns == 2 ? "upside_down"
                                                  : "turned";
        finding.sentence = "the marker is " + position + ", or the pose is so";
    }
    if (shown.best.contrast_gray < 0)
        finding.sentence += ", and light and dark are exchanged";
    return finding;
}

// Refusals by the pattern, worst first; one is enough.
Findings pattern_findings(const Marker& marker, const ShownPattern& shown) {
    const PatternScore& expected = shown.expected;
    if (shown.visible < 0.5)
        return {not_in_image(shown.visible)};
    const bool another =
        shown.is_another() && 1.0 - shown.best.explained < 0.5 * (1.0 - expected.explained);
    if (another && shown.best.explained > min_explained)
        return {other_pattern(marker, shown)};
    if (expected.explained < min_explained)
        return {refusal("marker_not_there", expected.explained, min_explained, "",
                        fmt::format("the marker is not where the pose says, or covered: its "
                                    "pattern explains {:.0f} % of what is seen there",
                                    100 * expected.explained))};
    if (expected.contrast_gray < 0)
        return {refusal("negative", expected.contrast_gray, 0.0, "gray",
                        is_tag(marker)
                            ? "light and dark are exchanged: a negative of the marker"
                            : "light and dark are exchanged: a negative, or the board is half a "
                              "turn round or a square aside")};
    if (is_tag(marker) && shown.flipped_to_light > 1 && shown.flipped_to_dark > 1)
        return {refusal("wrong_marker", shown.flipped_to_light + shown.flipped_to_dark, 1.0,
                        "cells",
                        fmt::format("{} dark cells are light and {} light ones dark: another "
                                    "marker, of another family or damaged",
                                    shown.flipped_to_light, shown.flipped_to_dark))};
    if (shown.clipped_white > hopelessly_clipped)
        return {saturated(shown.clipped_white)};
    if (expected.contrast_gray < min_contrast_gray)
        return {refusal("low_contrast", expected.contrast_gray, min_contrast_gray, "gray",
                        fmt::format("white and black are only {:.1f} gray values apart",
                                    expected.contrast_gray))};
    if (shown.visible < 1.0)
        return {not_in_image(shown.visible)};
    return {};
}

// Sigma of the whole blur without the pixel: what was fitted, and what the camera's file says.
double blur_sigma_px(const CameraModel& camera, const PhotoState& state) {
    double variance = state.photometry.psf_sigma_px * state.photometry.psf_sigma_px;
    if (camera.lens) {
        const double sigma = camera.lens->psf.sigma_px;
        const double radius = blur_radius_px(
            camera, depth_mm(camera.projection, state.camera_from_marker.translation));
        variance += sigma * sigma + radius * radius / 4.0;  // of a disk along any direction
    }
    return std::sqrt(variance);
}

// Side of the smallest thing that is printed: disks are drawn with cells far smaller than they are.
double printed_px(const Marker& marker, double cell_px) {
    const double cell_mm = std::sqrt(marker.grid.cell_mm.prod());
    const bool disks = marker.kind == Marker::Kind::circles ||
                       marker.kind == Marker::Kind::acircles ||
                       marker.kind == Marker::Kind::hexcircles;
    return cell_px * std::max(cell_mm, disks ? marker.part_mm : marker.detail_mm) / cell_mm;
}

Findings blur_findings(double sigma_px, double cell_px) {
    const double limit = std::min(max_blur_cells * cell_px, 0.99 * max_psf_sigma_px);
    if (sigma_px <= limit)
        return {};
    return {refusal("out_of_focus", sigma_px, limit, "px",
                    fmt::format("edges are blurred with a sigma of {:.1f} px, cells are {:.0f} px: "
                                "out of focus, or moved",
                                sigma_px, cell_px))};
}

Finding covered(const CoveredAreas& areas) {
    const bool glare = areas.bright_share > bright_part;
    return {glare ? "glare" : "occluded", 100.0 * areas.largest, 100.0 * max_covered, "%",
            glare
                ? fmt::format("a reflection (or something bright) on {:.1f} % of the marker",
                              100.0 * areas.share)
                : fmt::format("something covers or shades {:.1f} % of the marker, or its print is "
                              "damaged",
                              100.0 * areas.share)};
}

// The fit has a blur that differs along x and y, which is a part of the smear's.
Finding smeared(const ModeFit& fit, const PhotometricModel& photometry) {
    const double along_x = fit.values[0] + photometry.psf_anisotropy_px2;
    const double anisotropy = 2.0 * std::hypot(along_x, fit.values[1]);  // px^2
    const double direction = 0.5 * std::atan2(fit.values[1], along_x);
    return {
        "motion_blur", std::sqrt(12.0 * anisotropy), max_smear_px, "px",
        fmt::format("blurred along one direction ({:.0f} degrees from x towards y) as if moved by "
                    "{:.1f} px during the exposure; astigmatism would look the same",
                    direction * 180.0 / CV_PI, std::sqrt(12.0 * anisotropy))};
}

Finding of_mode(const ModeFit& fit, const PhotometricModel& photometry) {
    switch (fit.mode) {
        case ResidualMode::rows:
            return {"skewed", fit.size_px, max_rows_px, "px",
                    fmt::format("rows are displaced in proportion to their place, edges by "
                                "{:.2f} px: moved under a rolling shutter, or the "
                                "calibration's pixel aspect is wrong",
                                fit.size_px)};
        case ResidualMode::calibration:
            return {"calibration_mismatch", fit.size_px, max_calibration_px, "px",
                    fmt::format("edges are off by {:.2f} px in a way that another focal "
                                "length, centre or distortion explains: another camera's "
                                "calibration, another focus, or a marker that is not flat",
                                fit.size_px)};
        case ResidualMode::blur_along:
            return smeared(fit, photometry);
        case ResidualMode::sharpening:  // measured on the edges: sharpening_findings()
            break;
        case ResidualMode::blur:
            return {
                "blur_differs", fit.values[0], max_blur_difference, "px^2",
                fmt::format("{} than the camera's file says, by a variance of {:.2f} "
                            "px^2: another focus or aperture",
                            fit.values[0] > 0 ? "blurrier" : "sharper", std::abs(fit.values[0]))};
    }
    return {};
}

// Rows that are displaced and a wrong calibration may look nearly the same: then both are named.
void name_the_rival(const ResidualModes& modes, const ModeFit& fit, Finding& finding) {
    constexpr double nearly = 0.8;
    const bool rows = fit.mode == ResidualMode::rows;
    if (!rows && fit.mode != ResidualMode::calibration)
        return;
    const double own = modes.fit(fit.mode, {}).size_px;
    const double other =
        modes.fit(rows ? ResidualMode::calibration : ResidualMode::rows, {}).size_px;
    if (other > nearly * own)
        finding.sentence +=
            fmt::format("; {} explains {:.0f} % of it as well",
                        rows ? "a wrong calibration" : "a rolling shutter", 100.0 * other / own);
}

// On the edges' mean profile. Nothing where the marker's cells are too small to have one.
Findings sharpening_findings(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                             const PhotometricCamera& camera, const PhotoState& state) {
    constexpr std::size_t enough_edges = 40;
    auto sharpening = attempted([&] {
        const std::vector<StraightEdge> seen =
            target_edges(linear_photo(photo, camera.model()), camera.projector(), marker.grid,
                         state.camera_from_marker, area, {.with_clipped = true});
        std::vector<StraightEdge> some;  // all over the marker
        for (std::size_t i = 0; i < seen.size(); i += seen.size() / enough_edges + 1)
            some.push_back(seen[i]);
        return measure_sharpening(some, camera.model());
    });
    if (!sharpening || !sharpening->is_detected)
        return {};
    const double over = 100.0 * sharpening->overshoot, under = 100.0 * sharpening->undershoot;
    return {{"sharpened", std::max(over, under), 100.0 * min_overshoot, "%",
             fmt::format("edges overshoot by {:.1f} % of their contrast and undershoot by "
                         "{:.1f} %: the camera sharpens",
                         std::max(over, 0.0), std::max(under, 0.0))}};
}

Findings mode_findings(const ResidualModes& modes, const PhotometricModel& photometry) {
    Findings findings;
    const auto add = [&](const ModeFit& fit) {
        Finding finding = of_mode(fit, photometry);
        const bool is_signed = fit.mode == ResidualMode::blur;
        if (finding.name.empty() ||
            !((is_signed ? std::abs(finding.value) : finding.value) > finding.limit))
            return;
        name_the_rival(modes, fit, finding);
        findings.push_back(finding);
    };
    bool smear_seen = false;
    for (const ModeFit& fit : modes.significant()) {
        add(fit);
        smear_seen = smear_seen || fit.mode == ResidualMode::blur_along;
    }
    // A smear that the fit has taken up leaves nothing significant.
    if (!smear_seen && photometry.psf_anisotropy_px2 != 0.0)
        add(modes.fit(ResidualMode::blur_along, {}));
    return findings;
}

Findings compression_findings(const BlockSteps& steps) {
    constexpr double clearly = 1.25;  // above what noise alone makes of the ratio
    const double excess = std::sqrt(std::max(
        steps.across_gray * steps.across_gray - steps.inside_gray * steps.inside_gray, 0.0));
    if (excess <= max_block_step_gray || steps.across_gray < clearly * steps.inside_gray)
        return {};
    return {{"compressed", excess, max_block_step_gray, "gray",
             fmt::format("blocks of 8 x 8 px differ by {:.1f} gray where the marker is flat: "
                         "compress less",
                         excess)}};
}

// A residual that none of the named tests explains.
Findings rest_findings(const PhotometricCamera& camera, const PhotoMatch& match,
                       double contrast_gray) {
    if (camera.knows_noise() && match.pose.noise_scale > max_rest_over_noise)
        return {{"unexplained", match.pose.noise_scale, max_rest_over_noise, "",
                 fmt::format("the residual is {:.1f} times the camera's noise, and nothing "
                             "named explains it",
                             match.pose.noise_scale)}};
    const double rest = match.refined.scored.rms_gray / contrast_gray;
    if (rest <= max_rest)
        return {};
    return {{"unexplained", 100.0 * rest, 100.0 * max_rest, "%",
             fmt::format("the residual is {:.1f} % of the contrast, and nothing named explains it",
                         100.0 * rest)}};
}

}  // namespace

bool is_refused(const Findings& findings) {
    return std::ranges::any_of(findings, &Finding::is_not_assessable);
}

Findings examine_marker(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                        const Projector& projector, const Rigid& camera_from_marker) {
    return pattern_findings(
        marker, shown_pattern(gray_of(photo), projector, marker, area, camera_from_marker));
}

Findings examine_match(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                       const PhotometricCamera& camera, const PhotoMatch& match) {
    const cv::Mat gray = gray_of(photo);
    const PhotoState& state = match.refined.state;
    const ShownPattern shown =
        shown_pattern(gray, camera.projector(), marker, area, state.camera_from_marker);
    Findings findings = pattern_findings(marker, shown);
    if (is_refused(findings))
        return findings;
    const PhotoFit& fit = match.refined;
    const double printed = printed_px(marker, shown.cell_px);
    const Findings blur = blur_findings(blur_sigma_px(camera.model(), state), printed);
    if (!blur.empty())
        return blur;
    const auto add = [&](const Findings& more) {
        findings.insert(findings.end(), more.begin(), more.end());
    };
    const CoveredAreas areas = covered_areas(gray, fit, printed / 3.0, max_covered);
    if (areas.share > 0)
        findings.push_back(covered(areas));
    else if (shown.clipped_white > max_clipped)
        findings.push_back(saturated(shown.clipped_white));
    add(mode_findings(ResidualModes(fit, (fit.use != pixel_outside) & (areas.pixels == 0), camera,
                                    state.camera_from_marker, match.pose.noise_scale),
                      state.photometry));
    // A smear has sharp ends, which would pass for sharpening.
    if (std::ranges::find(findings, "motion_blur", &Finding::name) == findings.end())
        add(sharpening_findings(photo, marker, area, camera, state));
    add(compression_findings(block_steps(fit, shown.expected.contrast_gray)));
    if (findings.empty())
        add(rest_findings(camera, match, shown.expected.contrast_gray));
    return findings;
}

// Why a detector found nothing: by trying.

namespace {

constexpr double min_range_gray = 20.0;  // as of the contrast
constexpr double max_saturated = 0.5;    // of the image: a white wall beside the marker is well

// Between the darkest and the lightest per cent of the pixels.
double range_gray(const CodeImage& photo) {
    cv::Mat pixels = photo.pixels.reshape(1, 1).clone();
    cv::sort(pixels, pixels, cv::SORT_EVERY_ROW | cv::SORT_ASCENDING);
    const int n = pixels.cols;
    const auto at = [&](int i) {
        return pixels.depth() == CV_8U ? static_cast<double>(pixels.at<uchar>(0, i))
                                       : static_cast<double>(pixels.at<ushort>(0, i));
    };
    return (at(n - 1 - n / 100) - at(n / 100)) * 255.0 / photo.full_scale();
}

}  // namespace

Findings examine_missing_marker(const CodeImage& photo, Detector& detector) {
    if (photo.pixels.empty())
        return {};
    const double range = range_gray(photo);
    if (range < min_range_gray)
        return {refusal("low_contrast", range, min_range_gray, "gray",
                        fmt::format("the whole photograph spans {:.0f} gray values: empty, dark or "
                                    "without contrast",
                                    range))};
    const double clipped = share_at_saturation(photo, photo.full_scale());
    if (clipped > max_saturated)
        return {refusal("saturated", 100.0 * clipped, 100.0 * max_saturated, "%",
                        fmt::format("{:.0f} % of the photograph is at the end of the scale: expose "
                                    "less",
                                    100.0 * clipped))};
    const auto is_found_in = [&](const cv::Mat& pixels) {
        return detector.detect({pixels, photo.bits}).corners.has_value();
    };
    if (is_found_in(photo.full_scale() - photo.pixels))
        return {refusal("negative", 0.0, 0.0, "",
                        "in the negative the marker is found: light and dark are exchanged")};
    cv::Mat changed;
    cv::flip(photo.pixels, changed, 1);
    if (is_found_in(changed))
        return {refusal("mirrored", 0.0, 0.0, "",
                        "in the mirrored photograph the marker is found: it is printed or read "
                        "out mirrored")};
    for (const int factor : {2, 4}) {
        if (std::min(photo.pixels.rows, photo.pixels.cols) / factor <= 40)
            break;
        cv::resize(photo.pixels, changed, {}, 1.0 / factor, 1.0 / factor, cv::INTER_AREA);
        if (is_found_in(changed))
            return {refusal("out_of_focus", 0.0, 0.0, "",
                            fmt::format("in the photograph reduced to 1/{} the marker is found: "
                                        "out of focus, moved or noisy",
                                        factor))};
    }
    return {};
}

}  // namespace etalon
