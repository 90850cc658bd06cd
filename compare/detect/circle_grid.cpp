// Circle grids: OpenCV's finder says which blob is which; the centroid is then taken from the
// image.
#include <Eigen/Dense>
#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "compare/detect/board_points.h"
#include "sim/marker/board_pattern.h"

namespace etalon {
namespace {

cv::Ptr<cv::FeatureDetector> blob_finder(const cv::Mat& image, std::size_t circles) {
    cv::SimpleBlobDetector::Params parameters;  // dark blobs
    parameters.minThreshold = 20;
    parameters.maxThreshold = 235;
    parameters.thresholdStep = 12;
    parameters.minDistBetweenBlobs = 3;
    parameters.minArea = 12;
    parameters.maxArea = static_cast<float>(image.total()) / static_cast<float>(circles);
    parameters.minConvexity = 0.8f;
    parameters.minInertiaRatio = 0.05f;
    return cv::SimpleBlobDetector::create(parameters);
}

// Seen from the front the rows run clockwise into the columns. OpenCV may return the mirrored order
// where the layout allows it: rows are then counted from the other side.
void make_right_handed(std::vector<cv::Point2f>& centres, int columns, int rows) {
    const cv::Point2f along = centres[columns - 1] - centres[0],
                      down = centres[(rows - 1) * columns] - centres[0];
    if (along.cross(down) >= 0.0)
        return;
    for (int row = 0; row < rows / 2; ++row)
        std::swap_ranges(centres.begin() + row * columns, centres.begin() + (row + 1) * columns,
                         centres.begin() + (rows - 1 - row) * columns);
}

// Where nothing tells one end from the other, the first circle is the one nearer to the image's
// upper left.
void choose_first(std::vector<cv::Point2f>& centres, bool asymmetric, int rows) {
    const bool ends_differ = asymmetric && rows % 2 == 1;
    const auto sum = [](const cv::Point2f& p) { return p.x + p.y; };
    if (!ends_differ && sum(centres.back()) < sum(centres.front()))
        std::reverse(centres.begin(), centres.end());
}

std::vector<cv::Point2f> find_blobs(const Marker& board, const cv::Mat& image) {
    constexpr int min_px = 16;
    if (std::min(image.cols, image.rows) < min_px)
        return {};
    cv::Mat stretched;
    cv::normalize(image, stretched, 0, 255, cv::NORM_MINMAX, CV_8U);
    const bool asymmetric = board.kind == Marker::Kind::acircles;
    const int layout = asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
    const auto finder = blob_finder(stretched, board.points_mm.size());
    std::vector<cv::Point2f> centres;
    for (const int method : {0, static_cast<int>(cv::CALIB_CB_CLUSTERING)})
        if (cv::findCirclesGrid(stretched, {board.columns, board.rows}, centres, layout | method,
                                finder)) {
            make_right_handed(centres, board.columns, board.rows);
            choose_first(centres, asymmetric, board.rows);
            return centres;
        }
    return {};
}

// The board as it is seen around its points: px and px/mm by one homography, to place windows with.
struct BoardView {
    Eigen::Matrix3d pixel_from_mm;

    Eigen::Matrix2d px_per_mm(const Eigen::Vector2d& mm) const {
        const Eigen::Vector3d there = pixel_from_mm * mm.homogeneous();
        return (pixel_from_mm.topLeftCorner<2, 2>() -
                there.hnormalized() * pixel_from_mm.bottomLeftCorner<1, 2>()) /
               there.z();
    }
};

std::optional<BoardView> view_of(const Marker& board, const std::vector<cv::Point2f>& centres) {
    std::vector<cv::Point2f> mm;
    for (const Eigen::Vector3d& point : board.points_mm)
        mm.emplace_back(static_cast<float>(point.x()), static_cast<float>(point.y()));
    const cv::Mat h = cv::findHomography(mm, centres, 0);
    if (h.empty())
        return std::nullopt;
    BoardView view;
    for (int i = 0; i < 9; ++i)
        view.pixel_from_mm(i / 3, i % 3) = h.at<double>(i / 3, i % 3);
    return view;
}

// Pixels of a disk on the board around a place in the image, with their distance from it in mm.
template <class Use>
bool for_each_pixel(const cv::Mat& pixels, const Eigen::Vector2d& centre,
                    const Eigen::Matrix2d& px_per_mm, double radius_mm, Use use) {
    const Eigen::Matrix2d mm_per_px = px_per_mm.inverse();
    const Eigen::Vector2d reach = px_per_mm.rowwise().norm() * radius_mm;
    const Eigen::Vector2d last(pixels.cols - 1, pixels.rows - 1);
    if (!((centre - reach).minCoeff() >= 0.0 && (last - centre - reach).minCoeff() >= 0.0))
        return false;
    const Eigen::Vector2i low = (centre - reach).array().ceil().matrix().cast<int>(),
                          high = (centre + reach).array().floor().matrix().cast<int>();
    for (int y = low.y(); y <= high.y(); ++y)
        for (int x = low.x(); x <= high.x(); ++x) {
            const Eigen::Vector2d from_centre = Eigen::Vector2d(x, y) - centre;
            const double distance_mm = (mm_per_px * from_centre).norm();
            if (distance_mm <= radius_mm)
                use(from_centre, distance_mm, static_cast<double>(pixels.at<float>(y, x)));
        }
    return true;
}

struct CircleWindow {
    Eigen::Matrix2d px_per_mm;
    double inside_mm, ring_from_mm, ring_to_mm;
};

// The centroid's offset from `centre`; nothing where no dark disk is.
std::optional<Eigen::Vector2d> centroid_offset(const cv::Mat& pixels, const CircleWindow& window,
                                               const Eigen::Vector2d& centre) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
    const bool seen =
        for_each_pixel(pixels, centre, window.px_per_mm, window.ring_to_mm,
                       [&](const Eigen::Vector2d& place, double distance_mm, double value) {
                           if (distance_mm < window.ring_from_mm)
                               return;
                           const Eigen::Vector3d terms(1.0, place.x(), place.y());
                           normal += terms * terms.transpose();
                           rhs += terms * value;
                       });
    const Eigen::Vector3d plane = normal.ldlt().solve(rhs);
    if (!seen || !plane.allFinite() || !(plane[0] > 0.0))
        return std::nullopt;
    double mass = 0.0, pixels_inside = 0.0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    for_each_pixel(pixels, centre, window.px_per_mm, window.inside_mm,
                   [&](const Eigen::Vector2d& place, double, double value) {
                       const double background = plane[0] + plane.tail<2>().dot(place);
                       const double darkness = background > 0.0 ? 1.0 - value / background : 0.0;
                       mass += darkness;
                       moment += darkness * place;
                       pixels_inside += 1.0;
                   });
    constexpr double min_darkness = 0.05;
    if (!(mass > min_darkness * pixels_inside))
        return std::nullopt;
    return Eigen::Vector2d(moment / mass);
}

std::optional<Eigen::Vector2d> centroid(const cv::Mat& pixels, const CircleWindow& window,
                                        const Eigen::Vector2d& start) {
    constexpr int max_steps = 20;
    constexpr double settled_px = 1e-4;
    const double largest_shift =
        0.5 * window.inside_mm * window.px_per_mm.jacobiSvd().singularValues()[1];
    Eigen::Vector2d centre = start;
    for (int i = 0; i < max_steps; ++i) {
        const auto offset = centroid_offset(pixels, window, centre);
        if (!offset || (centre + *offset - start).norm() > largest_shift)
            return std::nullopt;
        centre += *offset;
        if (offset->norm() < settled_px)
            break;
    }
    return centre;
}

}  // namespace

std::vector<BoardPoint> find_circle_centroids(const Marker& board, const BoardPhoto& photo) {
    const std::vector<cv::Point2f> blobs = find_blobs(board, photo.eight_bit);
    if (blobs.size() != board.points_mm.size())
        return {};
    const auto view = view_of(board, blobs);
    if (!view)
        return {};
    const CircleLayout layout =
        board.kind == Marker::Kind::circles ? CircleLayout::symmetric : CircleLayout::asymmetric;
    const double radius = board.part_mm / 2.0,
                 gap = nearest_circle_mm(layout, board.size_mm) - board.part_mm;
    std::vector<BoardPoint> points;
    for (std::size_t i = 0; i < blobs.size(); ++i) {
        const CircleWindow window{view->px_per_mm(board.points_mm[i].head<2>()), radius + 0.5 * gap,
                                  radius + 0.35 * gap, radius + 0.65 * gap};
        if (!window.px_per_mm.allFinite())
            return {};
        if (const auto pixel = centroid(photo.pixels, window, {blobs[i].x, blobs[i].y}))
            points.push_back({static_cast<int>(i), *pixel});
    }
    return points;
}

}  // namespace etalon
