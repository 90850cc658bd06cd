// The edges of a STag marker and where they are in an image, each measured on its own.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <optional>
#include <vector>

#include "compare/detect/stag/stag_reading.h"

namespace etalon {

// How a STag marker lies in an image: what the refinement of its corners varies.

// A homography from the marker's plane (sides of its square, origin at its centre), and radial
// distortion about the image's centre by the division model with one number L (A. Fitzgibbon, CVPR
// 2001): offsets d from the centre, in half diagonals, are straight as d / (1 + L |d|^2). So that L
// does not take the marker along when it changes, the homography goes to what the straight image
// looks like at the marker's centre: displaced, turned and scaled to agree with the image there.
//
// Edges need not be where the marker's geometry has them: a tone curve, overexposure or a print's
// ink moves every edge by about the same length. The square shrinks when the disk grows, so that
// the marker itself shows by how much.
class StagView {
public:
    static constexpr int parameters = 10;  // 8 of the homography, and:
    static constexpr int distortion_parameter = 8, shift_parameter = 9;
    using Parameters = Eigen::Matrix<double, parameters, 1>;
    using Derivatives = Eigen::Matrix<double, 2, parameters>;

    // `start` has 1 as its last number.
    StagView(const Homography& start, const cv::Size& image)
        : image_from_marker_(start),
          image_centre_((image.width - 1) / 2.0, (image.height - 1) / 2.0),
          half_diagonal_px_(std::hypot(image.width, image.height) / 2.0),
          marker_centre_(offset(start.col(2).hnormalized())) {}

    double distortion() const { return distortion_; }
    double edge_shift_px() const { return edge_shift_px_; }  // towards the light

    Eigen::Vector2d pixel(const Eigen::Vector2d& point) const {
        const Eigen::Vector2d straight = (image_from_marker_ * point.homogeneous()).hnormalized();
        return image_centre_ + half_diagonal_px_ * bent(offset(straight), distortion_);
    }

    // Of pixel(point) by the homography's first eight numbers, row by row, by the distortion, and
    // by the edges' shift (nothing).
    Derivatives derivatives(const Eigen::Vector2d& point) const {
        const Eigen::Vector3d whole = image_from_marker_ * point.homogeneous();
        const Eigen::Vector2d straight = whole.hnormalized(), d = offset(straight);
        const Eigen::RowVector3d row = point.homogeneous().transpose() / whole.z();
        const Eigen::RowVector3d none = Eigen::RowVector3d::Zero();
        Eigen::Matrix<double, 2, 8> of_homography;
        of_homography << row, none, -straight.x() * row.head<2>(),  //
            none, row, -straight.y() * row.head<2>();
        const Eigen::Vector2d seen = bent(d, distortion_);
        const Eigen::Matrix2d turn =
            slope(seen, distortion_).inverse() * slope(marker_centre_, distortion_);
        constexpr double little = 1e-5;
        const Eigen::Vector2d by_distortion = (bent(d, distortion_ + little) - seen) / little;
        Derivatives all;
        all << turn * of_homography, half_diagonal_px_ * by_distortion, Eigen::Vector2d::Zero();
        return all;
    }

    StagView moved(const Parameters& step) const {
        StagView view = *this;
        for (int i = 0; i < 8; ++i)
            view.image_from_marker_(i / 3, i % 3) += step[i];
        view.distortion_ += step[distortion_parameter];
        view.edge_shift_px_ += step[shift_parameter];
        return view;
    }

private:
    Eigen::Vector2d offset(const Eigen::Vector2d& pixel) const {
        return (pixel - image_centre_) / half_diagonal_px_;
    }
    static Eigen::Vector2d straightened(const Eigen::Vector2d& d, double distortion) {
        return d / (1.0 + distortion * d.squaredNorm());
    }
    // Of straightened(d).
    static Eigen::Matrix2d slope(const Eigen::Vector2d& d, double distortion) {
        const double scale = 1.0 / (1.0 + distortion * d.squaredNorm());
        return scale * Eigen::Matrix2d::Identity() -
               2.0 * distortion * scale * scale * d * d.transpose();
    }
    // Where an offset of the homography's image is seen; not finite where nothing is.
    Eigen::Vector2d bent(const Eigen::Vector2d& d, double distortion) const {
        const Eigen::Vector2d straight = straightened(marker_centre_, distortion) +
                                         slope(marker_centre_, distortion) * (d - marker_centre_);
        return 2.0 * straight / (1.0 + std::sqrt(1.0 - 4.0 * distortion * straight.squaredNorm()));
    }

    Homography image_from_marker_;
    Eigen::Vector2d image_centre_;
    double half_diagonal_px_;
    Eigen::Vector2d marker_centre_;
    double distortion_ = 0.0, edge_shift_px_ = 0.0;
};

// A point of a side or of the circle, in sides of the black square.
struct StagEdge {
    Eigen::Vector2d place;
    Eigen::Vector2d to_light;  // unit normal, from the dark to the light
    double dark_room = 0.0;    // free of other edges on each side of it, along the normal
    double light_room = 0.0;
    double room_along = 0.0;  // to the next corner
};

// Evenly along the four sides and around the circle, where the code leaves the circle room.
std::vector<StagEdge> stag_edges(StagCode code);

// An edge where the image has it, compared with where the view has it.
struct MeasuredEdge {
    Eigen::Vector2d normal;  // unit, in the image, from the dark to the light
    double offset_px = 0.0;  // along it, from view.pixel(place) and the view's shift
};

// From the grey profile along the edge's normal, `reach_px` to either side at most: with the levels
// of both its ends, the area under it says where a step between them would be. A symmetric blur
// does not change that. `contrast` is the marker's; nothing for an edge of less than a third of it,
// one too near another for a profile, and one not wholly in the image (CV_32FC1).
std::optional<MeasuredEdge> measure_edge(const cv::Mat& image, const StagView& view,
                                         const StagEdge& edge, double reach_px, double contrast);

}  // namespace etalon
