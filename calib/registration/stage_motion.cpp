#include "calib/registration/stage_motion.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <array>

#include "core/program/errors.h"

namespace etalon {
namespace {

using Places = std::span<const Rigid>;
using Columns = Eigen::Matrix3Xd;

constexpr double noise_shift_mm = 2e-3;
constexpr double noise_shift_share = 1e-5;
constexpr double noise_turn_rad = 5e-5;
constexpr double same_pose_share = 0.01;
constexpr int enough_poses = 4;

// Every pose against the first one.
struct Moves {
    Columns shifts, turns;  // of the carriage's origin; rotation vectors; base frame
};

Moves moves_of(Places poses) {
    Moves moves{Columns(3, std::ssize(poses)), Columns(3, std::ssize(poses))};
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const Vector6d move = left_difference(poses.front(), poses[i]);
        if (!move.allFinite())
            throw NumericalError("stage motion: a pose is not finite");
        moves.turns.col(static_cast<Eigen::Index>(i)) = move.head<3>();
        moves.shifts.col(static_cast<Eigen::Index>(i)) = move.tail<3>();
    }
    return moves;
}

double largest(const Columns& vectors) {
    return vectors.colwise().norm().maxCoeff();
}

// Main directions of the vectors and how far they reach along each.
struct Spread {
    Eigen::Matrix3d directions;
    Eigen::Vector3d reach;

    int rank(double noise) const { return static_cast<int>((reach.array() > noise).count()); }
};

Spread spread(const Columns& vectors) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(Eigen::MatrixXd(vectors), Eigen::ComputeFullU);
    Spread result{svd.matrixU(), {}};
    result.reach = (svd.matrixU().transpose() * vectors).cwiseAbs().rowwise().maxCoeff();
    return result;
}

std::string direction_words(const Eigen::Vector3d& direction) {
    for (int k = 0; k < 3; ++k)
        if (std::abs(direction[k]) > 1.0 - 1e-6)
            return fmt::format("base {}", "xyz"[k]);
    Eigen::Index leading = 0;
    direction.cwiseAbs().maxCoeff(&leading);
    const Eigen::Vector3d v = direction[leading] < 0.0 ? Eigen::Vector3d(-direction) : direction;
    return fmt::format("base direction ({:.3f}, {:.3f}, {:.3f})", v.x(), v.y(), v.z());
}

// A point that keeps its place across `axis` in every pose, as well as one can: the shifts across
// it are (I - R) c.
Eigen::Vector3d fixed_point(Places poses, const Moves& moves, const Eigen::Vector3d& axis) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - axis * axis.transpose();
    Eigen::MatrixXd a(3 * std::ssize(poses), 3);
    Eigen::VectorXd b(3 * std::ssize(poses));
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const Eigen::Matrix3d turn =
            rotation_from_vector(moves.turns.col(static_cast<Eigen::Index>(i))).toRotationMatrix();
        const auto row = 3 * static_cast<Eigen::Index>(i);
        a.middleRows<3>(row) = across * (Eigen::Matrix3d::Identity() - turn);
        b.segment<3>(row) = across * (poses[i].translation - turn * poses.front().translation);
    }
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
    decomposition.setThreshold(1e-9);  // nothing determines c along the axis
    decomposition.compute(a);
    return decomposition.solve(b);
}

double largest_difference_mm(Places one, Places two) {
    double largest = 0.0;
    for (std::size_t i = 0; i < one.size(); ++i)
        largest = std::max(largest, (one[i].translation - two[i].translation).norm());
    return largest;
}

int distinct_poses(Places poses, const Moves& moves) {
    const double shift_mm = std::max(noise_shift_mm, same_pose_share * largest(moves.shifts));
    const double turn_rad = std::max(noise_turn_rad, same_pose_share * largest(moves.turns));
    std::vector<Rigid> found;
    for (const Rigid& pose : poses) {
        const bool is_new = std::none_of(found.begin(), found.end(), [&](const Rigid& other) {
            const Vector6d move = left_difference(other, pose);
            return move.head<3>().norm() < turn_rad && move.tail<3>().norm() < shift_mm;
        });
        if (is_new)
            found.push_back(pose);
        if (found.size() == enough_poses)
            break;
    }
    return static_cast<int>(found.size());
}

// The first pose, shifted by the parts of the shifts along the main directions that count.
std::vector<Rigid> shifted_only(Places poses, const Moves& moves, const Spread& shifts, int rank) {
    const Eigen::Matrix3Xd along = shifts.directions.leftCols(rank);
    std::vector<Rigid> result;
    for (Eigen::Index i = 0; i < moves.shifts.cols(); ++i)
        result.push_back(
            {poses.front().rotation,
             poses.front().translation + along * (along.transpose() * moves.shifts.col(i))});
    return result;
}

StageMotion only_shifts(Places poses, const Moves& moves, double noise_mm) {
    const Spread shifts = spread(moves.shifts);
    const int rank = shifts.rank(noise_mm);
    StageMotion motion;
    motion.without_noise = shifted_only(poses, moves, shifts, rank);
    motion.freedoms = std::array{6, 4, 3, 3}.at(static_cast<std::size_t>(rank));
    if (rank == 0)
        motion.words = "no motion: all poses are the same";
    else if (rank == 1)
        motion.words = "shifts along one line, " + direction_words(shifts.directions.col(0));
    else if (rank == 2)
        motion.words = "shifts in the plane across " + direction_words(shifts.directions.col(2));
    else
        motion.words = "shifts in space without turns";
    motion.kind = static_cast<MotionKind>(rank);
    return motion;
}

// Turns exactly about `axis`; the shifts as they are.
std::vector<Rigid> turned_about(Places poses, const Moves& moves, const Eigen::Vector3d& axis) {
    std::vector<Rigid> result(poses.begin(), poses.end());
    for (std::size_t i = 0; i < result.size(); ++i) {
        const double angle = axis.dot(moves.turns.col(static_cast<Eigen::Index>(i)));
        result[i].rotation = rotation_from_vector(angle * axis) * poses.front().rotation;
    }
    return result;
}

// Turns exactly about the line through `point`, and the shifts along it as they are.
std::vector<Rigid> turned_about_line(Places poses, const Moves& moves, const Eigen::Vector3d& axis,
                                     const Eigen::Vector3d& point) {
    std::vector<Rigid> result = turned_about(poses, moves, axis);
    for (std::size_t i = 0; i < result.size(); ++i) {
        const Eigen::Quaterniond turn = result[i].rotation * poses.front().rotation.conjugate();
        const Eigen::Vector3d there = point + turn * (poses.front().translation - point);
        result[i].translation = there + axis * axis.dot(poses[i].translation - there);
    }
    return result;
}

std::vector<Rigid> within_plane(std::vector<Rigid> poses, const Eigen::Vector3d& normal) {
    const double height = normal.dot(poses.front().translation);
    for (Rigid& pose : poses)
        pose.translation += normal * (height - normal.dot(pose.translation));
    return poses;
}

StageMotion parallel_turns(Places poses, const Moves& moves, const Eigen::Vector3d& axis,
                           double noise_mm) {
    const std::string words = direction_words(axis);
    const std::vector<Rigid> about_line =
        turned_about_line(poses, moves, axis, fixed_point(poses, moves, axis));
    if (largest_difference_mm(poses, about_line) < noise_mm)
        return {MotionKind::one_axis, 2, 0, "turns about one fixed axis along " + words,
                about_line};
    const std::vector<Rigid> turned = turned_about(poses, moves, axis);
    if ((axis.transpose() * moves.shifts).cwiseAbs().maxCoeff() < noise_mm)
        return {MotionKind::planar_motion, 1, 0,
                "planar motion: shifts across " + words + " and turns about it",
                within_plane(turned, axis)};
    return {MotionKind::parallel_turns, 1, 0, "shifts in space and turns about " + words, turned};
}

}  // namespace

StageMotion stage_motion(Places poses) {
    if (poses.empty())
        throw NumericalError("stage motion: no poses");
    const Moves moves = moves_of(poses);
    const double noise_mm = std::max(noise_shift_mm, noise_shift_share * largest(moves.shifts));
    const Spread turns = spread(moves.turns);
    StageMotion motion;
    if (turns.rank(noise_turn_rad) == 0)
        motion = only_shifts(poses, moves, noise_mm);
    else if (turns.rank(noise_turn_rad) == 1)
        motion = parallel_turns(poses, moves, turns.directions.col(0), noise_mm);
    else
        motion = {MotionKind::all_turns, 0, 0, "turns about axes that are not parallel",
                  std::vector<Rigid>(poses.begin(), poses.end())};
    motion.distinct_poses = distinct_poses(poses, moves);
    return motion;
}

void require_full_motion(Places plan, Places reach) {
    const StageMotion made = stage_motion(plan), possible = stage_motion(reach);
    if (made.kind != MotionKind::none && made.distinct_poses < enough_poses)
        throw NumericalError(fmt::format("degenerate plan: {} distinct poses, at least {} needed",
                                         made.distinct_poses, enough_poses));
    if (made.kind < possible.kind)
        throw NumericalError(fmt::format(
            "degenerate plan: its poses make {}, where the stage's axes make {}{}", made.words,
            possible.words,
            made.freedoms == possible.freedoms
                ? std::string("; nothing would be seen of what happens across that plane")
                : fmt::format("; free directions of X and Y: {} instead of {}", made.freedoms,
                              possible.freedoms)));
}

}  // namespace etalon
