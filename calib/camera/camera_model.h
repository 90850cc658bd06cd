// What is known about a camera: projection, intrinsics, distortion, lens and sensor. Plain data.
// Without lens and sensor sections (OpenCV, ROS) it is a sharp pinhole: no blur or noise is
// invented.
#pragma once

#include <algorithm>

#include "calib/camera/lens_projection.h"
#include "core/image/image.h"

namespace etalon {

// Pixels, centres at integers, (0, 0) the top-left pixel's. Telecentric: fx and fy are px per mm. A
// distorted point m of the plane is the pixel (fx m_x + skew m_y + cx, fy m_y + cy).
struct Intrinsics {
    double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;
    double skew = 0.0;  // not 0 where rows and columns do not meet at right angles

    Eigen::Vector2d on_plane(const Eigen::Vector2d& pixel) const {
        const double y = (pixel.y() - cy) / fy;
        return {(pixel.x() - cx - skew * y) / fx, y};
    }
    Eigen::Matrix2d pixel_by_plane() const {
        return (Eigen::Matrix2d() << fx, skew, 0.0, fy).finished();
    }
    void zoom(double factor) {
        fx *= factor;
        fy *= factor;
        skew *= factor;
    }
    bool operator==(const Intrinsics&) const = default;
};

// OpenCV's model, on the plane of the projection: radial rational (k1..k6), tangential (p1, p2),
// thin prism (s1..s4) and sensor tilt (tau_x, tau_y, rad); and k7, of r^8 in the radial numerator,
// which Kannala and Brandt's fourth coefficient is.
struct Distortion {
    double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;
    double s1 = 0, s2 = 0, s3 = 0, s4 = 0, tau_x = 0, tau_y = 0, k7 = 0;

    static constexpr std::size_t count = 15;
    std::array<double, count> coefficients() const {
        return {k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y, k7};
    }
    static Distortion of(const std::array<double, count>& c) {
        return {c[0], c[1], c[2],  c[3],  c[4],  c[5],  c[6], c[7],
                c[8], c[9], c[10], c[11], c[12], c[13], c[14]};
    }
    // OpenCV's own, without k7.
    std::array<double, 14> in_opencv_order() const {
        return {k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y};
    }
    bool is_zero() const { return *this == Distortion{}; }
    bool operator==(const Distortion&) const = default;
};

// Estimated covariance of some of the parameters, by name ("fx", "k1", ...), symmetric.
struct ParameterCovariance {
    std::vector<std::string> order;
    Eigen::MatrixXd matrix;
    bool operator==(const ParameterCovariance&) const = default;
};

// How the lens spreads a point. Radii in px along x.
struct PointSpread {
    enum class Kind {
        ideal,     // Airy pattern of the working f-number, and geometric defocus
        gaussian,  // sigma_px, in place of the Airy pattern, and geometric defocus
        measured,  // the profile, in place of the Airy pattern and of defocus
        wave,      // wave-optical: diffraction and defocus together
    };
    Kind kind = Kind::ideal;
    double sigma_px = 0.0;
    // (radius, energy per area), radii ascending from 0, joined by straight lines, nothing beyond
    // the last. The density's scale does not matter: the energy is taken as 1.
    std::vector<std::pair<double, double>> profile = {};
    bool operator==(const PointSpread&) const = default;
};

// A thin lens with a circular aperture, or a telecentric one.
struct Lens {
    double f_number = 0.0;  // perspective: the engraved N = f/d
    double focus_distance_mm = std::numeric_limits<double>::infinity();  // lens to sharp plane
    double wavelength_nm = 0.0;
    PointSpread psf;
    double object_na = 0.0;  // telecentric: sine of the half angle of the cone of rays
    bool operator==(const Lens&) const = default;
};

// Code value from linear radiance.
struct Transfer {
    enum class Kind { linear, rec709, table };
    Kind kind = Kind::linear;
    std::vector<std::pair<double, double>> table;  // (radiance, code / full scale), both ascending
    bool operator==(const Transfer&) const = default;
};

// Part of the light that reaches a pixel, relative to the axis.
struct Illumination {
    enum class Kind {
        uniform,
        cos4,        // of the field angle
        polynomial,  // 1 + c1 r^2 + c2 r^4 + c3 r^6, r from the principal point (cx, cy) in units
                     // of half the image's diagonal, hypot(width, height) / 2 px
    };
    Kind kind = Kind::uniform;
    std::array<double, 3> polynomial = {};
    bool operator==(const Illumination&) const = default;
};

struct Sensor {
    double pixel_pitch_um = 0.0;  // along x; along y it is pixel_pitch_um * fx / fy
    int bits = 8;                 // 1..16, full scale 2^bits - 1
    Transfer transfer;
    double black_dn = 0.0;       // code value without light
    double gain_e_per_dn = 0.0;  // electrons per code value; 0: no shot noise
    double read_noise_e = 0.0;   // electrons; with gain 0 it must be 0
    Illumination illumination = {};
    Mosaic mosaic = Mosaic::none;
    // Signal of the red, green and blue pixels for a gray radiance under the light in use, relative
    // to the radiance; only with a mosaic.
    std::array<double, 3> channel_response = {1.0, 1.0, 1.0};
    bool operator==(const Sensor&) const = default;
};

// Standard uncertainties of entries that were measured (`etalon characterise`); nothing where the
// uncertainty is not known, which does not mean that it is zero.
struct CameraUncertainty {
    std::optional<double> f_number, focus_distance_mm, psf_sigma_px;
    std::optional<double> black_dn, gain_e_per_dn, read_noise_e;
    std::optional<std::array<double, 3>> illumination;  // of the polynomial's coefficients
    // Of each density of PointSpread::profile and of each code of Transfer::table, in their
    // units; empty where not known.
    std::vector<double> psf_density, transfer_code;
    bool operator==(const CameraUncertainty&) const = default;
};

struct CameraModel {
    std::string serial;  // empty: not known
    int width = 0, height = 0;
    LensProjection projection;
    Intrinsics intrinsics;
    Distortion distortion;
    std::optional<ParameterCovariance> covariance;
    std::optional<Lens> lens;  // present only together with a sensor
    std::optional<Sensor> sensor;
    std::optional<CameraUncertainty> standard_uncertainty;
    bool operator==(const CameraModel&) const = default;
};

// v = fx * pitch, of a wide lens times scale_on_axis(); of a camera with a sensor section and a
// point of view.
double image_distance_mm(const CameraModel& camera);

// The thin lens in numbers, from the image distance that the calibration measured. A wide lens is
// one near its axis; elsewhere its pupil and focus are as docs/rendering.md says.
struct ThinLens {
    double image_distance_mm;     // v, as above
    double focal_length_mm;       // 1/f = 1/z_f + 1/v
    double aperture_diameter_mm;  // d = f/N
    double working_f_number;      // N_w = v/d
    double inverse_focus_per_mm;  // 1/z_f; 0 when focused at infinity
};

// Skew over fx: the squareness error of rows and columns, rad. The point spread, round on the
// sensor, is rendered round in pixels: off by at most 255 * 0.242 / 2 times the angle, 0.03 gray.
inline constexpr double max_skew_of_a_lens = 0.001;
bool has_lens_with(const Intrinsics& intrinsics);

// Throws NumericalError for a telecentric camera, without lens and sensor sections, with more skew,
// or when pitch, f-number or focus distance is not positive.
ThinLens thin_lens(const CameraModel& camera);

// The telecentric lens in numbers: magnification m = fx * pitch.
struct TelecentricLens {
    double magnification;
    double cone_tangent;      // of the half angle of the cone of rays, tan(asin(object_na))
    double working_f_number;  // N_w = m / (2 object_na)
    double focus_distance_mm;
};

// Throws NumericalError for a perspective camera, one without lens and sensor sections, with such a
// skew or a sensor tilt, or with an impossible pitch, focus distance or object_na (0, 1).
TelecentricLens telecentric_lens(const CameraModel& camera);

// Of either lens; throws as they do.
double working_f_number(const CameraModel& camera);

// Radius in px along x of the blur disk of a point at depth z_mm > 0; along y times fy/fx:
//     fx * d/2 * |1/z - 1/z_f|                (of a wide lens on the axis, times scale_on_axis())
//     fx * tan(asin(object_na)) * |z - z_f|   (telecentric)
// Zero without a lens section or with a measured point spread, which holds its blur. Throws
// NumericalError when z_mm is not positive.
double blur_radius_px(const CameraModel& camera, double z_mm);

// 1 + c1 s + c2 s^2 + c3 s^3 at the squared radius s >= 0 (see Illumination).
double polynomial_illumination(const std::array<double, 3>& coefficients, double s);

// The squared radius of a pixel position in the units of that polynomial.
double illumination_radius_squared(const CameraModel& camera, const Eigen::Vector2d& pixel);

// The polynomial's smallest value over the image, pixels' outer corners included. NaN when a
// coefficient is.
double least_polynomial_illumination(const CameraModel& camera);

// Whether straight lines are imaged straight: a flat projection without distortion.
bool images_lines_straight(const CameraModel& camera);

// For what is written for perspective cameras only. Throws NumericalError, naming `purpose`, for
// any other.
void require_perspective(const CameraModel& camera, const char* purpose);

// The same for what needs rays from one point, as perspective cameras and wide lenses have them.
void require_point_of_view(const CameraModel& camera, const char* purpose);

// SHA-256 of a camera's file and of the tables that it names, as read into `camera`. Throws
// ConfigError when the file cannot be read.
std::string camera_sha256(const std::filesystem::path& file, const CameraModel& camera);

// The names of a camera's parameters in files and covariances: fx fy cx cy, then the distortion
// coefficients, OpenCV's fourteen first and in its order, then those of the projections, and skew.

inline constexpr std::array<const char*, 4> intrinsic_names{"fx", "fy", "cx", "cy"};
inline constexpr std::array<const char*, 15> distortion_names{
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y", "k7"};
inline constexpr std::array<const char*, 4> projection_parameter_names{"xi", "omega", "beta",
                                                                       "alpha"};

inline bool is_camera_parameter(std::string_view name) {
    const auto holds = [name](const auto& names) { return std::ranges::count(names, name) > 0; };
    return name == "skew" || holds(intrinsic_names) || holds(distortion_names) ||
           holds(projection_parameter_names);
}

}  // namespace etalon
