// From rays to the plane on which a camera's distortion works, and back: the ideal projections that
// lens models are built on. All are symmetric about the optical axis,
//
//     m = g (X, Y),    with R^2 = X^2 + Y^2, d^2 = R^2 + Z^2 and g one of
//
//     perspective       1 / Z                               Z > 0
//     telecentric       1 (m in mm)                         Z > 0
//     equidistant       theta / R                           below 180 degrees
//     stereographic     2 / (d + Z)                         below 180 degrees
//     field of view     atan2(2 R tan(a/2), Z) / (R a)      below 180 degrees
//     unified           1 / (Z + a d)                       Z > -a d; for a > 1 Z > -d / a
//     extended unified  1 / (b e + (1 - b) Z)               Z > -w(b) e, e^2 = a R^2 + Z^2
//     double sphere     1 / (b e + (1 - b)(a d + Z))        a d + Z > -w(b) e,
//                                                           e^2 = R^2 + (a d + Z)^2
//
// where w(c) is c / (1 - c) or its inverse, whichever is below 1. Up to that limit |m| grows with
// the angle theta to the axis. Those of more parameters are below. Tools: docs/files.md.
//
// Sources: equidistant, Kannala and Brandt, PAMI 28 (2006) 1335; stereographic, mrcal; field of
// view, Devernay and Faugeras, MVA 13 (2001) 14; unified, Mei and Rives, ICRA 2007; extended
// unified, Khomutenko, Garcia and Martinet, RA-L 1 (2016) 137; double sphere, Usenko, Demmel and
// Cremers, 3DV 2018, whose own limit, on Z / d, is up to some degrees stricter.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace etalon {

enum class Projection {
    perspective,  // through one point, the lens: (X/Z, Y/Z)
    telecentric,  // parallel to the axis (object-space telecentric): (X, Y) in mm
    equidistant,
    stereographic,
    field_of_view,     // a: the angle of view omega, 0..pi rad; 0 is perspective
    unified,           // a: xi >= 0; 0 is perspective, 1 half of stereographic
    extended_unified,  // a: beta > 0, b: alpha 0..1
    double_sphere,     // a: xi -1..1, -1 excluded, b: alpha 0..1
    polynomial,        // with a table, as those below
    cahvor,
    splined_stereographic,
};

struct LensTable;

struct LensProjection {
    Projection kind = Projection::perspective;
    double a = 0.0, b = 0.0;
    std::shared_ptr<const LensTable> table = {};  // shared by all copies; nothing for most kinds

    bool operator==(const LensProjection& other) const;
    // Whether planes are imaged as planes.
    bool is_flat() const {
        return kind == Projection::perspective || kind == Projection::telecentric;
    }
    // By which normalised coordinates tell rays apart: (X/Z, Y/Z), or (X, Y) of a telecentric one.
    Projection of_normalised() const {
        return kind == Projection::telecentric ? kind : Projection::perspective;
    }
};

// What files and people call a projection and its parameters ("" where it has none).
struct ProjectionName {
    Projection kind;
    const char* name;
    std::array<const char*, 2> parameters;         // of a and b
    std::array<const char*, 6> coefficients = {};  // of the table's; null behind the last
};
std::span<const ProjectionName> projection_names();
const ProjectionName& name_of(Projection kind);
bool has_table(Projection kind);

// The parameters and coefficients that have names, with their values.
std::vector<std::pair<const char*, double>> named_parameters(const LensProjection& projection);

// The radius on the plane at which the projection ends; infinity where it does not, and where it
// ends at no circle, which only from_plane() tells.
double plane_limit(const LensProjection& projection);

// d|m| / d theta on the axis, which times f_x is the image distance in px: 1 of most, 1 / (1 + a)
// of unified and double sphere, 2 tan(a/2) / a of field of view.
double scale_on_axis(const LensProjection& projection);

// Where a ray is imaged, in units of the focal length (telecentric: mm), with its derivatives.
template <typename Scalar>
struct BasicOnPlane {
    using Vector2 = Eigen::Matrix<Scalar, 2, 1>;
    Vector2 point;
    Eigen::Matrix<Scalar, 2, 3> by_ray;
    Vector2 by_a = Vector2::Zero(), by_b = Vector2::Zero();  // zero where there is no parameter
};
using OnPlane = BasicOnPlane<double>;

// Whether the parameters are finite and within their ranges and the table is there; throws
// NumericalError if not.
bool is_possible(const LensProjection& projection);
void require_possible(const LensProjection& projection);

// Of a point of the ray in the camera's frame, of any length (telecentric: in mm). Nothing where
// the projection has no image of it, or for what is not finite. Tens of ns.
std::optional<OnPlane> onto_plane(const LensProjection& projection, const Eigen::Vector3d& ray);

// The same with other parameters, and with these and the ray in any precision: double or long
// double (with a table always double).
template <typename Scalar>
std::optional<BasicOnPlane<Scalar>> onto_plane(const LensProjection& projection, Scalar a, Scalar b,
                                               const Eigen::Matrix<Scalar, 3, 1>& ray);

// The inverse: the ray that is imaged there, of length 1 or, of a perspective or telecentric
// camera, with Z = 1. Nothing where no ray is. Right to some 1e-15 relative to the radius plus 1.
std::optional<Eigen::Vector3d> from_plane(const LensProjection& projection,
                                          const Eigen::Vector2d& point);

// Projections of more than two numbers: a polynomial (MATLAB's fisheye; Scaramuzza, Martinelli and
// Siegwart, ICVS 2006), CAHVOR (Yakimovsky and Cunningham, CGIP 7 (1978) 195, and Gennery, IJCV 68
// (2006) 239, in mrcal's form) and mrcal's splined stereographic model (its documentation "lens
// models"). All copies of a camera share their coefficients.

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

}  // namespace etalon
