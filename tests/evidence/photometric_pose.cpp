// Prints how the photometric pose does on synthetic photographs: 500 poses, and 100 repeats at each
// of six fixed ones, with a webcam with and without lens; AprilTag (quad_decimate 1) on the same
// photographs beside it. About 75 minutes of CPU time, nearly all of it the reference integrator's.
// Arguments: POSES REPEATS, default 500 100. docs/photometric-pose.md has the tables.
#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <cstdlib>

#include "tests/evidence/photometric_study.h"

namespace etalon::test {
namespace {

struct Sums {
    int poses = 0, undetected = 0, failed = 0, flipped = 0, unconverged = 0;
    Vector6d mean = Vector6d::Zero(), square = Vector6d::Zero();  // errors over the bound
    Vector6d corner_mean = Vector6d::Zero(), corner_square = Vector6d::Zero();
    double chi_square = 0.0, mahalanobis = 0.0, photometric_ms = 0.0, apriltag_ms = 0.0;

    void add(const FoundPose& outcome, const Vector6d& bound) {
        undetected += outcome.detected ? 0 : 1;
        failed += outcome.failed ? 1 : 0;
        flipped += outcome.flipped ? 1 : 0;
        if (!outcome.detected || outcome.failed || outcome.flipped)
            return;
        ++poses;
        unconverged += outcome.converged ? 0 : 1;
        const Vector6d error = outcome.error.cwiseQuotient(bound);
        const Vector6d corner = outcome.corner_error.cwiseQuotient(bound);
        mean += error;
        square += error.cwiseAbs2();
        corner_mean += corner;
        corner_square += corner.cwiseAbs2();
        chi_square += outcome.chi_square;
        mahalanobis += outcome.mahalanobis;
        photometric_ms += outcome.photometric_ms;
        apriltag_ms += outcome.apriltag_ms;
    }

    // In units of the bound, component by component.
    static Vector6d scatter(const Vector6d& sum, const Vector6d& squares, double n) {
        return ((squares - sum.cwiseAbs2() / n) / (n - 1.0)).cwiseSqrt();
    }

    void print(const std::string& name) const {
        const double n = poses;
        const Vector6d ours = scatter(mean, square, n);
        const Vector6d corners = scatter(corner_mean, corner_square, n);
        const Vector6d standard_errors = (mean / n).cwiseQuotient(ours / std::sqrt(n));
        fmt::print(
            "| {} | {} | {:.1f} | {:.2f}..{:.2f} | {:.3f} | {:.2f} | {:.1f}..{:.1f} | {:.0f} / "
            "{:.0f} | {} / {} / {} / {} |\n",
            name, poses, standard_errors.cwiseAbs().maxCoeff(), ours.minCoeff(), ours.maxCoeff(),
            chi_square / n, mahalanobis / n / 6.0, corners.cwiseQuotient(ours).minCoeff(),
            corners.cwiseQuotient(ours).maxCoeff(), photometric_ms / n, apriltag_ms / n, flipped,
            failed, undetected, unconverged);
        std::fflush(stdout);
    }
};

void spread_poses(bool with_lens, std::uint64_t count) {
    const CameraModel camera = webcam(with_lens);
    const Renderer renderer(camera);
    Study study(camera);
    Sums sums;
    for (std::uint64_t i = 0; i < count; ++i) {
        const Truth truth = truth_at(camera, study_pose(camera, i), 512, 0.1);
        const Matrix6d bound = cramer_rao_bound(camera, renderer, truth.camera_from_marker);
        const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
        sums.add(study.run(truth, {77, static_cast<std::uint32_t>(i)}),
                 bound.diagonal().cwiseSqrt());
    }
    sums.print(fmt::format("all poses, {} lens", with_lens ? "with" : "without"));
}

void repeats_at(bool with_lens, std::uint64_t pose, std::uint32_t repeats) {
    const CameraModel camera = webcam(with_lens);
    const Renderer renderer(camera);
    Study study(camera);
    Sums sums;
    const Truth truth = truth_at(camera, study_pose(camera, pose), 2048, 0.08);
    const Matrix6d bound = cramer_rao_bound(camera, renderer, truth.camera_from_marker);
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    for (std::uint32_t i = 0; i < repeats; ++i)
        sums.add(study.run(truth, {99, i}), bound.diagonal().cwiseSqrt());
    const Vector6d at = vector_from_rigid(truth.camera_from_marker);
    const Eigen::Vector3d normal = truth.camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double tilt = std::acos(normal.dot(truth.camera_from_marker.translation.normalized()));
    sums.print(fmt::format("{:.0f} mm, {:.0f} degrees, {} lens", at[5],
                           tilt * 180.0 / std::numbers::pi, with_lens ? "with" : "without"));
}

}  // namespace
}  // namespace etalon::test

int main(int count, char** arguments) {
    using namespace etalon::test;
    const int poses = count > 1 ? std::atoi(arguments[1]) : 500;
    const int repeats = count > 2 ? std::atoi(arguments[2]) : 100;
    fmt::print(
        "| photographs | n | largest mean, s.e. | scatter / bound | chi-square | covariance | "
        "AprilTag's scatter / ours | CPU ms, ours / AprilTag's | flipped / refused / undetected / "
        "not converged |\n|---|---|---|---|---|---|---|---|---|\n");
    for (const bool with_lens : {true, false}) {
        for (const std::uint64_t pose : {2, 5, 8})
            repeats_at(with_lens, pose, static_cast<std::uint32_t>(repeats));
        spread_poses(with_lens, static_cast<std::uint64_t>(poses));
    }
}
