#include "calib/registration/registration.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>

#include "calib/registration/stage_motion.h"
#include "core/optimize/least_squares.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::size_t min_poses = 4;

struct XY {
    Rigid camera_from_base, carriage_from_marker;
};

struct PosePair {
    Rigid base_from_carriage, camera_from_marker;
};

// d all pixels / d (X, Y), in standard deviations.
using RegistrationJacobian = Eigen::Matrix<double, Eigen::Dynamic, 12>;

// A motion of the base frame, X' = X Exp(twist), that Y can undo: rotation, then translation.
using Twist = Vector6d;

Eigen::Quaterniond nearest_rotation(const Eigen::Matrix3d& m) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d product = svd.matrixU() * svd.matrixV().transpose();
    const double sign = product.determinant() < 0.0 ? -1.0 : 1.0;
    return Eigen::Quaterniond(Eigen::Matrix3d(
        svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose()));
}

// The equations of registration_seed(), three rows each.
struct SeedEquation {
    Eigen::Matrix<double, 3, 15> row = Eigen::Matrix<double, 3, 15>::Zero();
    Eigen::Vector3d value;

    // With d (M v) / d M, column by column.
    SeedEquation(const Eigen::Vector3d& v, const Eigen::Vector3d& of_camera) : value(of_camera) {
        for (int column = 0; column < 3; ++column)
            row.middleCols<3>(3 * column) = v[column] * Eigen::Matrix3d::Identity();
    }
};

// Rotations near half a turn have no sure sign, tiny ones are noise: both are left out.
void add_rotation(const PosePair& one, const PosePair& two, std::vector<SeedEquation>& equations) {
    constexpr double arm_mm = 100.0;  // weighs a rotation like the motion of a marker's edge
    const Eigen::Vector3d base = rotation_vector(two.base_from_carriage.rotation *
                                                 one.base_from_carriage.rotation.conjugate());
    if (base.norm() < 0.01 || base.norm() > 2.8)
        return;
    equations.emplace_back(arm_mm * base,
                           arm_mm * rotation_vector(two.camera_from_marker.rotation *
                                                    one.camera_from_marker.rotation.conjugate()));
}

// Minimum-norm solution in scaled columns: what nothing determines stays zero, and the prior
// decides about it later.
Eigen::Matrix<double, 15, 1> solved(const std::vector<SeedEquation>& equations) {
    Eigen::MatrixXd a(3 * std::ssize(equations), 15);
    Eigen::VectorXd b(3 * std::ssize(equations));
    for (Eigen::Index i = 0; i < std::ssize(equations); ++i) {
        a.middleRows<3>(3 * i) = equations[static_cast<std::size_t>(i)].row;
        b.segment<3>(3 * i) = equations[static_cast<std::size_t>(i)].value;
    }
    Eigen::VectorXd unscale = a.colwise().norm();
    for (double& s : unscale)
        s = s > 0.0 ? 1.0 / s : 0.0;
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
    decomposition.setThreshold(1e-3);
    decomposition.compute(a * unscale.asDiagonal());
    return unscale.asDiagonal() * Eigen::VectorXd(decomposition.solve(b));
}

// Linear in M (camera_from_base's rotation, not yet orthogonal), w = R_Y^T t_Y and t = t_X:
//     M s_i + R_i w + t = t_i            what the marker's origin does
//     M log(S_i S_j^T) = log(R_i R_j^T)  what rotations do
// with (S_i, s_i) = base_from_carriage and (R_i, t_i) = camera_from_marker. Unlike the closed-form
// hand-eye methods it needs no particular set of axes.
XY registration_seed(std::span<const PosePair> poses) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const PosePair& pose : poses)
        centre += pose.base_from_carriage.translation / static_cast<double>(poses.size());
    std::vector<SeedEquation> equations;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const Rigid& camera_from_marker = poses[i].camera_from_marker;
        SeedEquation& position = equations.emplace_back(
            poses[i].base_from_carriage.translation - centre, camera_from_marker.translation);
        position.row.middleCols<3>(9) = camera_from_marker.rotation.toRotationMatrix();
        position.row.middleCols<3>(12).setIdentity();
        if (i > 0)
            add_rotation(poses[i - 1], poses[i], equations);
        if (i > 1)
            add_rotation(poses[0], poses[i], equations);
    }
    const Eigen::Matrix<double, 15, 1> solution = solved(equations);
    XY xy;
    xy.camera_from_base.rotation =
        nearest_rotation(Eigen::Map<const Eigen::Matrix3d>(solution.data()));
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const PosePair& pose : poses)
        sum += (pose.base_from_carriage.rotation.conjugate() *
                xy.camera_from_base.rotation.conjugate() * pose.camera_from_marker.rotation)
                   .toRotationMatrix();
    xy.carriage_from_marker.rotation = nearest_rotation(sum);
    xy.carriage_from_marker.translation =
        xy.carriage_from_marker.rotation * Eigen::Vector3d(solution.segment<3>(9));
    xy.camera_from_base.translation = solution.tail<3>() - xy.camera_from_base.rotation * centre;
    return xy;
}

// A single linear axis has 4; more means that the stage hardly moved.
constexpr int max_freedoms = 4;
// Relative to the largest singular value. The freedoms are exact (no pixel moves at all), so only
// rounding separates them from zero; poorly determined directions are not freedoms.
constexpr double null_singular_value = 1e-9;
// Length that makes rotations of carriage_from_marker comparable with shifts: the size of a marker
// on its carriage.
constexpr double prior_length_mm = 100.0;

Rigid exponential(const Twist& twist) {
    const Eigen::Vector3d w = twist.head<3>();
    const double angle = w.norm();
    const Eigen::Matrix3d k = cross_matrix(w);
    // Below the threshold the next term of the series is under 1e-16.
    const bool small = angle < 1e-4;
    const double first = small ? 0.5 : (1.0 - std::cos(angle)) / (angle * angle);
    const double second = small ? 1.0 / 6.0 : (angle - std::sin(angle)) / (angle * angle * angle);
    const Eigen::Matrix3d v = Eigen::Matrix3d::Identity() + first * k + second * k * k;
    return {rotation_from_vector(w), v * twist.tail<3>()};
}

// Y after the base frame was moved by `twist`: S Y' = Exp(-twist) S Y. For a freedom every S of the
// run gives the same Y'.
Rigid compensated(const Rigid& carriage_from_marker, const Rigid& base_from_carriage,
                  const Twist& twist) {
    return base_from_carriage.inverse() * exponential(-twist) * base_from_carriage *
           carriage_from_marker;
}

// Null vectors of (X, Y) as motions of the base frame: X' = X Exp(twist) has the left perturbation
// (R_X w, R_X v).
Eigen::MatrixXd as_twists(const Eigen::MatrixXd& null, const XY& xy) {
    const Eigen::Matrix3d base_from_camera =
        xy.camera_from_base.rotation.conjugate().toRotationMatrix();
    Eigen::MatrixXd twists(6, null.cols());
    twists.topRows<3>() = base_from_camera * null.topRows<3>();
    twists.bottomRows<3>() = base_from_camera * null.middleRows<3>(3);
    return twists;
}

bool is_shift(const Twist& twist) {
    return twist.head<3>().norm() * 1e6 < twist.tail<3>().norm();
}

Twist with_positive_direction(const Twist& twist) {
    Eigen::Index largest = 0;
    twist.cwiseAbs().maxCoeff(&largest);
    return twist[largest] < 0.0 ? Twist(-twist) : twist;
}

// The null space split into pure shifts and the rest, which is made free of those shifts.
std::vector<Twist> tidy_twists(const Eigen::MatrixXd& null) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(Eigen::MatrixXd(null.topRows<3>()),
                                                Eigen::ComputeFullV);
    const Eigen::MatrixXd combined = null * svd.matrixV();
    std::vector<Twist> shifts, turns;
    for (Eigen::Index k = 0; k < combined.cols(); ++k) {
        Twist twist = combined.col(k);
        if (is_shift(twist)) {
            twist.head<3>().setZero();
            shifts.push_back(with_positive_direction(twist / twist.norm()));
        } else {
            turns.push_back(twist / twist.head<3>().norm());
        }
    }
    if (shifts.size() == 3)  // every shift is free: name them by the base's axes
        for (int k = 0; k < 3; ++k)
            shifts[static_cast<std::size_t>(k)] = Twist::Unit(3 + k);
    // One shift or three: they are orthonormal.
    for (Twist& turn : turns) {
        for (const Twist& shift : shifts)
            turn -= shift * shift.dot(turn);
        shifts.push_back(turn);
    }
    return shifts;
}

// Named by an axis of the base when it is within `cosine` of it.
std::string direction_name(const Eigen::Vector3d& direction, double cosine = 1.0 - 1e-9) {
    for (int k = 0; k < 3; ++k)
        if (std::abs(direction[k]) > cosine)
            return fmt::format("base {}", "xyz"[k]);
    return fmt::format("base direction ({:.4f}, {:.4f}, {:.4f})", direction.x(), direction.y(),
                       direction.z());
}

std::string motion_name(bool is_shift, const std::string& direction) {
    return (is_shift ? "shift along " : "rotation about ") + direction + " between X and Y";
}

Vector6d prior_deviation(const Rigid& nominal, const Rigid& carriage_from_marker) {
    Vector6d deviation = left_difference(nominal, carriage_from_marker);
    deviation.head<3>() *= prior_length_mm;
    return deviation;
}

// d deviation / d amount of each freedom, by central differences.
Eigen::MatrixXd prior_slope(const XY& xy, const std::vector<Twist>& freedoms,
                            const Rigid& base_from_carriage, const Rigid& nominal) {
    constexpr double step = 1e-5;
    Eigen::MatrixXd slope(6, std::ssize(freedoms));
    for (std::size_t k = 0; k < freedoms.size(); ++k) {
        const auto moved = [&](double by) {
            return prior_deviation(nominal, compensated(xy.carriage_from_marker, base_from_carriage,
                                                        by * freedoms[k]));
        };
        slope.col(static_cast<Eigen::Index>(k)) = (moved(step) - moved(-step)) / (2.0 * step);
    }
    return slope;
}

// d pixels / d Y and d pixels / d X as one orthogonal basis sees them: [R_YY R_YX; 0 R_XX].
Eigen::MatrixXd triangle_of(const RegistrationJacobian& jacobian) {
    Eigen::MatrixXd y_first(jacobian.rows(), 12);
    y_first << jacobian.rightCols<6>(), jacobian.leftCols<6>();
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(y_first);
    return qr.matrixQR().topRows<12>().triangularView<Eigen::Upper>();
}

// The motion of the base frame as that of the point in the middle, without the free shifts.
Twist seen_from(const Eigen::Vector3d& middle_mm, Twist twist, const std::vector<Twist>& freedoms) {
    twist.tail<3>() += Eigen::Vector3d(twist.head<3>()).cross(middle_mm);
    for (const Twist& freedom : freedoms)
        if (is_shift(freedom))
            twist.tail<3>() -= freedom.tail<3>() * freedom.tail<3>().dot(twist.tail<3>());
    return twist;
}

PoorlyConstrainedDirection weak_direction(const Vector12d& direction, const Twist& twist_at_middle,
                                          double deviation, double worth_poses) {
    constexpr double within_5_deg = 0.9962;
    const Eigen::Vector3d turn = twist_at_middle.head<3>(), shift = twist_at_middle.tail<3>();
    const bool shifts = shift.norm() > prior_length_mm * turn.norm();
    const double size = shifts ? shift.norm() : turn.norm();
    const std::string name = direction_name((shifts ? shift : turn) / size, within_5_deg);
    return {motion_name(shifts, name), direction / size, deviation * size, worth_poses};
}

// Sets rank and condition number, from the singular values of the column-scaled Jacobian, and gives
// the freedoms: pure shifts first, each with a largest entry of about 1.
std::vector<Twist> find_freedoms(const RegistrationJacobian& jacobian, const XY& xy,
                                 Registration& result) {
    const Vector12d unscale = jacobian.colwise().norm().cwiseInverse();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(jacobian * unscale.asDiagonal(),
                                                Eigen::ComputeThinU | Eigen::ComputeFullV);
    const Eigen::VectorXd& values = svd.singularValues();
    result.rank = static_cast<int>((values.array() > null_singular_value * values[0]).count());
    const int freedoms = 12 - result.rank;
    if (freedoms > max_freedoms)
        throw NumericalError(fmt::format(
            "registration: {} of 12 directions are undetermined; the stage moved too little",
            freedoms));
    result.condition_number = values[0] / values[result.rank - 1];
    if (freedoms == 0)
        return {};
    return tidy_twists(as_twists(unscale.asDiagonal() * svd.matrixV().rightCols(freedoms), xy));
}

// With the name and the direction in (X, Y) that the report shows.
GaugeFreedom gauge_freedom(const Twist& twist, const XY& xy, const Rigid& base_from_carriage) {
    const Eigen::Vector3d w = twist.head<3>(), v = twist.tail<3>();
    const Eigen::Quaterniond& x = xy.camera_from_base.rotation;
    const Eigen::Quaterniond carriage_from_base = base_from_carriage.rotation.conjugate();
    const Eigen::Vector3d w_carriage = -(carriage_from_base * w);
    const Eigen::Vector3d v_carriage =
        -(carriage_from_base * (v + w.cross(base_from_carriage.translation)));
    GaugeFreedom freedom;
    freedom.name = motion_name(w.isZero(), direction_name(w.isZero() ? v : w));
    freedom.direction << x * w, x * v, w_carriage,
        v_carriage + w_carriage.cross(xy.carriage_from_marker.translation);
    return freedom;
}

// Directions about which all poses together say less than a single pose would if Y were known: the
// squared sine between the columns of X and of Y (canonical correlation; Bjorck and Golub, Math.
// Comp. 27, 1973) times the number of poses, free of units and origins. `middle_mm`: of the
// marker's positions, base frame. A shift moves it by more than the arc of its turn at 100 mm.
std::vector<PoorlyConstrainedDirection> weak_directions(const RegistrationJacobian& jacobian,
                                                        const XY& xy,
                                                        const std::vector<Twist>& freedoms,
                                                        const Eigen::Vector3d& middle_mm,
                                                        std::size_t poses) {
    const Eigen::MatrixXd r = triangle_of(jacobian);
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(Eigen::MatrixXd(r.rightCols<6>()));
    const Eigen::MatrixXd whitened =
        qr.matrixQR().topRows<6>().triangularView<Eigen::Upper>().solve<Eigen::OnTheRight>(
            Eigen::MatrixXd(r.bottomRightCorner<6, 6>()));
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(whitened, Eigen::ComputeFullV);
    std::vector<PoorlyConstrainedDirection> weak;
    for (Eigen::Index k = 5 - std::ssize(freedoms); k >= 0; --k) {
        const double sine = svd.singularValues()[k];
        const double worth = sine * sine * static_cast<double>(poses);
        if (worth >= 1.0)
            break;
        Vector12d direction;  // by one standard deviation times `sine`
        direction.head<6>() =
            qr.matrixQR().topRows<6>().triangularView<Eigen::Upper>().solve(svd.matrixV().col(k));
        direction.tail<6>() = -r.topLeftCorner<6, 6>().triangularView<Eigen::Upper>().solve(
            r.topRightCorner<6, 6>() * direction.head<6>());
        const Twist twist = seen_from(middle_mm, as_twists(direction, xy), freedoms);
        weak.push_back(weak_direction(direction, twist, 1.0 / std::max(sine, 1e-12), worth));
    }
    return weak;
}

// Along the freedoms to the carriage_from_marker nearest to the nominal (rotations as arcs of 100
// mm radius). Exact: predicted pixels do not change. `base_from_carriage`: any one of the run.
XY nearest_to_prior(XY xy, const std::vector<Twist>& freedoms, const Rigid& base_from_carriage,
                    const Rigid& nominal_carriage_from_marker) {
    if (freedoms.empty())
        return xy;
    for (int iteration = 0; iteration < 50; ++iteration) {  // Gauss-Newton
        const Eigen::VectorXd amount =
            -prior_slope(xy, freedoms, base_from_carriage, nominal_carriage_from_marker)
                 .householderQr()
                 .solve(prior_deviation(nominal_carriage_from_marker, xy.carriage_from_marker));
        Twist twist = Twist::Zero();
        for (std::size_t k = 0; k < freedoms.size(); ++k)
            twist += amount[static_cast<Eigen::Index>(k)] * freedoms[k];
        xy.camera_from_base = xy.camera_from_base * exponential(twist);
        xy.carriage_from_marker = compensated(xy.carriage_from_marker, base_from_carriage, twist);
        if (twist.norm() < 1e-8)
            return xy;
    }
    throw NumericalError(
        "registration: the nominal carriage_from_marker is too far from any that fits the "
        "photographs");
}

// Covariance of (X, Y) with the freedoms held where the prior puts them.
Matrix12d constrained_covariance(const RegistrationJacobian& jacobian,
                                 const std::vector<GaugeFreedom>& freedoms) {
    // C d = 0 says that Y stays the nearest to the prior; Z spans what is left.
    const Vector12d unscale = jacobian.colwise().norm().cwiseInverse();
    Eigen::MatrixXd z = Eigen::MatrixXd::Identity(12, 12);
    if (!freedoms.empty()) {
        Eigen::MatrixXd constraint(std::ssize(freedoms), 12);
        for (std::size_t k = 0; k < freedoms.size(); ++k) {
            Vector12d row = Vector12d::Zero();
            row.tail<6>() = freedoms[k].direction.tail<6>();
            row.segment<3>(6) *= prior_length_mm * prior_length_mm;
            constraint.row(static_cast<Eigen::Index>(k)) =
                row.cwiseProduct(unscale).normalized().transpose();
        }
        const Eigen::JacobiSVD<Eigen::MatrixXd> svd(constraint, Eigen::ComputeFullV);
        z = svd.matrixV().rightCols(12 - std::ssize(freedoms)).eval();
    }
    const Eigen::MatrixXd reduced = jacobian * unscale.asDiagonal() * z;
    const Eigen::MatrixXd information = reduced.transpose() * reduced;
    const Eigen::MatrixXd inverse = information.ldlt().solve(
        Eigen::MatrixXd(Eigen::MatrixXd::Identity(information.rows(), information.cols())));
    const Eigen::MatrixXd half = unscale.asDiagonal() * z;
    return half * inverse * half.transpose();
}

// What X and Y are estimated from.
struct Observations {
    std::vector<PosePair> poses;
    // Residuals in standard deviations and their derivatives by the left perturbations of X and Y,
    // for these base_from_carriage; nothing where a point has no projection.
    std::function<std::optional<ResidualsAndJacobian>(std::span<const Rigid>, const XY&)>
        linearised;
    int group;  // rows that are one point or one pose
    // The length of a group of normal deviates: its median, and what it exceeds in 1.1 % of cases.
    double median_length, long_length;
    std::vector<double> sigma_px = {};  // of each pose's coordinates; empty for whole poses
};

std::vector<double> lengths_of(const Eigen::VectorXd& residuals, int group) {
    std::vector<double> lengths;
    for (Eigen::Index row = 0; row < residuals.size(); row += group)
        lengths.push_back(residuals.segment(row, group).norm());
    return lengths;
}

// From the median length. The floor keeps exact data from being flagged as outliers.
double huber_threshold(std::vector<double> lengths, const Observations& observations) {
    const auto middle = lengths.begin() + std::ssize(lengths) / 2;
    std::nth_element(lengths.begin(), middle, lengths.end());
    return observations.long_length * std::max(*middle / observations.median_length, 1e-6);
}

StageMotion required_motion(std::span<const PosePair> poses) {
    std::vector<Rigid> plan;
    for (const PosePair& pose : poses)
        plan.push_back(pose.base_from_carriage);
    const StageMotion motion = stage_motion(plan);
    if (motion.kind == MotionKind::none)
        throw NumericalError(fmt::format(
            "registration: the stage did not move: {} poses, all the same", poses.size()));
    if (motion.distinct_poses < static_cast<int>(min_poses))
        throw NumericalError(
            fmt::format("registration: {} poses, but only {} distinct ones, at least {} are needed",
                        poses.size(), motion.distinct_poses, min_poses));
    return motion;
}

XY minimised(const XY& start, int group, double huber,
             const std::function<std::optional<ResidualsAndJacobian>(const XY&)>& linearised) {
    const auto moved = [](const XY& xy, const Eigen::VectorXd& step) {
        return std::optional(XY{left_perturbed(xy.camera_from_base, step.head<6>()),
                                left_perturbed(xy.carriage_from_marker, step.tail<6>())});
    };
    // A gain of 1e-16 is 1e-8 of a standard deviation; rounding alone promises 1e-20.
    const LeastSquaresRule rule{{.enough_gain = 1e-16}, group, huber};
    const auto found = least_squares(start, rule, linearised, moved);
    if (!found || !found->converged)
        throw NumericalError("registration did not converge");
    return found->place.unknowns;
}

// X and Y moved along the freedoms to the prior, with covariance, rank and names.
Registration with_freedoms_fixed(
    const XY& solution, const StageMotion& motion, const Rigid& nominal_carriage_from_marker,
    const std::function<RegistrationJacobian(const XY&)>& jacobian_at) {
    const std::vector<Rigid>& stage = motion.without_noise;
    Registration result;
    const std::vector<Twist> freedoms = find_freedoms(jacobian_at(solution), solution, result);
    const XY xy = nearest_to_prior(solution, freedoms, stage.front(), nominal_carriage_from_marker);
    result.camera_from_base = xy.camera_from_base;
    result.carriage_from_marker = xy.carriage_from_marker;
    result.motion = motion.words;
    for (const Twist& twist : freedoms)
        result.freedoms.push_back(gauge_freedom(twist, xy, stage.front()));
    const RegistrationJacobian jacobian = jacobian_at(xy);
    result.covariance = constrained_covariance(jacobian, result.freedoms);
    Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();  // of the marker's positions
    for (const Rigid& base_from_carriage : stage)
        middle_mm += base_from_carriage * xy.carriage_from_marker.translation;
    middle_mm /= static_cast<double>(stage.size());
    result.weak = weak_directions(jacobian, xy, freedoms, middle_mm, stage.size());
    if (!result.covariance.allFinite() || !vector_from_rigid(result.camera_from_base).allFinite() ||
        !vector_from_rigid(result.carriage_from_marker).allFinite())
        throw NumericalError("registration gave a value that is not finite");
    return result;
}

Registration registered(Observations observations, const Rigid& nominal_carriage_from_marker) {
    const StageMotion motion = required_motion(observations.poses);
    const std::vector<Rigid>& stage = motion.without_noise;
    for (std::size_t i = 0; i < stage.size(); ++i)
        observations.poses[i].base_from_carriage = stage[i];
    const auto linearised = [&](const XY& xy) { return observations.linearised(stage, xy); };
    const auto required = [&](const XY& xy) {
        if (auto at = linearised(xy))
            return std::move(*at);
        throw NumericalError(
            "registration: the marker is predicted outside the camera's valid region");
    };
    const int group = observations.group;
    XY xy = registration_seed(observations.poses);
    double threshold = 0.0;
    for (int round = 0; round < 3; ++round) {  // the threshold settles
        threshold = huber_threshold(lengths_of(required(xy).residuals, group), observations);
        xy = minimised(xy, group, threshold, linearised);
    }
    Registration result = with_freedoms_fixed(xy, motion, nominal_carriage_from_marker,
                                              [&](const XY& at) { return required(at).jacobian; });
    const Eigen::VectorXd residuals =
        required({result.camera_from_base, result.carriage_from_marker}).residuals;
    for (const double length : lengths_of(residuals, group)) {
        result.reduced_squares += length * length;
        result.down_weighted_points += length > threshold ? 1 : 0;
    }
    const auto count = static_cast<double>(residuals.size());
    result.reduced_squares /= count - result.rank;
    const Eigen::Index rows = residuals.size() / std::ssize(observations.poses);
    double squares_px = 0.0;
    for (std::size_t i = 0; i < observations.sigma_px.size(); ++i)
        squares_px += residuals.segment(rows * static_cast<Eigen::Index>(i), rows).squaredNorm() *
                      std::pow(observations.sigma_px[i], 2);
    result.residual_rms_px = std::sqrt(squares_px / count);
    return result;
}

void require_enough_poses(std::size_t poses) {
    if (poses < min_poses)
        throw NumericalError(
            fmt::format("registration: {} poses, at least {} are needed", poses, min_poses));
}

bool are_finite(const Rigid& base_from_carriage, const Rigid& camera_from_marker) {
    return vector_from_rigid(base_from_carriage).allFinite() &&
           vector_from_rigid(camera_from_marker).allFinite();
}

using Points = std::vector<Eigen::Vector3d>;
using Poses = std::span<const RegistrationPose>;
using Matrix2x6 = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

void require_usable(const Points& points, Poses poses, const Rigid& nominal) {
    require_enough_poses(poses.size());
    if (points.size() < 3)
        throw NumericalError("registration: the marker needs at least 3 points");
    bool finite = vector_from_rigid(nominal).allFinite();
    for (const Eigen::Vector3d& point : points)
        finite = finite && point.allFinite();
    for (const RegistrationPose& pose : poses) {
        if (pose.pixels.size() != points.size())
            throw NumericalError(fmt::format("registration: {} pixels for a marker of {} points",
                                             pose.pixels.size(), points.size()));
        finite = finite && are_finite(pose.base_from_carriage, pose.camera_from_marker) &&
                 std::isfinite(pose.sigma_px) && pose.sigma_px > 0.0;
        for (const Eigen::Vector2d& pixel : pose.pixels)
            finite = finite && pixel.allFinite();
    }
    if (!finite)
        throw NumericalError("registration: a value is not finite or a sigma is not positive");
}

struct PointDerivatives {
    Eigen::Vector2d pixel;
    Matrix2x6 by_x, by_y;
};

// p_camera = X S Y p. A left perturbation (w, v) of X moves it by w x (R_X S Y p) + v; one of Y
// does the same in the carriage.
std::optional<PointDerivatives> point_derivatives(const Projector& projector,
                                                  const Eigen::Vector3d& p_marker, const XY& xy,
                                                  const Rigid& base_from_carriage) {
    const Rigid& x = xy.camera_from_base;
    const Rigid& y = xy.carriage_from_marker;
    const Eigen::Vector3d turned_in_carriage = y.rotation * p_marker;
    const Eigen::Vector3d turned_in_camera =
        x.rotation * (base_from_carriage * (turned_in_carriage + y.translation));
    const std::optional<Projected> projected =
        projector.project_with_jacobian(turned_in_camera + x.translation);
    if (!projected)
        return std::nullopt;
    const Eigen::Matrix<double, 2, 3> by_carriage =
        projected->jacobian * (x.rotation * base_from_carriage.rotation).toRotationMatrix();
    PointDerivatives result;
    result.pixel = projected->pixel;
    result.by_x << -projected->jacobian * cross_matrix(turned_in_camera), projected->jacobian;
    result.by_y << -by_carriage * cross_matrix(turned_in_carriage), by_carriage;
    return result;
}

// Two rows a point, in standard deviations; nothing where a point has no projection.
std::optional<ResidualsAndJacobian> linearised(const Projector& projector, const Points& points,
                                               Poses poses, std::span<const Rigid> stage,
                                               const XY& xy) {
    const Eigen::Index rows = 2 * std::ssize(points) * std::ssize(poses);
    ResidualsAndJacobian all{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, 12)};
    Eigen::Index row = 0;
    for (std::size_t k = 0; k < poses.size(); ++k)
        for (std::size_t i = 0; i < points.size(); ++i, row += 2) {
            const auto point = point_derivatives(projector, points[i], xy, stage[k]);
            if (!point)
                return std::nullopt;
            const double sigma = poses[k].sigma_px;
            all.residuals.segment<2>(row) = (point->pixel - poses[k].pixels[i]) / sigma;
            all.jacobian.middleRows<2>(row) << point->by_x / sigma, point->by_y / sigma;
        }
    return all;
}

using Matrix6x12 = Eigen::Matrix<double, 6, 12>;

// d log(Exp(d) Exp(r)) / d d at d = 0: the inverse left Jacobian of SO(3) (Barfoot, State
// Estimation for Robotics, 7.1.5). r is a residual, far from half a turn.
Eigen::Matrix3d by_left_turn(const Eigen::Vector3d& r) {
    const double angle = r.norm();
    const Eigen::Matrix3d k = cross_matrix(r);
    // Below the threshold the next term of the series, r^2 / 720, is under 1e-10.
    const double second =
        angle < 2e-4 ? 1.0 / 12.0 : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle);
    return Eigen::Matrix3d::Identity() - 0.5 * k + second * k * k;
}

// X S Y against the measured pose, and how it changes with X and Y. Rotation: X S Y turns by w_X
// and by R_X R_S w_Y; translation: R_X (S t_Y) + t_X.
struct Difference {
    Vector6d value;
    Matrix6x12 slope;
};

Difference difference(const Rigid& camera_from_marker, const Rigid& base_from_carriage,
                      const XY& xy) {
    const Rigid predicted = xy.camera_from_base * base_from_carriage * xy.carriage_from_marker;
    const Eigen::Matrix3d turn =
        (xy.camera_from_base.rotation * base_from_carriage.rotation).toRotationMatrix();
    Difference result{left_difference(camera_from_marker, predicted), Matrix6x12::Zero()};
    const Eigen::Matrix3d by_turn = by_left_turn(result.value.head<3>());
    result.slope.topLeftCorner<3, 3>() = by_turn;
    result.slope.block<3, 3>(0, 6) = by_turn * turn;
    result.slope.bottomLeftCorner<3, 3>() =
        -cross_matrix(predicted.translation - xy.camera_from_base.translation);
    result.slope.block<3, 3>(3, 3).setIdentity();
    result.slope.block<3, 3>(3, 9) = turn;
    return result;
}

// Takes a difference to standard deviations: L^-1 with covariance = L L^T.
Matrix6d whitening_of(const Matrix6d& covariance) {
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    if (!covariance.allFinite() || root.info() != Eigen::Success)
        throw NumericalError("registration: the covariance of a pose is not positive definite");
    return root.matrixL().solve(Eigen::MatrixXd::Identity(6, 6));
}

}  // namespace

Eigen::Matrix<double, Eigen::Dynamic, 12> registration_jacobian(
    const Projector& projector, const std::vector<Eigen::Vector3d>& points_mm,
    const Rigid& camera_from_base, const Rigid& base_from_carriage,
    const Rigid& carriage_from_marker) {
    const RegistrationPose pose{.pixels = {points_mm.size(), Eigen::Vector2d::Zero()}};
    const auto at = linearised(projector, points_mm, {&pose, 1}, {&base_from_carriage, 1},
                               {camera_from_base, carriage_from_marker});
    if (!at)
        throw NumericalError("registration: a marker point has no projection");
    return at->jacobian;
}

Registration register_stage(const Projector& projector,
                            const std::vector<Eigen::Vector3d>& points_mm,
                            std::span<const RegistrationPose> poses,
                            const Rigid& nominal_carriage_from_marker) {
    require_point_of_view(projector.camera(), "registration");
    require_usable(points_mm, poses, nominal_carriage_from_marker);
    const auto linearised_here = [&](std::span<const Rigid> stage, const XY& xy) {
        return linearised(projector, points_mm, poses, stage, xy);
    };
    Observations observations{{}, linearised_here, 2, std::sqrt(2.0 * std::numbers::ln2), 3.0};
    for (const RegistrationPose& pose : poses) {
        observations.poses.push_back({pose.base_from_carriage, pose.camera_from_marker});
        observations.sigma_px.push_back(pose.sigma_px);
    }
    return registered(std::move(observations), nominal_carriage_from_marker);
}

Registration register_stage_on_poses(std::span<const MeasuredPose> poses,
                                     const Rigid& nominal_carriage_from_marker) {
    require_enough_poses(poses.size());
    bool finite = vector_from_rigid(nominal_carriage_from_marker).allFinite();
    std::vector<Matrix6d> whitenings;
    Observations observations{{}, {}, 6, 2.313, 4.08};  // chi-square, 6 degrees of freedom
    for (const MeasuredPose& pose : poses) {
        finite = finite && are_finite(pose.base_from_carriage, pose.camera_from_marker);
        whitenings.push_back(whitening_of(pose.covariance));
        observations.poses.push_back({pose.base_from_carriage, pose.camera_from_marker});
    }
    if (!finite)
        throw NumericalError("registration: a value is not finite");
    observations.linearised = [&](std::span<const Rigid> stage, const XY& xy) {
        const Eigen::Index rows = 6 * std::ssize(poses);
        ResidualsAndJacobian all{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, 12)};
        for (std::size_t i = 0; i < poses.size(); ++i) {
            const Difference one = difference(poses[i].camera_from_marker, stage[i], xy);
            const auto row = 6 * static_cast<Eigen::Index>(i);
            all.residuals.segment<6>(row) = whitenings[i] * one.value;
            all.jacobian.middleRows<6>(row) = whitenings[i] * one.slope;
        }
        return all;
    };
    return registered(std::move(observations), nominal_carriage_from_marker);
}

}  // namespace etalon
