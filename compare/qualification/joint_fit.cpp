#include "compare/qualification/joint_fit.h"

#include <Eigen/Dense>
#include <set>

#include "compare/diagnosis/cause_rows.h"
#include "compare/diagnosis/error_signatures.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr double free_norm = 1e5;  // of a free column at its prior, in standard deviations
constexpr double scene_alike = 1e-3;
constexpr int max_beside = 8;
constexpr double doubtful_deviations = 2.5;

std::set<std::string> camera_names(const CameraModel& camera) {
    std::set<std::string> names{"skew"};
    for (const auto& errors : {named_camera_errors(camera), further_camera_errors(camera)})
        for (const CameraError& error : errors)
            names.insert(error.name);
    return names;
}

enum class Part { camera, declared, beside };

// One error as it is fitted: numbers in units of its prior's standard deviation.
struct FittedError {
    std::size_t index = 0;  // among the effects' errors
    Part part = Part::beside;
    Eigen::MatrixXd columns;  // whitened and freed of X and Y, at the prior
    Eigen::VectorXd prior;    // in units of the error's size, by column
    Eigen::Index first = 0;   // of its numbers among all that are fitted
};

// As wide as no error is: free of the prior.
FittedError free_error(std::size_t index, Part part, const Eigen::MatrixXd& freed) {
    const Eigen::VectorXd prior =
        free_norm * freed.colwise().norm().cwiseMax(1e-300).cwiseInverse().transpose();
    return {index, part, freed * prior.asDiagonal(), prior};
}

// Normal equations of a growing set of errors, each drawn towards 0 by a prior of 1.
class NormalEquations {
public:
    explicit NormalEquations(Eigen::VectorXd observed)
        : observed_(std::move(observed)), square_(observed_.squaredNorm()) {}

    void add(FittedError error) {
        const Eigen::Index before = columns_.cols(), count = error.columns.cols();
        error.first = before;
        columns_.conservativeResize(observed_.size(), before + count);
        columns_.rightCols(count) = error.columns;
        const Eigen::MatrixXd mixed = columns_.transpose() * error.columns;
        normal_.conservativeResize(before + count, before + count);
        normal_.rightCols(count) = mixed;
        normal_.bottomRows(count) = mixed.transpose();
        normal_.bottomRightCorner(count, count).diagonal().array() += 1.0;
        seen_.conservativeResize(before + count);
        seen_.tail(count) = error.columns.transpose() * observed_;
        errors_.push_back(std::move(error));
    }

    void solve() {
        solver_.compute(normal_);
        numbers_ = solver_.solve(seen_);
        rest_ = square_ - seen_.dot(numbers_);
    }

    // By how much another error would lower the sum of squares.
    double gain(const FittedError& error) const {
        const Eigen::MatrixXd mixed = columns_.transpose() * error.columns;
        Eigen::MatrixXd own = error.columns.transpose() * error.columns;
        own.diagonal().array() += 1.0;
        own -= mixed.transpose() * solver_.solve(mixed);
        const Eigen::VectorXd left =
            error.columns.transpose() * observed_ - mixed.transpose() * numbers_;
        return left.dot(own.ldlt().solve(left));
    }

    double rest() const { return rest_; }
    // Numbers that the observed, and not the priors, determine.
    double fitted_numbers() const {
        const Eigen::MatrixXd inverse =
            solver_.solve(Eigen::MatrixXd::Identity(normal_.rows(), normal_.cols()));
        return static_cast<double>(normal_.rows()) - inverse.trace();
    }
    const std::vector<FittedError>& errors() const { return errors_; }
    const Eigen::VectorXd& numbers() const { return numbers_; }
    Eigen::VectorXd residual() const { return observed_ - columns_ * numbers_; }
    // L^-1 B, of which the square is B^T N^-1 B.
    Eigen::MatrixXd half_inverse(const Eigen::MatrixXd& b) const {
        return solver_.matrixL().solve(b);
    }

private:
    Eigen::VectorXd observed_, seen_, numbers_;
    Eigen::MatrixXd columns_, normal_;
    Eigen::LLT<Eigen::MatrixXd> solver_;
    std::vector<FittedError> errors_;
    double square_ = 0.0, rest_ = 0.0;
};

class Fitting {
public:
    Fitting(const DiagnosisInput& evidence, const ErrorEffects& effects)
        : evidence_(evidence),
          effects_(effects),
          rows_(evidence),
          equations_(rows_.freed(observed(evidence)).col(0)) {
        const std::set<std::string> camera =
            camera_names(evidence.request.chain.projector.camera());
        for (std::size_t i = 0; i < effects.errors.size(); ++i)
            add(i, camera.contains(effects.errors[i].name));
        equations_.solve();
    }

    JointFit result() {
        find_beside();
        JointFit fit;
        fit.scatter = std::sqrt(variance());
        for (const FittedError& error : equations_.errors()) {
            const std::string& name = candidate_of(error).name;
            if (error.part == Part::beside && declared_of(name))
                fit.contradicted.push_back(contradicted(error, fit.scatter));
            else if (error.part == Part::beside)
                fit.beside.push_back(name);
        }
        fit.edges = alone(fit.scatter, [&](const FittedError& error) {
            const std::string& name = candidate_of(error).name;
            return name == "edge shrink" || name == "tone curve";
        });
        fit.residual_px = residuals();
        fit.camera = camera_alone();  // the last, as it may add an error
        return fit;
    }

private:
    const ErrorCandidate& candidate_of(const FittedError& error) const {
        return effects_.errors[error.index];
    }

    std::optional<double> declared_of(const std::string& name) const {
        const auto found = evidence_.declared.find(name);
        return found == evidence_.declared.end() ? std::nullopt : std::optional(found->second);
    }

    void add(std::size_t index, bool is_camera) {
        const ErrorCandidate& one = effects_.errors[index];
        // Others do the same: half a pixel is a principal point, and X absorbs a constant offset.
        if (one.name == "half pixel" || one.name == "constant pose offset" ||
            one.name == "stage scale, all linear axes")
            return;
        const Eigen::MatrixXd freed = rows_.freed(one);
        if (!rows_.leaves_a_trace(one, freed))
            return;
        const bool is_of_pixels = one.corners_px.isZero(0.0);
        if (is_camera || is_of_pixels) {
            equations_.add(free_error(index, is_camera ? Part::camera : Part::declared, freed));
            return;
        }
        if (const auto declared = declared_of(one.name); declared && *declared > 0.0) {
            const double prior = *declared / one.size;
            equations_.add({index, Part::declared, prior * freed,
                            Eigen::VectorXd::Constant(freed.cols(), prior)});
        }
        candidates_.push_back(free_error(index, Part::beside, freed));
    }

    double freedom() const {
        return std::max(
            1.0, static_cast<double>(rows_.degrees_of_freedom()) - equations_.fitted_numbers());
    }
    double variance() const { return std::max(1.0, equations_.rest() / freedom()); }

    struct Candidate {
        std::size_t index = 0;
        double gain = 0.0, numbers = 0.0;

        // What it lowers the sum of squares by, over what chance does so seldom.
        double over(double deviations) const {
            return gain / (numbers * reduced_chi_square(deviations, numbers));
        }
    };

    // Its gain is in units of the variance that is then left.
    std::optional<Candidate> most_needed() const {
        const double free = freedom();
        std::optional<Candidate> best;
        for (std::size_t k = 0; k < candidates_.size(); ++k) {
            const auto numbers = static_cast<double>(candidates_[k].columns.cols());
            const double gain = equations_.gain(candidates_[k]);
            const double left =
                std::max(1.0, (equations_.rest() - gain) / std::max(1.0, free - numbers));
            const Candidate one{k, gain / left, numbers};
            if (!best || one.over(contradiction_deviations) > best->over(contradiction_deviations))
                best = one;
        }
        return best;
    }

    void add_candidate(std::size_t index) {
        equations_.add(candidates_[index]);
        equations_.solve();
        candidates_.erase(candidates_.begin() + static_cast<std::ptrdiff_t>(index));
    }

    // The best first, each over what chance does as seldom as 4 standard deviations.
    void find_beside() {
        for (int i = 0; i < max_beside; ++i) {
            const auto best = most_needed();
            if (!best || !(best->over(contradiction_deviations) > 1.0))
                return;
            add_candidate(best->index);
        }
    }

    // Where another error is in doubt: the larger of the effect with it and without.
    EffectAlone camera_alone() {
        const auto is_camera = [](const FittedError& error) { return error.part == Part::camera; };
        const EffectAlone without = alone(std::sqrt(variance()), is_camera);
        const auto next = most_needed();
        if (!next || !(next->over(doubtful_deviations) > 1.0))
            return without;
        add_candidate(next->index);
        const EffectAlone with = alone(std::sqrt(variance()), is_camera);
        const auto upper_size = [](const EffectAlone& effect) {
            return effect.mean_mm.norm() + 2.0 * effect.factor_mm.norm();
        };
        return upper_size(with) > upper_size(without) ? with : without;
    }

    ContradictedInput contradicted(const FittedError& error, double scatter) const {
        const ErrorCandidate& one = candidate_of(error);
        Eigen::VectorXd unit = Eigen::VectorXd::Zero(equations_.numbers().size());
        unit[error.first] = one.size * error.prior[0];
        ContradictedInput input{one.name, one.unit, *declared_of(one.name)};
        input.found = unit[error.first] * equations_.numbers()[error.first];
        const double deviation = scatter * equations_.half_inverse(unit).norm();
        input.expanded_uncertainty = 2.0 * deviation;
        input.deviations = std::abs(input.found) / std::hypot(deviation, input.declared);
        input.or_all_of = looking_the_same(one.name);
        return input;
    }

    // Marker and all linear axes larger alike: one of them off is all others off the other way.
    std::vector<std::string> looking_the_same(const std::string& name) const {
        std::set<std::string> scales{"marker print size"};
        for (const StageAxisMotion& axis : evidence_.request.axes)
            if (axis.is_linear)
                scales.insert("stage scale " + axis.name);
        if (!scales.contains(name))
            return {};
        std::vector<std::string> others;
        Eigen::VectorXd sum = Eigen::VectorXd::Zero(rows_.absorbed().rows());
        double largest = 0.0;
        for (const ErrorCandidate& one : effects_.errors) {
            if (!scales.contains(one.name))
                continue;
            const Eigen::VectorXd freed = rows_.freed(one).col(0) / one.size;
            sum += freed;
            largest = std::max(largest, freed.norm());
            if (one.name != name)
                others.push_back(one.name);
        }
        return sum.norm() < scene_alike * largest ? others : std::vector<std::string>{};
    }

    template <class IsOfIt>
    EffectAlone alone(double scatter, const IsOfIt& is_of_it) const {
        const Eigen::Index rows = effects_.after_mm.front().rows();
        Eigen::MatrixXd effects = Eigen::MatrixXd::Zero(rows, equations_.numbers().size());
        for (const FittedError& error : equations_.errors())
            if (is_of_it(error))
                effects.middleCols(error.first, error.prior.size()) =
                    effects_.after_mm[error.index] * error.prior.asDiagonal();
        return {effects * equations_.numbers(),
                scatter * equations_.half_inverse(effects.transpose()).transpose()};
    }

    std::vector<Eigen::VectorXd> residuals() const {
        const Eigen::VectorXd all = equations_.residual();
        std::vector<Eigen::VectorXd> residuals;
        Eigen::Index row = 0;
        for (const Eigen::MatrixXd& covariance : evidence_.covariance_px2) {
            const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
            residuals.emplace_back(factor.matrixL() *
                                   Eigen::VectorXd(all.segment(row, covariance.rows())));
            row += covariance.rows();
        }
        return residuals;
    }

    const DiagnosisInput& evidence_;
    const ErrorEffects& effects_;
    NuisanceProjection rows_;
    NormalEquations equations_;
    std::vector<FittedError> candidates_;
};

}  // namespace

ErrorEffects error_effects(const CandidateRequest& request) {
    ErrorEffects effects{error_candidates(request), {}};
    Eigen::MatrixXd columns(effects.errors.front().corners_px.rows(), 0);
    for (const ErrorCandidate& one : effects.errors) {
        columns.conservativeResize(Eigen::NoChange, columns.cols() + one.corners_px.cols());
        columns.rightCols(one.corners_px.cols()) = one.corners_px;
    }
    const Eigen::MatrixXd fields = fields_after_registration(request.chain, columns);
    Eigen::Index first = 0;
    for (const ErrorCandidate& one : effects.errors) {
        effects.after_mm.emplace_back(fields.middleCols(first, one.corners_px.cols()));
        first += one.corners_px.cols();
    }
    return effects;
}

JointFit joint_fit(const DiagnosisInput& evidence, const ErrorEffects& effects) {
    return Fitting(evidence, effects).result();
}

}  // namespace etalon
