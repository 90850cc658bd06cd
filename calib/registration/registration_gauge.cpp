#include "calib/registration/registration_gauge.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::size_t min_poses = 4;

// See the header.
class SeedSystem {
public:
    void add_position(const Eigen::Vector3d& s, const PosePair& pose) {
        Row row = by_m(s);
        row.middleCols<3>(9) = pose.camera_from_marker.rotation.toRotationMatrix();
        row.middleCols<3>(12).setIdentity();
        rows_.push_back(row);
        values_.push_back(pose.camera_from_marker.translation);
    }

    // Rotations near half a turn have no sure sign, tiny ones are noise: both are left out.
    void add_rotation(const PosePair& one, const PosePair& two) {
        constexpr double arm_mm = 100.0;  // weighs a rotation like the motion of a marker's edge
        const Eigen::Vector3d base = rotation_vector(two.base_from_carriage.rotation *
                                                     one.base_from_carriage.rotation.conjugate());
        if (base.norm() < 0.01 || base.norm() > 2.8)
            return;
        rows_.push_back(by_m(arm_mm * base));
        values_.push_back(arm_mm * rotation_vector(two.camera_from_marker.rotation *
                                                   one.camera_from_marker.rotation.conjugate()));
    }

    // Minimum-norm solution in scaled columns: what nothing determines stays zero, and the prior
    // decides about it later.
    Eigen::Matrix<double, 15, 1> solve() const {
        Eigen::MatrixXd a(3 * std::ssize(rows_), 15);
        Eigen::VectorXd b(3 * std::ssize(rows_));
        for (std::size_t i = 0; i < rows_.size(); ++i) {
            a.middleRows<3>(3 * static_cast<Eigen::Index>(i)) = rows_[i];
            b.segment<3>(3 * static_cast<Eigen::Index>(i)) = values_[i];
        }
        Eigen::VectorXd unscale = a.colwise().norm();
        for (double& s : unscale)
            s = s > 0.0 ? 1.0 / s : 0.0;
        Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
        decomposition.setThreshold(1e-3);
        decomposition.compute(a * unscale.asDiagonal());
        return unscale.asDiagonal() * Eigen::VectorXd(decomposition.solve(b));
    }

private:
    using Row = Eigen::Matrix<double, 3, 15>;

    static Row by_m(const Eigen::Vector3d& v) {  // d (M v) / d M, column by column
        Row row = Row::Zero();
        for (int column = 0; column < 3; ++column)
            row.middleCols<3>(3 * column) = v[column] * Eigen::Matrix3d::Identity();
        return row;
    }

    std::vector<Row> rows_;
    std::vector<Eigen::Vector3d> values_;
};

Eigen::Quaterniond nearest_rotation(const Eigen::Matrix3d& m) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d product = svd.matrixU() * svd.matrixV().transpose();
    const double sign = product.determinant() < 0.0 ? -1.0 : 1.0;
    return Eigen::Quaterniond(Eigen::Matrix3d(
        svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose()));
}

// Where the marker is on average, base frame.
Eigen::Vector3d middle_of(std::span<const Rigid> stage, const XY& xy) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Rigid& base_from_carriage : stage)
        sum += base_from_carriage * xy.carriage_from_marker.translation;
    return sum / static_cast<double>(stage.size());
}

}  // namespace

XY registration_seed(std::span<const PosePair> poses) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const PosePair& pose : poses)
        centre += pose.base_from_carriage.translation / static_cast<double>(poses.size());
    SeedSystem system;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        system.add_position(poses[i].base_from_carriage.translation - centre, poses[i]);
        if (i > 0)
            system.add_rotation(poses[i - 1], poses[i]);
        if (i > 1)
            system.add_rotation(poses[0], poses[i]);
    }
    const Eigen::Matrix<double, 15, 1> solution = system.solve();
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

void require_enough_poses(std::size_t poses) {
    if (poses < min_poses)
        throw NumericalError(
            fmt::format("registration: {} poses, at least {} are needed", poses, min_poses));
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

XY minimised(const XY& start, const LeastSquaresRule& rule,
             const std::function<std::optional<ResidualsAndJacobian>(const XY&)>& linearised) {
    const auto moved = [](const XY& xy, const Eigen::VectorXd& step) {
        return std::optional(XY{left_perturbed(xy.camera_from_base, step.head<6>()),
                                left_perturbed(xy.carriage_from_marker, step.tail<6>())});
    };
    // A gain of 1e-16 is 1e-8 of a standard deviation; rounding alone promises 1e-20.
    LeastSquaresRule until = rule;
    until.descent.enough_gain = 1e-16;
    const auto found = least_squares(start, until, linearised, moved);
    if (!found || !found->converged)
        throw NumericalError("registration did not converge");
    return found->place.unknowns;
}

Registration with_freedoms_fixed(
    const XY& solution, const StageMotion& motion, const Rigid& nominal_carriage_from_marker,
    const std::function<RegistrationJacobian(const XY&)>& jacobian_at) {
    const std::vector<Rigid>& stage = motion.without_noise;
    const RegistrationRank rank = registration_rank(jacobian_at(solution), solution);
    const XY xy =
        nearest_to_prior(solution, rank.freedoms, stage.front(), nominal_carriage_from_marker);
    Registration result{xy.camera_from_base, xy.carriage_from_marker};
    result.rank = rank.rank;
    result.condition_number = rank.condition_number;
    result.motion = motion.words;
    for (const Twist& twist : rank.freedoms)
        result.freedoms.push_back(gauge_freedom(twist, xy, stage.front()));
    const RegistrationJacobian jacobian = jacobian_at(xy);
    result.covariance = constrained_covariance(jacobian, result.freedoms);
    result.weak = weak_directions(jacobian, xy, rank.freedoms, middle_of(stage, xy), stage.size());
    if (!result.covariance.allFinite() || !vector_from_rigid(result.camera_from_base).allFinite() ||
        !vector_from_rigid(result.carriage_from_marker).allFinite())
        throw NumericalError("registration gave a value that is not finite");
    return result;
}

namespace {

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

std::string freedom_name(const Twist& twist) {
    if (twist.head<3>().isZero())
        return "shift along " + direction_name(twist.tail<3>()) + " between X and Y";
    return "rotation about " + direction_name(twist.head<3>()) + " between X and Y";
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

// d pixels / d X and d pixels / d Y as one orthogonal basis sees them: [R_YY R_YX; 0 R_XX].
struct Blocks {
    Eigen::MatrixXd yy, yx, xx;
};

Blocks triangular_blocks(const RegistrationJacobian& jacobian) {
    Eigen::MatrixXd y_first(jacobian.rows(), 12);
    y_first << jacobian.rightCols<6>(), jacobian.leftCols<6>();
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(y_first);
    const Eigen::MatrixXd r = qr.matrixQR().topRows<12>().triangularView<Eigen::Upper>();
    return {r.topLeftCorner<6, 6>(), r.topRightCorner<6, 6>(), r.bottomRightCorner<6, 6>()};
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
    const std::string name = (shifts ? "shift along " : "rotation about ") +
                             direction_name((shifts ? shift : turn) / size, within_5_deg) +
                             " between X and Y";
    return {name, direction / size, deviation * size, worth_poses};
}

}  // namespace

RegistrationRank registration_rank(const RegistrationJacobian& jacobian, const XY& xy) {
    const Vector12d unscale = jacobian.colwise().norm().cwiseInverse();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(jacobian * unscale.asDiagonal(),
                                                Eigen::ComputeThinU | Eigen::ComputeFullV);
    const Eigen::VectorXd& values = svd.singularValues();
    RegistrationRank result;
    result.rank = static_cast<int>((values.array() > null_singular_value * values[0]).count());
    const int freedoms = 12 - result.rank;
    if (freedoms > max_freedoms)
        throw NumericalError(fmt::format(
            "registration: {} of 12 directions are undetermined; the stage moved too little",
            freedoms));
    result.condition_number = values[0] / values[result.rank - 1];
    if (freedoms > 0)
        result.freedoms =
            tidy_twists(as_twists(unscale.asDiagonal() * svd.matrixV().rightCols(freedoms), xy));
    return result;
}

GaugeFreedom gauge_freedom(const Twist& twist, const XY& xy, const Rigid& base_from_carriage) {
    const Eigen::Vector3d w = twist.head<3>(), v = twist.tail<3>();
    const Eigen::Quaterniond& x = xy.camera_from_base.rotation;
    const Eigen::Quaterniond carriage_from_base = base_from_carriage.rotation.conjugate();
    const Eigen::Vector3d w_carriage = -(carriage_from_base * w);
    const Eigen::Vector3d v_carriage =
        -(carriage_from_base * (v + w.cross(base_from_carriage.translation)));
    GaugeFreedom freedom;
    freedom.name = freedom_name(twist);
    freedom.direction << x * w, x * v, w_carriage,
        v_carriage + w_carriage.cross(xy.carriage_from_marker.translation);
    return freedom;
}

std::vector<PoorlyConstrainedDirection> weak_directions(const RegistrationJacobian& jacobian,
                                                        const XY& xy,
                                                        const std::vector<Twist>& freedoms,
                                                        const Eigen::Vector3d& middle_mm,
                                                        std::size_t poses) {
    const Blocks blocks = triangular_blocks(jacobian);
    Eigen::MatrixXd of_x(12, 6);
    of_x << blocks.yx, blocks.xx;
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(of_x);
    const Eigen::MatrixXd whitened =
        qr.matrixQR().topRows<6>().triangularView<Eigen::Upper>().solve<Eigen::OnTheRight>(
            blocks.xx);
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
        direction.tail<6>() =
            -blocks.yy.triangularView<Eigen::Upper>().solve(blocks.yx * direction.head<6>());
        const Twist twist = seen_from(middle_mm, as_twists(direction, xy), freedoms);
        weak.push_back(weak_direction(direction, twist, 1.0 / std::max(sine, 1e-12), worth));
    }
    return weak;
}

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

}  // namespace etalon
