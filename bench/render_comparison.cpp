#include "bench/render_comparison.h"

#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double gray = 1.0 / 255.0;

// Centres of the windows, as parts of the grid's width and height. For a tag of 10 x 10 cells: its
// black square's corners, cells inside, the background beside it and far away.
constexpr std::array<std::pair<double, double>, 5> window_centres{
    {{0.1, 0.1}, {0.4, 0.5}, {0.9, 0.9}, {0.5, 1.06}, {-0.6, 0.3}}};

// A straight edge through a point of the grid, along u or along v.
struct CheckedEdge {
    double u, v;
    bool along_u;
};
// The black square's upper and right edges.
constexpr std::array edges{CheckedEdge{0.62, 0.1, true}, CheckedEdge{0.9, 0.38, false}};

class WindowPlacer {
public:
    WindowPlacer(const CameraModel& camera, const PlacedMarker& marker)
        : camera_(camera), marker_(marker), projector_(camera) {}

    Eigen::Vector2d size() const { return {marker_.grid.columns(), marker_.grid.rows()}; }

    // Around a grid point; nearer to the grid's centre where it leaves the image.
    cv::Rect window(const Eigen::Vector2d& place, const cv::Size& extent) const {
        const Eigen::Vector2d centre = 0.5 * size();
        for (double part = 1.0; part > 1e-3; part *= 0.9)
            if (const auto pixel = projected(centre + part * (place - centre))) {
                const cv::Rect rect(static_cast<int>(std::lround(pixel->x())) - extent.width / 2,
                                    static_cast<int>(std::lround(pixel->y())) - extent.height / 2,
                                    extent.width, extent.height);
                if ((rect & cv::Rect(0, 0, camera_.width, camera_.height)) == rect)
                    return rect;
            }
        throw NumericalError(
            fmt::format("no window of {} x {} px around the marker is inside the image",
                        extent.width, extent.height));
    }

    ComparisonWindow edge_window(const CheckedEdge& edge, int side) const {
        const Eigen::Vector2d place = Eigen::Vector2d(edge.u, edge.v).cwiseProduct(size());
        const Eigen::Vector2d step(edge.along_u ? 0.5 : 0.0, edge.along_u ? 0.0 : 0.5);
        const auto a = projected(place - step), b = projected(place + step);
        if (!a || !b)
            throw NumericalError("an edge of the marker is outside the camera's valid region");
        const Eigen::Vector2d along = (*b - *a).normalized();
        const bool rows = std::abs(along.y()) > std::abs(along.x());  // the normal is nearer to x
        const double cosine = rows ? std::abs(along.y()) : std::abs(along.x());
        const int across = std::max(side, profile_length(place));
        return {window(place, rows ? cv::Size(across, side) : cv::Size(side, across)),
                rows ? ComparisonWindow::Profiles::rows : ComparisonWindow::Profiles::columns,
                cosine * gray / contrast(place, edge.along_u)};
    }

private:
    Eigen::Vector3d point(const Eigen::Vector2d& place) const {
        return marker_.camera_from_marker * marker_.grid.point_mm(place.x(), place.y());
    }
    std::optional<Eigen::Vector2d> projected(const Eigen::Vector2d& place) const {
        return projector_.project(point(place));
    }

    // Blur on both sides, and 3 px for pixel and diffraction core.
    int profile_length(const Eigen::Vector2d& place) const {
        const double depth = depth_mm(camera_.projection, point(place));
        const double half = std::min(blur_radius_px(camera_, depth), 50.0) + 3.0;
        return std::min({2 * static_cast<int>(std::ceil(half)) + 1, camera_.width, camera_.height});
    }

    // Between the cells on both sides of the edge; 1 where they are alike.
    double contrast(const Eigen::Vector2d& place, bool along_u) const {
        const Eigen::Vector2d half(along_u ? 0.0 : 0.5, along_u ? 0.5 : 0.0);
        const double difference = std::abs(cell(place + half) - cell(place - half));
        return difference > 0.0 ? difference : 1.0;
    }
    double cell(const Eigen::Vector2d& place) const {
        const int column = std::clamp(static_cast<int>(place.x()), 0, marker_.grid.columns() - 1);
        const int row = std::clamp(static_cast<int>(place.y()), 0, marker_.grid.rows() - 1);
        return marker_.grid.cells.at<float>(row, column);
    }

    const CameraModel& camera_;
    const PlacedMarker& marker_;
    Projector projector_;
};

double square(double x) {
    return x * x;
}

// The RMS over the profiles of the displacement that the errors amount to, and of its noise.
void add_edge_shift(std::span<const double> errors, const RenderTruth& truth,
                    RenderComparison& result) {
    double shift = 0.0, noise = 0.0;
    std::size_t first = 0, profiles = 0;
    for (const ComparisonWindow& window : truth.windows) {
        const auto width = static_cast<std::size_t>(window.pixels.width);
        const auto height = static_cast<std::size_t>(window.pixels.height);
        const bool rows = window.profiles == ComparisonWindow::Profiles::rows;
        const std::size_t count = rows ? height : width, length = rows ? width : height;
        for (std::size_t p = 0; p < count && window.shift_px_per_gray > 0.0; ++p, ++profiles) {
            double light = 0.0, variance = 0.0;
            for (std::size_t i = 0; i < length; ++i) {
                const std::size_t pixel = first + (rows ? p * width + i : i * width + p);
                light += errors[pixel];
                variance += square(truth.values[pixel].standard_error / gray);
            }
            shift += square(light * window.shift_px_per_gray);
            noise += variance * square(window.shift_px_per_gray);
        }
        first += width * height;
    }
    const double count = static_cast<double>(std::max<std::size_t>(1, profiles));
    result.edge_shift_px = std::sqrt(shift / count);
    result.reference_shift_px = std::sqrt(noise / count);
}

double percentile(std::vector<double> values, double part) {
    const auto index = static_cast<std::size_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(index),
                     values.end());
    return values[index];
}

}  // namespace

double RenderComparison::corrected_rms_gray() const {
    return std::sqrt(std::max(0.0, square(rms_gray) - square(reference_rms_gray)));
}

double RenderComparison::corrected_shift_px() const {
    return std::sqrt(std::max(0.0, square(edge_shift_px) - square(reference_shift_px)));
}

RenderTruth integrate_truth(const CameraModel& camera, const Scene& scene, int side,
                            const ReferenceOptions& reference) {
    if (scene.markers.empty())
        throw NumericalError("a scene without a marker has nothing to compare");
    RenderTruth truth;
    const WindowPlacer placer(camera, scene.markers.front());
    for (const auto& [u, v] : window_centres)
        truth.windows.push_back(
            {placer.window(Eigen::Vector2d(u, v).cwiseProduct(placer.size()), {side, side})});
    for (const CheckedEdge& edge : edges)
        truth.windows.push_back(placer.edge_window(edge, side));
    for (const ComparisonWindow& window : truth.windows)
        for (int y = 0; y < window.pixels.height; ++y)
            for (int x = 0; x < window.pixels.width; ++x)
                truth.pixels.push_back(window.pixels.tl() + cv::Point(x, y));
    truth.values = integrate_reference(camera, scene, truth.pixels, reference);
    return truth;
}

RenderComparison compare_with_truth(std::span<const double> radiance, const RenderTruth& truth) {
    RenderComparison result;
    result.pixels = static_cast<int>(truth.pixels.size());
    if (truth.pixels.empty())
        return result;
    std::vector<double> errors, sizes;
    for (std::size_t i = 0; i < truth.pixels.size(); ++i) {
        const double error = (radiance[i] - truth.values[i].mean) / gray;
        const double sigma = truth.values[i].standard_error / gray;
        errors.push_back(error);
        sizes.push_back(std::abs(error));
        result.rms_gray += square(error) / result.pixels;
        result.reference_rms_gray += square(sigma) / result.pixels;
        result.reference_fourth += square(square(sigma)) / result.pixels;
        if (std::abs(error) > 0.1)
            result.max_sigmas = std::max(result.max_sigmas, (std::abs(error) - 0.1) / sigma);
    }
    result.rms_gray = std::sqrt(result.rms_gray);
    result.reference_rms_gray = std::sqrt(result.reference_rms_gray);
    result.p99_gray = percentile(sizes, 0.99);
    result.max_gray = *std::max_element(sizes.begin(), sizes.end());
    add_edge_shift(errors, truth, result);
    return result;
}

std::vector<double> values_at(const Radiance& image, const std::vector<cv::Point>& pixels) {
    std::vector<double> values;
    for (const cv::Point& pixel : pixels)
        values.push_back(image.at<float>(pixel));
    return values;
}

}  // namespace etalon
