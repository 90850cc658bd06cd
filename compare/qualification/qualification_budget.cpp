#include "compare/qualification/qualification_budget.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "compare/diagnosis/error_signatures.h"
#include "compare/qualification/diagnosis_input.h"
#include "compare/qualification/judged_quantities.h"
#include "compare/uncertainty/length_error.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double mrad = 1e-3;
// The widest plausible value of what a station may leave undeclared.
constexpr double max_flatness = 0.01;  // of the distance from the marker's centre to its edge

constexpr const char* not_declared = "unknown: the station does not declare it";

double checked(const std::string& source, double uncertainty) {
    if (!std::isfinite(uncertainty) || uncertainty < 0.0)
        throw NumericalError(
            fmt::format("qualification: the uncertainty of '{}' is {}", source, uncertainty));
    return uncertainty;
}

BudgetRow declared(std::string source, std::string unit, const std::optional<double>& uncertainty) {
    BudgetRow row;
    row.source = std::move(source);
    row.unit = std::move(unit);
    row.basis = uncertainty ? "declared by the station" : not_declared;
    if (uncertainty)
        row.standard_uncertainty = checked(row.source, *uncertainty);
    return row;
}

// The sensitivity that gives this contribution at the row's own standard uncertainty.
void contribute(BudgetRow& row, const std::string& quantity, double contribution) {
    const double size = row.standard_uncertainty.value_or(0.0);
    if (size > 0.0)
        row.sensitivity[quantity] = contribution / size;
}

// Of the part of U that the photographs' noise makes; nothing to what is not measured.
void contribute_noise(BudgetRow& row, const Qualification& result,
                      std::initializer_list<const char*> quantities) {
    for (const char* name : quantities)
        if (const auto measured = quantity_kind(name).measured(result))
            contribute(row, name, measured->noise_uncertainty / field_coverage_factor);
}

// What moves positions counts in the fields of B3 and B4 alike.
std::map<std::string, double> by_position(double rms, double max, double length) {
    return {{quantity::position_rms, rms},
            {quantity::position_max, max},
            {quantity::photometric_rms, rms},
            {quantity::photometric_max, max},
            {quantity::length_max, length}};
}

void contribute_positions(BudgetRow& row, double rms, double max, double length) {
    for (const auto& [name, contribution] : by_position(rms, max, length))
        contribute(row, name, contribution);
}

// Hold-out errors per unit of an input.
struct Effect {
    Eigen::VectorXd position_mm, rotation_rad;

    Effect& operator+=(const Effect& other) {
        position_mm += other.position_mm;
        rotation_rad += other.rotation_rad;
        return *this;
    }
    Effect operator*(double factor) const { return {factor * position_mm, factor * rotation_rad}; }
};

Effect effect_of(const ErrorSignature& signature) {
    const double per_unit = 1.0 / std::abs(signature.size);
    return Effect{signature.after, signature.rotation_after} * per_unit;
}

class Builder {
public:
    Builder(const QualificationInput& input, const Qualification& result,
            std::span<const FieldSample> samples)
        : input_(input), result_(result) {
        if (result.lengths)
            lengthening_.emplace(samples);
    }

    QualificationBudget build(std::span<const ErrorSignature> calibration) {
        add_noise();
        add_registration();
        for (const DeclaredStageTerm& term : input_.stage_terms)
            if (term.in_budget)
                add_effect(declared(term.error.name, term.error.unit, term.standard_uncertainty),
                           effect_of(signature(term.error.name)));
        for (const DeclaredRepeatability& each : input_.repeatability)
            add_repeatability(each);
        for (const DeclaredErrorMap& map : input_.error_maps)
            add_error_map(map);
        add_effect(declared("marker print size", "1", input_.marker_size_uncertainty),
                   effect_of(signature("marker print size")));
        add_flatness();
        add_temperature();
        add_render();
        add_detector_bias();
        add_calibration(calibration);
        return std::move(budget_);
    }

private:
    const ErrorSignature& signature(const std::string& name) const {
        const auto found = std::ranges::find(result_.signatures, name, &ErrorSignature::name);
        if (found == result_.signatures.end())
            throw NumericalError(fmt::format("qualification: '{}' has no signature", name));
        return *found;
    }
    bool has_signature(const std::string& name) const {
        return std::ranges::find(result_.signatures, name, &ErrorSignature::name) !=
               result_.signatures.end();
    }

    // By which shifts, a column each, change a length at most; 0 where no lengths are measured.
    double largest_lengthening(const Eigen::MatrixXd& shifts) const {
        return lengthening_ ? lengthening_->largest(shifts).lengthening : 0.0;
    }

    void set_sensitivity(BudgetRow& row, const Effect& effect) const {
        row.sensitivity = by_position(rms_norm(effect.position_mm), max_norm(effect.position_mm),
                                      largest_lengthening(effect.position_mm));
        row.sensitivity[quantity::rotation_rms] = rms_norm(effect.rotation_rad) / mrad;
        row.sensitivity[quantity::rotation_max] = max_norm(effect.rotation_rad) / mrad;
    }

    void add_effect(BudgetRow row, const Effect& effect) {
        set_sensitivity(row, effect);
        if (row.counted && row.standard_uncertainty)
            budget_.inputs.push_back({*row.standard_uncertainty * effect.position_mm,
                                      row.distribution, row.degrees_of_freedom});
        budget_.rows.push_back(std::move(row));
    }

    // --------------------------------------------------------------------- from the run itself

    static BudgetRow noise_row(const char* source, const char* unit, double residual,
                               const BiasField& field) {
        BudgetRow row;
        row.source = source;
        row.unit = unit;
        row.standard_uncertainty = residual;
        row.degrees_of_freedom = field.degrees_of_freedom;
        row.basis = fmt::format("residuals of {} hold-out poses", field.samples);
        return row;
    }

    void add_noise() {
        const BiasField& field = *result_.position_field;
        BudgetRow row = noise_row("image noise", "mm", field.residual_along, field);
        row.basis += ", along the line of sight";
        contribute_noise(row, result_,
                         {quantity::position_rms, quantity::position_max, quantity::length_max});
        budget_.rows.push_back(row);

        if (const auto& turns = result_.rotation_field) {
            row = noise_row("image noise, rotations", "mrad",
                            std::max(turns->residual_along, turns->residual_across) / mrad, *turns);
            contribute_noise(row, result_, {quantity::rotation_rms, quantity::rotation_max});
            budget_.rows.push_back(row);
        }

        if (const auto& rest = result_.position_lack_of_fit) {
            row = noise_row("image noise, rest", "mm", rest->noise_rms, field);
            row.basis = "repeated frames and declared repeatability";
            contribute_noise(row, result_, {quantity::lack_of_fit_rms});
            budget_.rows.push_back(row);
        }
        if (const auto& photometric = result_.photometric) {
            row =
                noise_row("image noise, photometric poses", "mm",
                          photometric->position_field.residual_along, photometric->position_field);
            row.basis += ", along the line of sight";
            contribute_noise(row, result_, {quantity::photometric_rms, quantity::photometric_max});
            budget_.rows.push_back(row);
        }
    }

    // Shift and turn of the predicted marker when X and Y move: 6 x 12, turn above shift.
    Eigen::Matrix<double, 6, 12> moved_by_registration(const Rigid& base_from_carriage) const {
        const Registration& registration = result_.registration->registration;
        const Eigen::Matrix3d turn =
            (registration.camera_from_base.rotation * base_from_carriage.rotation)
                .toRotationMatrix();
        const Eigen::Vector3d arm =
            registration.camera_from_base.rotation *
            (base_from_carriage * registration.carriage_from_marker.translation);
        Eigen::Matrix<double, 6, 12> moved = Eigen::Matrix<double, 6, 12>::Zero();
        moved.topLeftCorner<3, 3>().setIdentity();
        moved.block<3, 3>(0, 6) = turn;
        for (int k = 0; k < 3; ++k)
            moved.block<3, 1>(3, k) = Eigen::Vector3d::Unit(k).cross(arm);
        moved.block<3, 3>(3, 3).setIdentity();
        moved.bottomRightCorner<3, 3>() = turn;
        return moved;
    }

    void add_registration() {
        const Registration& registration = result_.registration->registration;
        BudgetRow row;
        row.source = "registration";
        row.unit = "px";
        row.standard_uncertainty = registration.residual_rms_px;
        const auto poses = result_.registration->used.size();
        row.degrees_of_freedom = std::max(
            1.0, 2.0 * static_cast<double>(input_.points_mm.size() * poses) - registration.rank);
        row.basis = fmt::format("corner residuals of {} training poses", poses);

        const Matrix12d covariance =
            registration.covariance * std::pow(registration.residual_rms_px, 2);
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen{Eigen::MatrixXd(covariance)};
        const Matrix12d factor =
            eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
        double shift = 0.0, turn = 0.0, largest_shift = 0.0, largest_turn = 0.0;
        std::vector<Eigen::Matrix<double, 3, 12>> hold_out;
        for (const AnalysedPose& pose : result_.poses) {
            const Eigen::Matrix<double, 6, 12> ways =
                moved_by_registration(pose.base_from_carriage) * factor;
            const double turned = ways.topRows<3>().squaredNorm();
            const double shifted = ways.bottomRows<3>().squaredNorm();
            turn += turned / static_cast<double>(result_.poses.size());
            shift += shifted / static_cast<double>(result_.poses.size());
            largest_turn = std::max(largest_turn, turned);
            largest_shift = std::max(largest_shift, shifted);
            if (pose.is_judged())
                hold_out.emplace_back(ways.bottomRows<3>());
        }
        Eigen::MatrixXd shifts(3 * std::ssize(hold_out), 12);
        for (std::size_t i = 0; i < hold_out.size(); ++i)
            shifts.middleRows<3>(static_cast<Eigen::Index>(3 * i)) = hold_out[i];

        contribute_positions(row, std::sqrt(shift), std::sqrt(largest_shift),
                             largest_lengthening(shifts));
        contribute(row, quantity::rotation_rms, std::sqrt(turn) / mrad);
        contribute(row, quantity::rotation_max, std::sqrt(largest_turn) / mrad);
        budget_.inputs.push_back({shifts, row.distribution, row.degrees_of_freedom});
        budget_.rows.push_back(std::move(row));
    }

    // The detector's bias stands in photograph and render alike.
    void add_detector_bias() {
        double squares = 0.0;
        int count = 0;
        for (const AnalysedPose& pose : result_.poses)
            if (pose.hold_out && pose.bias.b1) {
                squares += pose.bias.b1->translation_mm.squaredNorm();
                ++count;
            }
        BudgetRow row;
        row.source = "detector bias (B1)";
        row.unit = "mm";
        row.standard_uncertainty = std::sqrt(squares / std::max(1, count));
        row.basis = "in photograph and render alike: drops out of B3, is not in B4";
        row.counted = false;
        budget_.rows.push_back(std::move(row));
    }

    // ------------------------------------------------------------------ declared by the station

    // As independent noise on every hold-out pose. Part of the residuals too; kept because a few
    // poses may show less than was declared.
    void add_repeatability(const DeclaredRepeatability& each) {
        BudgetRow row = declared("stage repeatability " + each.axis, "mm", each.marker_mm);
        const BiasField& field = *result_.position_field;
        const double samples = field.samples;
        const double coefficients = static_cast<double>(field.coefficients.size()) / 3.0;
        const double rms = 1.0 / std::sqrt(samples), max = std::sqrt(coefficients / samples);
        row.sensitivity = by_position(rms, max, std::sqrt(2.0) * max);
        // It is taken out of the rest as noise: with its value unknown the rest is too large.
        budget_.rows.push_back(std::move(row));
    }

    // Its points may be wrong together in whatever way hurts most: it counts in full.
    void add_error_map(const DeclaredErrorMap& map) {
        BudgetRow row = declared("stage error map " + map.axis, "mm", map.marker_rms_mm);
        row.basis = "the map's own uncertainties";
        const double max = checked(row.source, map.marker_max_mm);
        contribute_positions(row, map.marker_rms_mm, max, 2.0 * max);
        budget_.inputs.push_back({Eigen::VectorXd::Constant(3 * result_.position_field->samples,
                                                            map.marker_rms_mm / std::sqrt(3.0))});
        budget_.rows.push_back(std::move(row));
    }

    void add_flatness() {
        double reach = 0.0;
        for (const Eigen::Vector3d& point : input_.points_mm)
            reach = std::max(reach, point.norm());
        for (const char* name : {"marker twist", "marker bow"}) {
            if (!has_signature(name))
                continue;
            BudgetRow row = declared(name, "mm", input_.marker_flatness_mm);
            if (!input_.marker_flatness_mm)
                row.widest = max_flatness * reach;
            add_effect(std::move(row), effect_of(signature(name)));
        }
    }

    // Marker and stage grow together as far as they are of one material: their effects are added
    // with their signs.
    void add_temperature() {
        BudgetRow row = declared("temperature", "K", std::nullopt);
        const Effect marker = effect_of(signature("marker print size"));
        if (!input_.temperature) {
            row.widest = max_temperature_k;
            add_effect(std::move(row), marker * max_expansion_per_k);
            return;
        }
        const DeclaredTemperature& temperature = *input_.temperature;
        row.standard_uncertainty = checked(row.source, temperature.standard_uncertainty_k);
        row.degrees_of_freedom = temperature.degrees_of_freedom;
        row.basis =
            fmt::format("{}, expanding by {:.3g} (marker) and {:.3g} (stage) per kelvin",
                        temperature.basis.empty() ? "declared by the station" : temperature.basis,
                        temperature.marker_expansion_per_k, temperature.stage_expansion_per_k);
        Effect effect = marker * temperature.marker_expansion_per_k;
        for (const DeclaredStageTerm& term : input_.stage_terms)
            if (term.is_linear_scale)
                effect += effect_of(signature(term.error.name)) * temperature.stage_expansion_per_k;
        add_effect(std::move(row), effect);
    }

    // A bound, not a scatter: anything within it is as likely. Corners of a chessboard are saddle
    // points and stay where they are when edges move.
    void add_render() {
        if (input_.render_edge_bound_px == 0.0 || !has_signature("edge shrink"))
            return;
        BudgetRow row;
        row.source = "render convergence";
        row.unit = "px";
        row.distribution = Distribution::uniform;
        row.standard_uncertainty =
            checked(row.source, input_.render_edge_bound_px) / std::sqrt(3.0);
        row.basis = fmt::format("the renderer's tolerance: edges within {:.2g} px",
                                input_.render_edge_bound_px);
        add_effect(std::move(row), effect_of(signature("edge shrink")));
    }

    // The field that the calibration's own covariance lets expect. Not of the measurement: what the
    // calibration is off by is what is measured.
    void add_calibration(std::span<const ErrorSignature> calibration) {
        BudgetRow row;
        row.source = "calibration covariance";
        row.unit = "1";
        row.counted = false;
        row.basis = "unknown: the calibration states none";
        if (!calibration.empty()) {
            row.standard_uncertainty = 1.0;
            row.basis = fmt::format(
                "stated by the calibration, {} directions, not in U: its error "
                "is what is measured",
                calibration.size());
        }
        for (const ErrorSignature& direction : calibration) {
            BudgetRow one;
            set_sensitivity(one, effect_of(direction));
            for (const auto& [name, sensitivity] : one.sensitivity)
                row.sensitivity[name] = std::hypot(row.sensitivity[name], sensitivity);
        }
        budget_.rows.push_back(std::move(row));
    }

    const QualificationInput& input_;
    const Qualification& result_;
    std::optional<PairLengthening> lengthening_;
    QualificationBudget budget_;
};

}  // namespace

QualificationBudget qualification_budget(const QualificationInput& input,
                                         const Qualification& result,
                                         std::span<const FieldSample> position_samples,
                                         std::span<const ErrorSignature> calibration) {
    return Builder(input, result, position_samples).build(calibration);
}

}  // namespace etalon
