#include "compare/qualification/qualification_budget.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>

#include "compare/qualification/diagnosis_input.h"
#include "compare/qualification/judged_quantities.h"

namespace etalon {
namespace {

constexpr double mrad = 1e-3;
// The widest plausible value of what a station may leave undeclared.
constexpr double max_flatness = 0.01;  // of the distance from the marker's centre to its edge

double checked(const std::string& source, double uncertainty) {
    if (!std::isfinite(uncertainty) || uncertainty < 0.0)
        throw NumericalError(
            fmt::format("qualification: the uncertainty of '{}' is {}", source, uncertainty));
    return uncertainty;
}

BudgetRow declared(std::string source, std::string unit, const std::optional<double>& uncertainty) {
    if (uncertainty)
        checked(source, *uncertainty);
    return {.source = std::move(source),
            .standard_uncertainty = uncertainty,
            .unit = std::move(unit),
            .basis = uncertainty ? "declared by the station"
                                 : "unknown: the station does not declare it"};
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

// Hold-out errors per unit of an input: of positions, mm, and of rotations, rad.
using Effect = Eigen::MatrixX2d;

Effect effect_of(const ErrorSignature& signature) {
    Effect effect(signature.after.size(), 2);
    effect << signature.after, signature.rotation_after;
    return effect * (1.0 / std::abs(signature.size));
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
                           effect_of(*signature(term.error.name)));
        for (const DeclaredRepeatability& each : input_.repeatability)
            add_repeatability(each);
        for (const DeclaredErrorMap& map : input_.error_maps)
            add_error_map(map);
        add_effect(declared("marker print size", "1", input_.marker_size_uncertainty),
                   effect_of(*signature("marker print size")));
        add_flatness();
        add_temperature();
        add_render();
        add_detector_bias();
        add_calibration(calibration);
        return std::move(budget_);
    }

private:
    // That of marker twist, bow and edge shrink may be missing.
    const ErrorSignature* signature(const std::string& name, bool may_be_missing = false) const {
        const auto found = std::ranges::find(result_.signatures, name, &ErrorSignature::name);
        if (found != result_.signatures.end())
            return &*found;
        if (!may_be_missing)
            throw NumericalError(fmt::format("qualification: '{}' has no signature", name));
        return nullptr;
    }

    // By which shifts, a column each, change a length at most; 0 where no lengths are measured.
    double largest_lengthening(const Eigen::MatrixXd& shifts) const {
        return lengthening_ ? lengthening_->largest(shifts).lengthening : 0.0;
    }

    void set_sensitivity(BudgetRow& row, const Effect& effect) const {
        const Eigen::VectorXd position_mm = effect.col(0), rotation_rad = effect.col(1);
        row.sensitivity = by_position(rms_norm(position_mm), max_norm(position_mm),
                                      largest_lengthening(position_mm));
        row.sensitivity[quantity::rotation_rms] = rms_norm(rotation_rad) / mrad;
        row.sensitivity[quantity::rotation_max] = max_norm(rotation_rad) / mrad;
    }

    void add_effect(BudgetRow row, const Effect& effect) {
        set_sensitivity(row, effect);
        if (row.counted && row.standard_uncertainty)
            budget_.inputs.push_back({*row.standard_uncertainty * effect.col(0), row.distribution,
                                      row.degrees_of_freedom});
        budget_.rows.push_back(std::move(row));
    }

    void add_noise_of(const char* source, const char* unit, double residual, const BiasField& field,
                      const std::string& basis, std::initializer_list<const char*> quantities) {
        BudgetRow& row = budget_.rows.emplace_back(
            BudgetRow{.source = source,
                      .standard_uncertainty = residual,
                      .unit = unit,
                      .degrees_of_freedom = 1.0 * field.degrees_of_freedom,
                      .basis = basis});
        contribute_noise(row, result_, quantities);
    }

    void add_noise() {
        const auto residuals = [](const BiasField& field) {
            return fmt::format("residuals of {} hold-out poses", field.samples);
        };
        const std::string along = ", along the line of sight";
        const BiasField& field = *result_.position_field;
        add_noise_of("image noise", "mm", field.residual_along, field, residuals(field) + along,
                     {quantity::position_rms, quantity::position_max, quantity::length_max});
        if (const auto& turns = result_.rotation_field)
            add_noise_of("image noise, rotations", "mrad",
                         std::max(turns->residual_along, turns->residual_across) / mrad, *turns,
                         residuals(*turns), {quantity::rotation_rms, quantity::rotation_max});
        if (const auto& rest = result_.position_lack_of_fit)
            add_noise_of("image noise, rest", "mm", rest->noise_rms, field,
                         "repeated frames and declared repeatability", {quantity::lack_of_fit_rms});
        if (result_.photometric) {
            const BiasField& b4 = result_.photometric->position_field;
            add_noise_of("image noise, photometric poses", "mm", b4.residual_along, b4,
                         residuals(b4) + along,
                         {quantity::photometric_rms, quantity::photometric_max});
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
        const auto used = result_.registration->used.size();
        const double residuals = 2.0 * static_cast<double>(input_.points_mm.size() * used);
        BudgetRow row{.source = "registration",
                      .standard_uncertainty = registration.residual_rms_px,
                      .unit = "px",
                      .degrees_of_freedom = std::max(1.0, residuals - registration.rank),
                      .basis = fmt::format("corner residuals of {} training poses", used)};
        const Matrix12d covariance =
            registration.covariance * std::pow(registration.residual_rms_px, 2);
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen{Eigen::MatrixXd(covariance)};
        const Matrix12d factor =
            eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
        double shift = 0.0, turn = 0.0, largest_shift = 0.0, largest_turn = 0.0;
        Eigen::MatrixXd shifts(3 * std::ranges::count_if(result_.poses, &AnalysedPose::is_judged),
                               12);
        Eigen::Index judged = 0;
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
                shifts.middleRows<3>(3 * judged++) = ways.bottomRows<3>();
        }
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
        budget_.rows.push_back(
            {.source = "detector bias (B1)",
             .standard_uncertainty = std::sqrt(squares / std::max(1, count)),
             .unit = "mm",
             .basis = "in photograph and render alike: drops out of B3, is not in B4",
             .counted = false});
    }

    // Part of the residuals too; kept because a few poses may show less than was declared.
    void add_repeatability(const DeclaredRepeatability& each) {
        BudgetRow row = declared("stage repeatability " + each.axis, "mm", each.marker_mm);
        const BiasField& field = *result_.position_field;
        const double samples = field.samples;
        const double coefficients = static_cast<double>(field.coefficients.size()) / 3.0;
        const double rms = 1.0 / std::sqrt(samples), max = std::sqrt(coefficients / samples);
        row.sensitivity = by_position(rms, max, std::sqrt(2.0) * max);
        budget_.rows.push_back(std::move(row));
    }

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
            const ErrorSignature* bent = signature(name, true);
            if (!bent)
                continue;
            BudgetRow row = declared(name, "mm", input_.marker_flatness_mm);
            if (!input_.marker_flatness_mm)
                row.widest = max_flatness * reach;
            add_effect(std::move(row), effect_of(*bent));
        }
    }

    // Marker and stage grow together: their effects are added with their signs.
    void add_temperature() {
        BudgetRow row = declared("temperature", "K", std::nullopt);
        const Effect marker = effect_of(*signature("marker print size"));
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
            if (term.error.is_linear_scale)
                effect +=
                    effect_of(*signature(term.error.name)) * temperature.stage_expansion_per_k;
        add_effect(std::move(row), effect);
    }

    // A bound: anything within it is as likely. Saddle points of a chessboard do not move with
    // edges.
    void add_render() {
        const double bound_px = input_.render_edge_bound_px;
        const ErrorSignature* edges = signature("edge shrink", true);
        if (bound_px == 0.0 || !edges)
            return;
        const char* source = "render convergence";
        add_effect(
            {.source = source,
             .standard_uncertainty = checked(source, bound_px) / std::sqrt(3.0),
             .unit = "px",
             .distribution = Distribution::uniform,
             .basis = fmt::format("the renderer's tolerance: edges within {:.2g} px", bound_px)},
            effect_of(*edges));
    }

    // What the calibration is off by is measured: shown, not counted.
    void add_calibration(std::span<const ErrorSignature> calibration) {
        BudgetRow row{.source = "calibration covariance",
                      .unit = "1",
                      .basis = "unknown: the calibration states none",
                      .counted = false};
        if (!calibration.empty()) {
            row.standard_uncertainty = 1.0;
            row.basis = fmt::format(
                "stated by the calibration, {} directions, not in U: its error is what is measured",
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
