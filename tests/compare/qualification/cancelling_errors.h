// Errors of the camera that others cancel in the judged field: what a verdict on the field alone
// would let pass.
#pragma once

#include <set>

#include "tests/compare/qualification/injected_errors.h"

namespace etalon {

// What a kind of error does to the judged field, to first order: by exact runs, without noise.
struct KindEffect {
    InjectedKind kind;
    bool is_camera = false;
    Eigen::VectorXd field;  // coefficients per unit of size
};

struct CancellingSet {
    std::vector<std::size_t> kinds;  // the camera's first
    std::vector<double> sizes;       // at 1x: the camera by itself just reaches a limit
};

class CancellingErrors {
public:
    CancellingErrors() : limits_(demo_run().limits) {
        const SimulatedRun exact = without_noise(demo_run());
        const Qualification told = qualify(input_of(exact, 1));
        field_ = *told.position_field;
        for (const AnalysedPose& pose : told.poses)
            volume_.push_back(pose.bias.predicted.translation);
        const std::vector<InjectedKind> kinds = all_kinds();  // the lens's first
        for (std::size_t i = 0; i < kinds.size(); ++i)
            if (!is_random(kinds[i].name))
                effects_.push_back({kinds[i], i < lens_kinds().size(), effect_of(kinds[i])});
        for (std::size_t c = 0; c < effects_.size(); ++c)
            if (effects_[c].is_camera)
                add_sets_of(c);
    }

    const std::vector<CancellingSet>& sets() const { return sets_; }

    SimulatedRun run(const CancellingSet& set, double times, SimulatedRun run = demo_run()) const {
        for (std::size_t k = 0; k < set.kinds.size(); ++k)
            effects_[set.kinds[k]].kind.inject(run, times * set.sizes[k]);
        return run;
    }

    std::string name(const CancellingSet& set) const {
        std::string all;
        for (std::size_t k = 0; k < set.kinds.size(); ++k)
            all += (k ? " and " : "") + effects_[set.kinds[k]].kind.name;
        return all;
    }

private:
    // Errors that no field follows.
    static bool is_random(const std::string& name) {
        return name.starts_with("scatter") || name.starts_with("pose ") ||
               name.find("repeats") != std::string::npos;
    }

    Eigen::VectorXd effect_of(const InjectedKind& kind) const {
        constexpr double part = 0.1;  // of a size that nobody misses
        SimulatedRun run = without_noise(demo_run());
        kind.inject(run, part * kind.easily);
        return qualify(input_of(run, 1)).position_field->coefficients / (part * kind.easily);
    }

    // Over the limits: 1 where one is just reached.
    double over_limits(const Eigen::VectorXd& coefficients) const {
        double squares = 0.0, largest = 0.0;
        for (const Eigen::Vector3d& position : volume_) {
            const double length = (field_.design(position) * coefficients).norm();
            squares += length * length / static_cast<double>(volume_.size());
            largest = std::max(largest, length);
        }
        return std::max(std::sqrt(squares) / limits_.by_quantity.at(quantity::position_rms),
                        largest / limits_.by_quantity.at(quantity::position_max));
    }

    // The stacked field over the volume.
    Eigen::MatrixXd over_volume(const Eigen::MatrixXd& coefficients) const {
        Eigen::MatrixXd all(3 * std::ssize(volume_), coefficients.cols());
        for (std::size_t i = 0; i < volume_.size(); ++i)
            all.middleRows<3>(static_cast<Eigen::Index>(3 * i)) =
                field_.design(volume_[i]) * coefficients;
        return all;
    }

    // Others at the sizes that leave least of the camera's field; kept where a run could pass.
    void add_set(std::size_t camera, const std::vector<std::size_t>& others) {
        constexpr double could_pass = 0.3;
        const double size = 1.0 / over_limits(effects_[camera].field);
        Eigen::MatrixXd columns(effects_[camera].field.size(), std::ssize(others));
        for (std::size_t k = 0; k < others.size(); ++k)
            columns.col(static_cast<Eigen::Index>(k)) = effects_[others[k]].field;
        const Eigen::VectorXd unscale = columns.colwise().norm().cwiseInverse();
        const Eigen::VectorXd sizes = unscale.cwiseProduct(
            over_volume(columns * unscale.asDiagonal())
                .colPivHouseholderQr()
                .solve(Eigen::VectorXd(-size * over_volume(effects_[camera].field))));
        if (over_limits(size * effects_[camera].field + columns * sizes) > could_pass)
            return;
        CancellingSet set{{camera}, {size}};
        for (std::size_t k = 0; k < others.size(); ++k) {
            set.kinds.push_back(others[k]);
            set.sizes.push_back(sizes[static_cast<Eigen::Index>(k)]);
        }
        sets_.push_back(set);
    }

    void add_sets_of(std::size_t camera) {
        for (std::size_t i = 0; i < effects_.size(); ++i) {
            if (effects_[i].is_camera)
                continue;
            add_set(camera, {i});
            for (std::size_t k = 0; k < i; ++k)
                if (!effects_[k].is_camera)
                    add_set(camera, {i, k});
        }
    }

    Limits limits_;
    BiasField field_;
    std::vector<Eigen::Vector3d> volume_;
    std::vector<KindEffect> effects_;
    std::vector<CancellingSet> sets_;
};

// A run in which everything that the station declares is off as it is declared.
inline SimulatedRun honest_run(std::uint64_t seed) {
    SimulatedRun run = demo_run();
    RandomStream random(seed, 200);
    for (std::size_t k = 0; k < run.true_scale.size(); ++k)
        run.true_scale[k] += *run.axes[k].scale_uncertainty * random.normal();
    run.marker_scale += 20e-6 * random.normal();
    run.marker_twist_mm += 0.01 * random.normal();
    return run;
}

// What two runs of one plan share: for many of them.
struct KnownRun {
    Qualification told = qualify(input_of(demo_run(), 1));
    NoiseDraws draws{1};

    Qualification judged(const SimulatedRun& run, std::uint64_t seed) const {
        QualificationInput input = input_of(run, seed);
        input.options.known_run = &told;
        input.options.known_draws = &draws;
        input.options.measure_reported = false;
        return qualify(input);
    }
};

// Whether a run would have got PASS by its quantities and the conditions on noise and outliers.
inline bool passes_by_field_alone(const Qualification& result) {
    static const std::set<std::string> of_corners{"residuals over the image", "declared inputs",
                                                  "camera alone", "edges alone"};
    return combine(result.quantities) == Outcome::pass &&
           std::ranges::none_of(result.conditions, [&](const AcceptanceCondition& each) {
               return each.state == AcceptanceCondition::State::not_met &&
                      !of_corners.contains(each.name);
           });
}

}  // namespace etalon
