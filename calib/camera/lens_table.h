// Projections that two numbers do not describe: a polynomial (MATLAB's fisheye), CAHVOR and
// mrcal's splined stereographic model. Their coefficients are found here with what follows from
// them, once and for all copies of a camera.
//
// Sources: Scaramuzza, Martinelli and Siegwart, ICVS 2006, in the form of MATLAB's
// fisheyeIntrinsics; Yakimovsky and Cunningham, CGIP 7 (1978) 195, and Gennery, IJCV 68 (2006) 239,
// in the form of mrcal (its documentation "lens models"), which has the splined one, too.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "calib/camera/lens_projection.h"

namespace etalon {

struct LensTable {
    // polynomial: a2 a3 a4 shear; cahvor: alpha beta r0 r1 r2 linearity; splined_stereographic: the
    // control points, row by row, x and y of each.
    std::vector<double> coefficients;
    int order = 0, columns = 0, rows = 0;  // of the splined one
    double field_of_view_deg = 0.0;        // of the splined one along x

    // What follows from them.
    double limit = std::numeric_limits<double>::infinity();  // radius at which it folds
    std::vector<double> folds;  // the same of the splined one, by direction; empty: nowhere

    bool operator==(const LensTable&) const = default;
};

// These throw NumericalError for numbers that are not finite or beyond 1e12, which no file of ours
// may have either, and for what no lens is.

// With the point q of the plane, q = (r cos, r sin), a ray of that azimuth has
//     R : Z = r : 1 + a2 r^2 + a3 r^3 + a4 r^4,    m = (q_x, shear q_x + q_y).
// It ends where its angle to the axis stops to grow with r, at 1 = a2 r^2 + 2 a3 r^3 + 3 a4 r^4.
LensProjection polynomial_projection(double a2, double a3, double a4, double shear);

// About the axis o = (sin(alpha) cos(beta), sin(beta), cos(alpha) cos(beta)) a ray is bent from the
// tangent t of its angle to t' = c (1 + r0 + r1 c^2 + r2 c^4) and then seen in perspective. c is t
// for linearity 1, which is CAHVOR, and tan(linearity theta) / linearity, theta or sin(linearity
// theta) / linearity for positive, zero and negative linearity, which is CAHVORE with an entrance
// pupil that stays where it is. It ends where t' stops to grow, and at Z = 0 of the bent ray.
LensProjection cahvor_projection(double alpha, double beta, double r0, double r1, double r2,
                                 double linearity = 1.0);

// The stereographic point u of a ray, plus a uniform B-spline of order 2 or 3 (quadratic or cubic):
//     m = u + du(u),    du by columns x rows control points about the axis,
// whose spacing follows from the field of view along x, 0 to 360 degrees: u_x = +-2 tan(fov / 4)
// lies 1 (cubic) or 1/2 (quadratic) spacing from the last control point. It ends there, along y as
// far from the last rows, and where it first folds on the way out from the axis (looked for in 256
// directions). 4 to 1000 columns and rows.
LensProjection splined_projection(int order, int columns, int rows, double field_of_view_deg,
                                  std::vector<double> control_points);

// The part about numbers.
void check_coefficients(std::span<const double> coefficients);

// As onto_plane() and from_plane() of calib/camera/lens_projection.h, for a projection of each
// kind. The first two are right to rounding; the splined one is inverted by Newton's method in some
// us.
std::optional<OnPlane> polynomial_onto_plane(const LensTable& table, const Eigen::Vector3d& ray);
std::optional<Eigen::Vector3d> polynomial_from_plane(const LensTable& table,
                                                     const Eigen::Vector2d& point);
std::optional<OnPlane> cahvor_onto_plane(const LensTable& table, const Eigen::Vector3d& ray);
std::optional<Eigen::Vector3d> cahvor_from_plane(const LensTable& table,
                                                 const Eigen::Vector2d& point);
std::optional<OnPlane> splined_onto_plane(const LensTable& table, const Eigen::Vector3d& ray);
std::optional<Eigen::Vector3d> splined_from_plane(const LensTable& table,
                                                  const Eigen::Vector2d& point);

}  // namespace etalon
