// From points in the camera's frame to pixels, with the derivatives by the point and by all
// parameters of the camera, in any precision. Internal to calibrating: its tests hold the formulas
// to those of calib/camera/distortion.h, which is the one to use for everything else.
#pragma once

#include <Eigen/Geometry>  // homogeneous()
#include <Eigen/LU>        // determinant()

#include "calib/camera/lens_projection.h"

namespace etalon {

// fx fy cx cy, the distortion in OpenCV's order, k7, the projection's a and b, and the skew.
inline constexpr int camera_parameter_count = 22;

// `of`: d pixel / d what the pixel is of, a point (3) or an undistorted point of the plane (2).
template <typename Scalar, int Size>
struct ModelPixel {
    Eigen::Matrix<Scalar, 2, 1> pixel;
    Eigen::Matrix<Scalar, 2, Size> of;
    bool is_regular;  // invertible here, on this side of every pole, and imaged at all
};

template <typename Scalar>
class PixelModel {
public:
    using Vector2 = Eigen::Matrix<Scalar, 2, 1>;
    using Matrix2 = Eigen::Matrix<Scalar, 2, 2>;
    using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;
    using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
    using Parameters = Eigen::Matrix<Scalar, camera_parameter_count, 1>;
    using OfParameters = Eigen::Matrix<Scalar, 2, camera_parameter_count>;

    PixelModel(const LensProjection& projection, const Parameters& parameters)
        : projection_(projection), p_(parameters) {
        using std::cos, std::sin;
        const Scalar cx = cos(p_[16]), sx = sin(p_[16]), cy = cos(p_[17]), sy = sin(p_[17]);
        Matrix3 about_x, about_y, of_x, of_y;
        about_x << 1, 0, 0, 0, cx, sx, 0, -sx, cx;
        about_y << cy, 0, -sy, 0, 1, 0, sy, 0, cy;
        of_x << 0, 0, 0, 0, -sx, cx, 0, -cx, -sx;
        of_y << -sy, 0, -cy, 0, 0, 0, cy, 0, -sy;
        const Matrix3 rotation = about_y * about_x;
        tilt_ = onto_sensor(rotation, 1) * rotation;
        tilt_of_x_ = change(rotation, about_y * of_x);
        tilt_of_y_ = change(rotation, of_y * about_x);
        projection_.a = static_cast<double>(p_[19]);
        projection_.b = static_cast<double>(p_[20]);
        is_tilted_ = p_[16] != 0 || p_[17] != 0;
        is_possible_ = etalon::is_possible(projection_);
    }

    ModelPixel<Scalar, 3> operator()(const Vector3& p) const { return evaluate(p, nullptr); }

    ModelPixel<Scalar, 3> with_derivatives(const Vector3& p, OfParameters& of_parameters) const {
        return evaluate(p, &of_parameters);
    }

    // Of an undistorted point of the projection's plane.
    ModelPixel<Scalar, 2> on_plane(const Vector2& u) const { return distorted(u, nullptr); }

    const Parameters& parameters() const { return p_; }

private:
    // The map of points on the sensor's rotated plane along the axis; `one` is 0 in a derivative.
    static Matrix3 onto_sensor(const Matrix3& rotation, Scalar one) {
        Matrix3 map;
        map << rotation(2, 2), 0, -rotation(0, 2), 0, rotation(2, 2), -rotation(1, 2), 0, 0, one;
        return map;
    }
    static Matrix3 change(const Matrix3& rotation, const Matrix3& of_rotation) {
        return onto_sensor(of_rotation, 0) * rotation + onto_sensor(rotation, 1) * of_rotation;
    }

    ModelPixel<Scalar, 3> evaluate(const Vector3& p, OfParameters* of_parameters) const {
        const auto plane =
            is_possible_ ? onto_plane<Scalar>(projection_, p_[19], p_[20], p) : std::nullopt;
        if (!plane)
            return {Vector2::Zero(), Eigen::Matrix<Scalar, 2, 3>::Zero(), false};
        const ModelPixel<Scalar, 2> seen = distorted(plane->point, of_parameters);
        if (of_parameters) {
            of_parameters->col(19) = seen.of * plane->by_a;
            of_parameters->col(20) = seen.of * plane->by_b;
        }
        return {seen.pixel, seen.of * plane->by_ray, seen.is_regular};
    }

    ModelPixel<Scalar, 2> distorted(const Vector2& u, OfParameters* of_parameters) const {
        const Scalar x = u.x(), y = u.y(), xx = x * x, yy = y * y, xy2 = 2 * x * y, s = xx + yy;
        const Scalar k1 = p_[4], k2 = p_[5], p1 = p_[6], p2 = p_[7], k3 = p_[8];
        const Scalar k4 = p_[9], k5 = p_[10], k6 = p_[11];
        const Scalar s1 = p_[12], s2 = p_[13], s3 = p_[14], s4 = p_[15], k7 = p_[18];
        const Scalar over = 1 + s * (k4 + s * (k5 + s * k6));
        const Scalar radial = (1 + s * (k1 + s * (k2 + s * (k3 + s * k7)))) / over;
        const Scalar radial_prime = (k1 + s * (2 * k2 + s * (3 * k3 + s * 4 * k7)) -
                                     radial * (k4 + s * (2 * k5 + s * 3 * k6))) /
                                    over;
        const Vector2 before(x * radial + p1 * xy2 + p2 * (s + 2 * xx) + s * (s1 + s * s2),
                             y * radial + p1 * (s + 2 * yy) + p2 * xy2 + s * (s3 + s * s4));
        const Scalar shared = xy2 * radial_prime + 2 * (p1 * x + p2 * y);
        const Scalar prism_x = s1 + 2 * s2 * s, prism_y = s3 + 2 * s4 * s;
        Matrix2 of_ray;
        of_ray << radial + 2 * xx * radial_prime + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x,
            shared + 2 * y * prism_x, shared + 2 * x * prism_y,
            radial + 2 * yy * radial_prime + 6 * p1 * y + 2 * p2 * x + 2 * y * prism_y;

        Matrix2 focal;
        focal << p_[0], p_[21], 0, p_[1];
        Vector2 point = before;
        Matrix2 to_pixels = focal;
        Scalar depth = 1;
        if (is_tilted_) {
            const Eigen::Matrix<Scalar, 3, 1> tilted = tilt_ * before.homogeneous();
            depth = tilted.z();
            point = tilted.template head<2>() / depth;
            to_pixels = focal * ((tilt_.template topLeftCorner<2, 2>() -
                                  point * tilt_.template bottomLeftCorner<1, 2>()) /
                                 depth);
        }
        ModelPixel<Scalar, 2> result;
        result.pixel = focal * point + p_.template segment<2>(2);
        result.of = to_pixels * of_ray;
        result.is_regular =
            over > 0 && depth > 0 && result.of.determinant() > 0 && result.pixel.allFinite();
        if (of_parameters) {
            auto& of = *of_parameters;
            of.template leftCols<4>() << point.x(), 0, 1, 0, 0, point.y(), 0, 1;
            const Vector2 of_k1 = to_pixels * (u * (s / over));
            of.col(4) = of_k1;
            of.col(5) = s * of_k1;
            of.col(6) = to_pixels * Vector2(xy2, s + 2 * yy);
            of.col(7) = to_pixels * Vector2(s + 2 * xx, xy2);
            of.col(8) = s * s * of_k1;
            of.template middleCols<3>(9) =
                -radial * of_k1 * Eigen::Matrix<Scalar, 1, 3>(1, s, s * s);
            of.col(12) = s * to_pixels.col(0);
            of.col(13) = s * of.col(12);
            of.col(14) = s * to_pixels.col(1);
            of.col(15) = s * of.col(14);
            of.col(16) = focal * moved(tilt_of_x_, before, point, depth);
            of.col(17) = focal * moved(tilt_of_y_, before, point, depth);
            of.col(18) = s * of.col(8);
            of.col(21) << point.y(), 0;
        }
        return result;
    }

    static Vector2 moved(const Matrix3& of_tilt, const Vector2& before, const Vector2& point,
                         Scalar depth) {
        const Eigen::Matrix<Scalar, 3, 1> change = of_tilt * before.homogeneous();
        return (change.template head<2>() - point * change.z()) / depth;
    }

    LensProjection projection_;
    Parameters p_;
    bool is_possible_, is_tilted_;
    Matrix3 tilt_, tilt_of_x_, tilt_of_y_;
};

}  // namespace etalon
