// Circle grids: the lattice that dark ellipses make says which circle is which; the centroid is
// then taken from the image.
#include <fmt/format.h>

#include <Eigen/Dense>

#include "compare/detect/board/calibration_target.h"
#include "compare/detect/board/shape_grid.h"
#include "compare/detect/detector_adaptors.h"
#include "core/statistics/distributions.h"
#include "sim/marker/board_pattern.h"

namespace etalon {
namespace {

CircleLayout layout_of(const Marker& board) {
    return board.kind == Marker::Kind::hexcircles ? CircleLayout::hexagonal
           : board.kind == Marker::Kind::acircles ? CircleLayout::asymmetric
                                                  : CircleLayout::symmetric;
}

// Staggered rows are a lattice, too, with steps to the next row's circles right and left.
std::vector<Eigen::Vector2i> lattice_places(const Marker& board) {
    const CircleLayout layout = layout_of(board);
    std::vector<Eigen::Vector2i> places = circle_places(layout, board.columns, board.rows);
    if (layout == CircleLayout::symmetric)
        return places;
    const Eigen::Vector2i first = places.front();
    for (Eigen::Vector2i& place : places) {
        const Eigen::Vector2i from_first = place - first;
        place = {from_first.sum() / 2, (from_first.y() - from_first.x()) / 2};
    }
    return places;
}

using Circles = std::vector<std::optional<DarkShape>>;

// Px from mm, to place windows with: distortion is left to them.
std::optional<Eigen::Matrix3d> view_of(const Marker& board, const Circles& circles) {
    std::vector<Eigen::Vector2d> mm, px;
    for (std::size_t i = 0; i < circles.size(); ++i)
        if (circles[i]) {
            mm.push_back(board.points_mm[i].head<2>());
            px.push_back(circles[i]->centre);
        }
    return homography(mm, px);
}

// Pixels of a disk on the board around a place in the image, with their distance from it in mm.
template <class Use>
void for_each_pixel(const cv::Mat& pixels, const Eigen::Vector2d& centre,
                    const Eigen::Matrix2d& px_per_mm, double radius_mm, Use use) {
    const Eigen::Matrix2d mm_per_px = px_per_mm.inverse();
    const Eigen::Vector2d reach = px_per_mm.rowwise().norm() * radius_mm;
    const Eigen::Vector2d last(pixels.cols - 1, pixels.rows - 1);
    const Eigen::Vector2i low = (centre - reach).cwiseMax(0.0).array().ceil().matrix().cast<int>(),
                          high =
                              (centre + reach).cwiseMin(last).array().floor().matrix().cast<int>();
    for (int y = low.y(); y <= high.y(); ++y)
        for (int x = low.x(); x <= high.x(); ++x) {
            const Eigen::Vector2d from_centre = Eigen::Vector2d(x, y) - centre;
            const double distance_mm = (mm_per_px * from_centre).norm();
            if (distance_mm <= radius_mm)
                use(from_centre, distance_mm, static_cast<double>(pixels.at<float>(y, x)));
        }
}

struct CircleWindow {
    Eigen::Matrix2d px_per_mm;
    double inside_mm, ring_from_mm, ring_to_mm;
};

// Half of the way to the next circle or to the image's border; nothing where too little is left.
std::optional<CircleWindow> window_around(const cv::Mat& pixels, const Eigen::Vector2d& centre,
                                          const Eigen::Matrix2d& px_per_mm, double radius_mm,
                                          double gap_mm) {
    constexpr double min_margin_px = 2.0;
    const Eigen::Vector2d last(pixels.cols - 1, pixels.rows - 1);
    const double in_image_mm =
        centre.cwiseMin(last - centre).cwiseQuotient(px_per_mm.rowwise().norm()).minCoeff();
    const double margin = std::min(0.5 * gap_mm, in_image_mm - radius_mm);
    if (!(margin >= std::min(0.5 * gap_mm, min_margin_px / px_per_mm.rowwise().norm().minCoeff())))
        return std::nullopt;
    return CircleWindow{px_per_mm, radius_mm + margin, radius_mm + 0.7 * margin,
                        radius_mm + 1.3 * margin};
}

// The light around a circle, a plane through the pixels of the window's ring; nothing without any.
std::optional<Eigen::Vector3d> background_of(const cv::Mat& pixels, const CircleWindow& window,
                                             const Eigen::Vector2d& centre) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
    for_each_pixel(pixels, centre, window.px_per_mm, window.ring_to_mm,
                   [&](const Eigen::Vector2d& place, double distance_mm, double value) {
                       if (distance_mm < window.ring_from_mm)
                           return;
                       const Eigen::Vector3d terms(1.0, place.x(), place.y());
                       normal += terms * terms.transpose();
                       rhs += terms * value;
                   });
    const Eigen::Vector3d plane = normal.ldlt().solve(rhs);
    return plane.allFinite() && plane[0] > 0.0 ? std::optional(plane) : std::nullopt;
}

// Calls `use(place, distance_mm, darkness)`: 0 is the background, 1 black. False without pixels.
template <class Use>
bool for_each_darkness(const cv::Mat& pixels, const CircleWindow& window,
                       const Eigen::Vector2d& centre, Use use) {
    const auto plane = background_of(pixels, window, centre);
    if (plane)
        for_each_pixel(pixels, centre, window.px_per_mm, window.inside_mm,
                       [&](const Eigen::Vector2d& place, double distance_mm, double value) {
                           const double light = (*plane)[0] + plane->tail<2>().dot(place);
                           use(place, distance_mm, light > 0.0 ? 1.0 - value / light : 0.0);
                       });
    return plane.has_value();
}

// The centroid's offset from `centre`; nothing where no dark disk is seen.
std::optional<Eigen::Vector2d> centroid_offset(const cv::Mat& pixels, const CircleWindow& window,
                                               const Eigen::Vector2d& centre) {
    constexpr double min_darkness = 0.05;
    double mass = 0.0, pixels_inside = 0.0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    const bool has_light = for_each_darkness(
        pixels, window, centre, [&](const Eigen::Vector2d& place, double, double darkness) {
            mass += darkness;
            moment += darkness * place;
            pixels_inside += 1.0;
        });
    if (!has_light || !(mass > min_darkness * pixels_inside))
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

// Of the disk as dark as the circle's middle that takes as much light away, which no blur changes.
std::optional<double> diameter_mm(const cv::Mat& pixels, const CircleWindow& window,
                                  const DarkShape& circle) {
    constexpr double middle_part = 0.3, min_middle_px = 0.75;
    const double mm2_per_px2 = 1.0 / std::abs(window.px_per_mm.determinant()),
                 outline_mm = std::sqrt(circle.area_px2 / std::numbers::pi * mm2_per_px2),
                 middle_mm =
                     std::max(middle_part * outline_mm, min_middle_px * std::sqrt(mm2_per_px2));
    double mass = 0.0, middle_mass = 0.0, middle_pixels = 0.0;
    for_each_darkness(pixels, window, circle.centre,
                      [&](const Eigen::Vector2d&, double distance_mm, double darkness) {
                          mass += darkness;
                          if (distance_mm > middle_mm)
                              return;
                          middle_mass += darkness;
                          middle_pixels += 1.0;
                      });
    const double area_px2 = mass * middle_pixels / middle_mass;
    if (!(middle_mass > 0.0) || !(area_px2 > 0.0))
        return std::nullopt;
    return 2.0 * std::sqrt(area_px2 / std::numbers::pi * mm2_per_px2);
}

// The circles' diameter for the stated spacing; 0 where none can be measured.
double seen_diameter_mm(const Marker& board, const Eigen::Matrix3d& view, const Circles& circles,
                        const cv::Mat& pixels) {
    const double half_way = 0.5 * nearest_circle_mm(layout_of(board), board.size_mm);
    std::vector<double> diameters;
    for (std::size_t i = 0; i < circles.size(); ++i)
        if (circles[i]) {
            const CircleWindow window{jacobian_at(view, board.points_mm[i].head<2>()), half_way,
                                      0.95 * half_way, 1.05 * half_way};
            if (const auto seen = diameter_mm(pixels, window, *circles[i]))
                diameters.push_back(*seen);
        }
    return diameters.empty() ? 0.0 : median(std::move(diameters));
}

}  // namespace

FoundBoard find_circle_centroids(const Marker& board, const BoardPhoto& photo) {
    constexpr double max_difference = 0.15;  // of the diameter
    const auto [circles, reason] =
        find_shape_grid(ShapeKind::ellipse, photo.eight_bit, lattice_places(board));
    const auto view = circles.empty() ? std::nullopt : view_of(board, circles);
    if (!view)
        return {{}, reason};
    const double diameter = board.part_mm,
                 seen = seen_diameter_mm(board, *view, circles, photo.pixels);
    if (!(std::abs(seen - diameter) < max_difference * diameter))
        return {{},
                fmt::format("the circles are about {:.3g} mm wide where their spacing is {} mm, "
                            "not {} mm",
                            seen, board.size_mm, diameter)};
    const double radius = diameter / 2.0,
                 gap = nearest_circle_mm(layout_of(board), board.size_mm) - diameter;
    FoundBoard result;
    for (std::size_t i = 0; i < circles.size(); ++i) {
        const Eigen::Vector2d mm = board.points_mm[i].head<2>();
        const Eigen::Vector2d start = circles[i] ? circles[i]->centre : seen_at(*view, mm);
        const auto window = window_around(photo.pixels, start, jacobian_at(*view, mm), radius, gap);
        if (window)
            result.add(static_cast<int>(i), centroid(photo.pixels, *window, start));
    }
    return result;
}

}  // namespace etalon
