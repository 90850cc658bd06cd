#include "calib/camera/distortion.h"

#include <Eigen/Geometry>  // homogeneous()
#include <Eigen/LU>

namespace etalon {

Distorted distort_before_tilt(const Distortion& d, const Eigen::Vector2d& undistorted) {
    const double x = undistorted.x(), y = undistorted.y();
    const double xx = x * x, yy = y * y, xy2 = 2.0 * x * y;
    const double s = xx + yy;  // r^2; primes are derivatives with respect to it
    const double numerator = 1.0 + s * (d.k1 + s * (d.k2 + s * (d.k3 + s * d.k7)));
    const double numerator_prime = d.k1 + s * (2.0 * d.k2 + s * (3.0 * d.k3 + s * 4.0 * d.k7));
    const double denominator = 1.0 + s * (d.k4 + s * (d.k5 + s * d.k6));
    const double denominator_prime = d.k4 + s * (2.0 * d.k5 + s * 3.0 * d.k6);
    const double radial = numerator / denominator;
    const double radial_prime = (numerator_prime - radial * denominator_prime) / denominator;
    const double prism_x_prime = d.s1 + 2.0 * d.s2 * s;
    const double prism_y_prime = d.s3 + 2.0 * d.s4 * s;

    Distorted result;
    result.point << x * radial + d.p1 * xy2 + d.p2 * (s + 2.0 * xx) + s * (d.s1 + s * d.s2),
        y * radial + d.p1 * (s + 2.0 * yy) + d.p2 * xy2 + s * (d.s3 + s * d.s4);
    const double shared = xy2 * radial_prime + 2.0 * (d.p1 * x + d.p2 * y);
    result.jacobian << radial + 2.0 * xx * radial_prime + 2.0 * d.p1 * y + 6.0 * d.p2 * x +
                           2.0 * x * prism_x_prime,
        shared + 2.0 * y * prism_x_prime, shared + 2.0 * x * prism_y_prime,
        radial + 2.0 * yy * radial_prime + 6.0 * d.p1 * y + 2.0 * d.p2 * x +
            2.0 * y * prism_y_prime;
    result.denominator = denominator;
    return result;
}

Distorted apply_tilt(const Eigen::Matrix3d& tilt, const Distorted& before) {
    const Eigen::Vector3d h = tilt * before.point.homogeneous();
    Distorted result = before;
    result.tilt_depth = h.z();
    result.point = h.head<2>() / h.z();
    const Eigen::Matrix2d of_tilt =
        (tilt.topLeftCorner<2, 2>() - result.point * tilt.bottomLeftCorner<1, 2>()) / h.z();
    result.jacobian = of_tilt * before.jacobian;
    return result;
}

Eigen::Matrix3d tilt_matrix(double tau_x, double tau_y) {
    const double cx = std::cos(tau_x), sx = std::sin(tau_x);
    const double cy = std::cos(tau_y), sy = std::sin(tau_y);
    Eigen::Matrix3d about_x, about_y, onto_sensor;
    about_x << 1, 0, 0, 0, cx, sx, 0, -sx, cx;
    about_y << cy, 0, -sy, 0, 1, 0, sy, 0, cy;
    const Eigen::Matrix3d rotation = about_y * about_x;
    onto_sensor << rotation(2, 2), 0, -rotation(0, 2), 0, rotation(2, 2), -rotation(1, 2), 0, 0, 1;
    return onto_sensor * rotation;
}

Distorted distort(const Distortion& distortion, const Eigen::Vector2d& undistorted) {
    Distorted before = distort_before_tilt(distortion, undistorted);
    if (distortion.tau_x == 0.0 && distortion.tau_y == 0.0)
        return before;
    return apply_tilt(tilt_matrix(distortion.tau_x, distortion.tau_y), before);
}

}  // namespace etalon
