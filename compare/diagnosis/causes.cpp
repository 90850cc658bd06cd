#include "compare/diagnosis/causes.h"

#include <fmt/format.h>

#include <fmt/ranges.h>
#include <Eigen/Dense>
#include <algorithm>
#include <complex>
#include <deque>
#include <limits>
#include <numbers>
#include <numeric>

#include "compare/diagnosis/cause_rows.h"

namespace etalon {
namespace {

using Set = std::vector<std::size_t>;  // of candidates: ascending indices
using Scores = std::map<Set, double>;  // logs, or probabilities

Set with(Set set, std::size_t member) {
    set.insert(std::ranges::upper_bound(set, member), member);
    return set;
}

Set without(Set set, std::size_t member) {
    std::erase(set, member);
    return set;
}

// Products of all candidates' columns with each other and with the observed. They must outlive it.
class HypothesisSet {
public:
    explicit HypothesisSet(Observation of) : of_(std::move(of)) {}

    HypothesisSet only(const Set& set) const {
        HypothesisSet few(of_);
        for (const std::size_t i : set)
            few.add(candidate(i), columns_.middleCols(candidates_[i].first, candidates_[i].count));
        return few;
    }

    // `freed`: its columns, freed of X and Y. Leaves out nothing: ask leaves_a_trace() before.
    void add(const ErrorCandidate& candidate, const Eigen::MatrixXd& freed) {
        const Eigen::Index before = columns_.cols(), count = freed.cols();
        columns_.conservativeResize(of_.values.size(), before + count);
        columns_.rightCols(count) = freed;
        const Eigen::MatrixXd mixed = of_.metric->product(columns_, freed);
        products_.conservativeResize(before + count, before + count);
        products_.rightCols(count) = mixed;
        products_.bottomRows(count) = mixed.transpose();
        seen_.conservativeResize(before + count);
        seen_.tail(count) = of_.metric->product(freed, of_.values);
        candidates_.push_back({&candidate, before, count});
    }

    std::size_t size() const { return candidates_.size(); }
    const ErrorCandidate& candidate(std::size_t i) const { return *candidates_[i].candidate; }

    // In units of the candidates' sizes; nothing where columns cannot be told apart at all.
    struct Fit {
        Eigen::VectorXd numbers;
        double rest = 0.0;  // sum of squares that is left
    };
    std::optional<Fit> fit(const Set& set) const {
        const std::vector<Eigen::Index> at = columns_of(set);
        const Eigen::MatrixXd plain = products_(at, at);
        const Eigen::VectorXd unscale = plain.diagonal().cwiseSqrt().cwiseInverse();
        const Eigen::LDLT<Eigen::MatrixXd> solver(
            Eigen::MatrixXd(unscale.asDiagonal() * plain * unscale.asDiagonal()));
        constexpr double apart = 1e-5;  // of the last column's square
        if (!at.empty() && !(solver.vectorD().minCoeff() > apart))
            return std::nullopt;
        const Eigen::VectorXd seen = seen_(at);
        Fit fit;
        fit.numbers =
            unscale.cwiseProduct(solver.solve(Eigen::VectorXd(unscale.cwiseProduct(seen))));
        fit.rest = of_.square - seen.dot(fit.numbers);
        return fit;
    }

    // Of the numbers of a set that can be told apart.
    Eigen::MatrixXd covariance(const Set& set) const {
        const std::vector<Eigen::Index> at = columns_of(set);
        return products_(at, at).inverse();
    }

    // What a set leaves of the observed, weighted as the covariance says.
    Eigen::VectorXd residual(const Set& set) const {
        const std::vector<Eigen::Index> at = columns_of(set);
        const Eigen::VectorXd explained = columns_(Eigen::all, at) * fit(set)->numbers;
        return of_.metric->weighted(of_.values - explained);
    }

    // Of the corners that an explanation leaves, over what is stated; 1 at least.
    double scatter(const Fit& fit) const {
        return std::sqrt(
            std::max(1.0, fit.rest / (of_.freedom - static_cast<double>(fit.numbers.size()))));
    }

    // Log of the posterior odds, up to a constant: the likelihood, with the corners' scatter at its
    // best value from 1 up, Schwarz's price of each number, and the prior.
    double score(const Set& set) const {
        const auto found = fit(set);
        if (!found)
            return -std::numeric_limits<double>::infinity();
        const double enlarged = std::max(1.0, found->rest / of_.freedom);
        double score = -0.5 * (of_.log_determinant + found->rest / enlarged +
                               of_.freedom * std::log(enlarged)) -
                       0.5 * static_cast<double>(found->numbers.size()) * std::log(of_.freedom);
        for (const std::size_t i : set)
            score -= std::log(of_.known * candidate(i).tried);
        return score;
    }

private:
    std::vector<Eigen::Index> columns_of(const Set& set) const {
        std::vector<Eigen::Index> at;
        for (const std::size_t i : set)
            for (Eigen::Index k = 0; k < candidates_[i].count; ++k)
                at.push_back(candidates_[i].first + k);
        return at;
    }

    struct Place {
        const ErrorCandidate* candidate;
        Eigen::Index first, count;
    };

    Observation of_;
    Eigen::MatrixXd columns_, products_;
    Eigen::VectorXd seen_;
    std::vector<Place> candidates_;
};

std::vector<Set> best_of(const Scores& scores, std::size_t members, std::size_t count) {
    std::vector<std::pair<double, Set>> of_size;
    for (const auto& [set, score] : scores)
        if (set.size() == members)
            of_size.emplace_back(-score, set);
    std::ranges::sort(of_size);
    std::vector<Set> best;
    for (std::size_t i = 0; i < std::min(count, of_size.size()); ++i)
        best.push_back(of_size[i].second);
    return best;
}

// Nothing, every candidate, every pair, and the best larger sets grown from the best smaller ones.
Scores all_scores(const HypothesisSet& comparison) {
    constexpr std::size_t most_members = 4, grown_from = 40;
    Scores scores{{{}, comparison.score({})}};
    for (std::size_t members = 0; members < most_members; ++members) {
        const std::size_t bases =
            members < 2 ? std::numeric_limits<std::size_t>::max() : grown_from;
        for (const Set& base : best_of(scores, members, bases))
            for (std::size_t i = 0; i < comparison.size(); ++i)
                if (!std::ranges::binary_search(base, i))
                    if (const Set set = with(base, i); !scores.contains(set))
                        scores[set] = comparison.score(set);
    }
    return scores;
}

double log_sum(const Scores& scores, double one_more) {
    double largest = one_more;
    for (const auto& [set, score] : scores)
        largest = std::max(largest, score);
    double sum = std::exp(one_more - largest);
    for (const auto& [set, score] : scores)
        sum += std::exp(score - largest);
    return largest + std::log(sum);
}

CausingError described(const HypothesisSet& comparison, const Set& set, std::size_t member) {
    const auto fit = comparison.fit(set);
    Eigen::Index first = 0;
    for (const std::size_t i : set)
        if (i < member)
            first += comparison.candidate(i).corners_px.cols();
    const ErrorCandidate& candidate = comparison.candidate(member);
    const Eigen::Index length = candidate.corners_px.cols();
    const Eigen::VectorXd numbers = fit->numbers.segment(first, length);
    const Eigen::MatrixXd covariance =
        comparison.covariance(set).block(first, first, length, length);
    const double size = length == 1 ? numbers[0] : numbers.norm();
    const Eigen::VectorXd along =
        length == 1 ? Eigen::VectorXd::Ones(1) : Eigen::VectorXd(numbers.normalized());
    const double deviation =
        std::sqrt(along.dot(covariance * along)) * candidate.size * comparison.scatter(*fit);
    return {{candidate.name},
            size * candidate.size,
            2.0 * deviation,
            candidate.unit,
            {candidate.remedy}};
}

// A set that scores no more than one of its subsets gives its probability to that.
Scores probabilities(const Scores& scores, double log_total) {
    Scores of_needed;
    for (const auto& [set, score] : scores) {
        Set needed = set;
        for (std::size_t i = 0; i < needed.size();) {
            const auto subset = scores.find(without(needed, needed[i]));
            const bool is_enough = subset != scores.end() && subset->second >= scores.at(needed);
            needed = is_enough ? subset->first : needed;
            i = is_enough ? 0 : i + 1;
        }
        of_needed[needed] += std::exp(score - log_total);
    }
    return of_needed;
}

// Takes sets of as many members or more that are as good and hold none of these, best first.
void claim_instead(const HypothesisSet& comparison, const std::vector<Set>& these, double least,
                   Scores& left, Cause& cause) {
    std::vector<std::pair<double, Set>> others;
    for (const auto& entry : left)
        if (entry.first.size() >= these.front().size() && entry.second > least &&
            std::ranges::none_of(
                these, [&](const Set& one) { return std::ranges::includes(entry.first, one); }))
            others.emplace_back(-entry.second, entry.first);
    std::ranges::sort(others);
    for (const auto& [negative, set] : others) {
        std::vector<std::string>& names = cause.instead.emplace_back();
        for (const std::size_t i : set)
            names.push_back(comparison.candidate(i).name);
        cause.probability -= negative;
        left.erase(set);
    }
}

// The best unclaimed set with those that differ from it in one member, or in more.
Cause claimed(const HypothesisSet& comparison, const Set& best, Scores& left) {
    constexpr double as_good = 0.01;
    const double probability = left.at(best);
    Cause cause{{}, probability};
    left.erase(best);
    std::vector<Set> these{best};
    for (const std::size_t member : best) {
        CausingError error = described(comparison, best, member);
        std::vector<std::pair<double, std::size_t>> others;
        for (std::size_t i = 0; i < comparison.size(); ++i) {
            const auto swapped = left.find(with(without(best, member), i));
            if (swapped != left.end() && swapped->second > as_good * probability)
                others.emplace_back(-swapped->second, i);
        }
        std::ranges::sort(others);
        for (const auto& [negative, i] : others) {
            error.names.push_back(comparison.candidate(i).name);
            error.remedies.push_back(comparison.candidate(i).remedy);
            cause.probability -= negative;
            these.push_back(with(without(best, member), i));
            left.erase(these.back());
        }
        cause.errors.push_back(std::move(error));
    }
    if (best.size() > 1)
        claim_instead(comparison, these, as_good * probability, left, cause);
    return cause;
}

// Any smooth change over the volume: linear and quadratic in the position, linear in the rotation.
ErrorCandidate smooth_change(const SignatureChain& chain) {
    Eigen::Matrix3Xd positions(3, std::ssize(chain.poses));
    for (std::size_t i = 0; i < chain.poses.size(); ++i)
        positions.col(static_cast<Eigen::Index>(i)) = chain.camera_from_marker(i).translation;
    const Eigen::Vector3d low = positions.rowwise().minCoeff(),
                          high = positions.rowwise().maxCoeff();
    const auto rows = static_cast<Eigen::Index>(2 * chain.points_mm.size());
    ErrorCandidate smooth{"none of these", "", "", 1.0, {}};
    smooth.corners_px.resize(rows * positions.cols(), 36);
    for (Eigen::Index i = 0; i < positions.cols(); ++i) {
        const Eigen::Vector3d p =
            (2.0 * positions.col(i) - low - high).cwiseQuotient((high - low).cwiseMax(1e-9));
        Eigen::VectorXd terms(12);
        terms << p, p.cwiseProduct(p), p.x() * p.y(), p.y() * p.z(), p.z() * p.x(), p;
        const Eigen::MatrixXd jacobian = chain.pose_jacobian(static_cast<std::size_t>(i));
        for (Eigen::Index k = 0; k < 12; ++k)
            smooth.corners_px.block(i * rows, 3 * k, rows, 3) =
                terms[k] * jacobian.middleCols<3>(k < 9 ? 3 : 0);
    }
    return smooth;
}

// As many directions of its columns as X and Y leave.
Eigen::MatrixXd spanned(const Eigen::MatrixXd& columns) {
    const Eigen::VectorXd unscale =
        columns.colwise().norm().cwiseMax(std::numeric_limits<double>::min()).cwiseInverse();
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver;
    solver.setThreshold(1e-4);
    solver.compute(columns * unscale.asDiagonal());
    return solver.householderQ() * Eigen::MatrixXd::Identity(columns.rows(), solver.rank());
}

void require_usable(const DiagnosisInput& evidence) {
    const std::size_t poses = evidence.request.chain.poses.size();
    const auto rows = static_cast<Eigen::Index>(2 * evidence.request.chain.points_mm.size());
    const Eigen::Index pixels = evidence.pixels.size();
    const Eigen::MatrixXd& covariance = evidence.pixel_covariance;
    bool is_usable =
        poses > 2 && evidence.difference_px.size() == poses &&
        evidence.covariance_px2.size() == poses &&
        pixels == std::ssize(evidence.request.pixel_errors) && evidence.pixels.allFinite() &&
        covariance.rows() == pixels && covariance.cols() == pixels &&
        (pixels == 0 || Eigen::LLT<Eigen::MatrixXd>(covariance).info() == Eigen::Success);
    for (const Eigen::VectorXd& difference : evidence.difference_px)
        is_usable = is_usable && difference.size() == rows && difference.allFinite();
    for (const Eigen::MatrixXd& each : evidence.covariance_px2)
        is_usable = is_usable && each.rows() == rows && each.cols() == rows;
    if (!is_usable)
        throw NumericalError("causes: poses, corners, pixels and covariances do not agree");
}

// The best member beside what is explained already.
const ErrorCandidate* best_member(const std::vector<ErrorCandidate>& family,
                                  const NuisanceProjection& rows, const HypothesisSet& comparison,
                                  const Set& beside) {
    const ErrorCandidate* best = nullptr;
    double best_score = -std::numeric_limits<double>::infinity();
    const HypothesisSet explained = comparison.only(beside);
    Set all(beside.size() + 1);
    std::iota(all.begin(), all.end(), std::size_t{0});
    for (const ErrorCandidate& member : family) {
        HypothesisSet extended = explained;
        extended.add(member, rows.freed(member));
        const double score = extended.score(all);
        if (score > best_score) {
            best_score = score;
            best = &member;
        }
    }
    return best;
}

// The longest of the periods (mm or rad) of an axis' error that explain next to as much as the
// best, then the others; nothing where the axis hardly moves. `tried`: how many could be told
// apart. Least-squares spectrum (N. R. Lomb, Astrophys. Space Sci. 39, 1976) of the residual, one
// number a pose. Whitened: `advance`, a step's effect on the corners; `absorbed`, what X, Y absorb.
std::vector<double> periods_of(const StageAxisMotion& axis, const Eigen::VectorXd& advance,
                               const Eigen::VectorXd& residual, const Eigen::MatrixXd& absorbed,
                               int& tried) {
    using namespace std::complex_literals;
    constexpr int per_resolution = 8, most_periods = 4;
    constexpr double as_good = 6.0, as_good_part = 0.03;
    const double shortest = axis.is_linear ? 1.0 : 5.0 * std::numbers::pi / 180.0;
    const Eigen::Map<const Eigen::ArrayXd> positions(axis.position.data(),
                                                     std::ssize(axis.position));
    const double travel = positions.maxCoeff() - positions.minCoeff();
    tried = static_cast<int>(2.0 * travel / shortest) - 1;
    if (tried < 1)
        return {};
    const Eigen::Index poses = positions.size(), rows = advance.size() / poses;
    Eigen::VectorXd told(poses), weight(poses);
    Eigen::MatrixXd absorbed_by_pose(absorbed.cols(), poses);
    for (Eigen::Index i = 0; i < poses; ++i) {
        const auto own = advance.segment(i * rows, rows);
        told[i] = own.dot(residual.segment(i * rows, rows));
        weight[i] = own.squaredNorm();
        absorbed_by_pose.col(i) = absorbed.middleRows(i * rows, rows).transpose() * own;
    }
    // How much of the residual's square a sine and a cosine explain.
    const auto power = [&](const Eigen::ArrayXcd& phase) {
        Eigen::MatrixXd waves(phase.size(), 2);
        waves << phase.imag(), phase.real();
        const Eigen::Vector2d seen = waves.transpose() * told;
        const Eigen::MatrixXd lost = absorbed_by_pose * waves;
        const Eigen::Matrix2d information =
            waves.transpose() * weight.asDiagonal() * waves - lost.transpose() * lost;
        if (!(information.determinant() > 1e-6 * std::pow(information.trace(), 2)))
            return 0.0;  // one wave of the two is lost
        return seen.dot(information.inverse() * seen);
    };
    const double step = 0.5 / travel / per_resolution;
    const double first = (2 * per_resolution - 1) * step, last = 1.0 / shortest + step;
    // From one frequency to the next every position's phase turns by its own constant.
    const Eigen::ArrayXcd turns = 2.0i * std::numbers::pi * positions;
    Eigen::ArrayXcd phase = (first * turns).exp();
    const Eigen::ArrayXcd next = (step * turns).exp();
    std::vector<double> powers;
    for (double frequency = first; frequency <= last; frequency += step, phase *= next)
        powers.push_back(power(phase));
    const double highest = *std::ranges::max_element(powers);
    const double least = highest - std::max(as_good, as_good_part * highest);
    std::vector<double> found;
    for (std::size_t k = 1; k + 1 < powers.size() && found.size() < most_periods; ++k)
        if (powers[k] >= least && powers[k] >= powers[k - 1] && powers[k] > powers[k + 1])
            found.push_back(1.0 / (first + step * static_cast<double>(k)));
    return found;
}

// The best period of each axis that moves, beside what is explained already.
std::vector<ErrorCandidate> best_periods(const DiagnosisInput& evidence,
                                         const NuisanceProjection& rows,
                                         const HypothesisSet& comparison, const Set& beside) {
    std::vector<ErrorCandidate> best;
    const Eigen::VectorXd residual = comparison.residual(beside);
    for (const StageAxisMotion& axis : evidence.request.axes) {
        const Eigen::VectorXd advance = sensitivity_px(evidence.request, axis);
        int tried = 0;
        const std::vector<double> periods =
            periods_of(axis, rows.whitened_corners(advance), residual, rows.absorbed(), tried);
        if (!periods.empty())
            best.push_back(repeating_error(axis, advance, periods, tried));
    }
    return best;
}

// The search under one covariance: all candidates, and of periods and misplaced poses the best
// alone and the best beside the best explanation.
class Search {
public:
    Search(const DiagnosisInput& evidence, const std::vector<ErrorCandidate>& known)
        : rows_(evidence),
          metric_(declared_columns(evidence, rows_, known)),
          comparison_(Observation(evidence, rows_, metric_,
                                  known.size() + evidence.request.axes.size() + 1)) {
        for (const ErrorCandidate& candidate : known)
            add(candidate);
        const std::vector<ErrorCandidate> poses = misplaced_poses(evidence.request);
        for (const bool alone : {true, false}) {
            const Set beside = alone ? Set{} : best(all_scores(comparison_));
            std::vector<ErrorCandidate> more = best_periods(evidence, rows_, comparison_, beside);
            more.push_back(*best_member(poses, rows_, comparison_, beside));
            for (const ErrorCandidate& candidate : more)
                if (std::ranges::find(chosen_, candidate.name, &ErrorCandidate::name) ==
                    chosen_.end())
                    add(chosen_.emplace_back(candidate));
        }
        scores_ = all_scores(comparison_);
    }

    Search(const Search&) = delete;  // its parts point to each other
    Search& operator=(const Search&) = delete;

    static Set best(const Scores& scores) {
        return std::ranges::max_element(scores, {}, &Scores::value_type::second)->first;
    }

    const HypothesisSet& comparison() const { return comparison_; }
    const Scores& scores() const { return scores_; }
    double best_score() const { return scores_.at(best(scores_)); }
    std::vector<ErrorCandidate> best_candidates() const {
        std::vector<ErrorCandidate> all;
        for (const std::size_t i : best(scores_))
            all.push_back(comparison_.candidate(i));
        return all;
    }

    // Of a smooth change that nobody needs to make.
    double score_of_none(const ErrorCandidate& smooth) const {
        HypothesisSet other = comparison_.only({});
        other.add(smooth, spanned(rows_.freed(smooth)));
        return other.score({0});
    }

private:
    void add(const ErrorCandidate& candidate) {
        const Eigen::MatrixXd freed = rows_.freed(candidate);
        if (rows_.leaves_a_trace(candidate, freed))
            comparison_.add(candidate, freed);
    }

    NuisanceProjection rows_;
    Metric metric_;
    HypothesisSet comparison_;
    std::deque<ErrorCandidate> chosen_;
    Scores scores_;
};

Causes ranked(const Search& search, const ErrorCandidate& smooth) {
    const Scores& scores = search.scores();
    const double none = search.score_of_none(smooth);
    const double total = log_sum(scores, none);
    Causes causes;
    causes.none_of_these = std::exp(none - total);
    causes.scatter = search.comparison().scatter(*search.comparison().fit(Search::best(scores)));
    Scores left = probabilities(scores, total);
    causes.no_error = left[{}];
    left.erase(Set{});
    constexpr std::size_t most_ranked = 6;
    constexpr double least_probability = 0.01;
    while (causes.ranked.size() < most_ranked && !left.empty()) {
        const Cause cause = claimed(search.comparison(), Search::best(left), left);
        if (cause.probability < least_probability)
            break;
        causes.ranked.push_back(cause);
    }
    std::ranges::stable_sort(causes.ranked, std::greater(), &Cause::probability);
    return causes;
}

// Of a random error as of every number that is fitted, and its prior odds.
double price(const DiagnosisInput& evidence, std::size_t known) {
    return 0.5 * std::log(static_cast<double>(observed(evidence).size())) +
           std::log(static_cast<double>(known));
}

// A random error, the evidence with it in the covariance, and the log of the odds that it gains.
struct Scattered {
    CausingError error;
    DiagnosisInput evidence;
    double gained = 0.0;
};

// The score of a few candidates under a covariance.
double score_with(const DiagnosisInput& evidence, const NuisanceProjection& rows,
                  const std::vector<ErrorCandidate>& error_candidates, std::size_t known) {
    const Metric metric(Eigen::MatrixXd(observed(evidence).size(), 0));
    HypothesisSet comparison(Observation(evidence, rows, metric, known));
    Set set;
    for (const ErrorCandidate& candidate : error_candidates) {
        comparison.add(candidate, rows.freed(candidate));
        set.push_back(set.size());
    }
    return comparison.score(set);
}

DiagnosisInput with_scatter(DiagnosisInput evidence, const RandomErrorCandidate& candidate,
                            double size) {
    for (std::size_t i = 0; i < evidence.covariance_px2.size(); ++i)
        evidence.covariance_px2[i] +=
            size * size * candidate.corners_px[i] * candidate.corners_px[i].transpose();
    return evidence;
}

std::vector<double> sizes_up_to(double largest) {
    std::vector<double> sizes;
    for (double size = 1e-3; size < largest; size *= std::numbers::sqrt2)
        sizes.push_back(size);
    return sizes;
}

// The random error that makes the observed most probable; nothing where none is worth its price.
std::optional<Scattered> best_scatter(const DiagnosisInput& evidence,
                                      const std::vector<RandomErrorCandidate>& error_candidates,
                                      const std::vector<double>& sizes,
                                      const std::vector<ErrorCandidate>& beside,
                                      std::size_t known) {
    constexpr double rad_per_mm = 1e-2;
    std::optional<Scattered> best;
    const Eigen::MatrixXd xy = registration_columns(evidence);
    const auto score = [&](const DiagnosisInput& of) {
        return score_with(of, NuisanceProjection(of, xy), beside, known);
    };
    const double without = score(evidence);
    for (const RandomErrorCandidate& candidate : error_candidates)
        for (const double each : sizes) {
            const double size = each * (candidate.unit == "rad" ? rad_per_mm : 1.0);
            DiagnosisInput changed = with_scatter(evidence, candidate, size);
            const double gained = score(changed) - without - price(evidence, known);
            if (!(gained > (best ? best->gained : 0.0)))
                continue;
            const auto motions = static_cast<double>(candidate.corners_px.size()) *
                                 static_cast<double>(candidate.corners_px.front().cols());
            const double u = size / std::sqrt(2.0 * motions);
            best.emplace(
                Scattered{{{candidate.name}, size, 2.0 * u, candidate.unit, {candidate.remedy}},
                          std::move(changed),
                          gained});
        }
    return best;
}

// By the detector's biases in photograph and render. Nothing where a stage's explains it as well.
std::optional<Scattered> corner_scatter(const DiagnosisInput& evidence,
                                        const std::vector<ErrorCandidate>& beside,
                                        std::size_t known) {
    if (evidence.corner_modes.size() != evidence.difference_px.size())
        return std::nullopt;
    std::vector<RandomErrorCandidate> random = random_error_candidates(evidence.request);
    random.push_back({"scatter of corners", "px", "", evidence.corner_modes});
    auto best = best_scatter(evidence, random, sizes_up_to(1.0), beside, known);
    return best && best->error.unit == "px" ? std::move(best) : std::nullopt;
}

// The sizes of the best explanation's errors that are not small.
std::map<std::string, double> large_sizes(const Search& search) {
    std::map<std::string, double> sizes;
    const Set best = Search::best(search.scores());
    for (const std::size_t member : best) {
        const CausingError error = described(search.comparison(), best, member);
        if (std::abs(error.size) > search.comparison().candidate(member).size)
            sizes[error.names.front()] = error.size;
    }
    return sizes;
}

// Of the search: the covariance with the corners' scatter, and large errors at their size.
struct Start {
    DiagnosisInput evidence;
    std::vector<ErrorCandidate> known;
    double corner_scatter_px = 0.0;
};

Start start_of(const DiagnosisInput& evidence) {
    constexpr int rounds = 2;
    Start start{evidence, error_candidates(evidence.request)};
    for (int i = 0; i < rounds; ++i) {
        const Search search(start.evidence, start.known);
        const auto sizes = large_sizes(search);
        const auto bias = corner_scatter(evidence, search.best_candidates(), start.known.size());
        if (sizes.empty() && !bias)
            break;
        start.known = error_candidates(evidence.request, sizes);
        start.corner_scatter_px = bias ? bias->error.size : 0.0;
        start.evidence.covariance_px2 =
            bias ? bias->evidence.covariance_px2 : evidence.covariance_px2;
    }
    return start;
}

// "calibrate the camera again" of "k3 or k6"; of nothing where an error's remedies differ in more.
struct Remedy {
    std::string action, of;

    explicit Remedy(const CausingError& error) {
        for (const std::string& each : error.remedies) {
            const std::size_t colon = each.find(": ");
            if (colon == std::string::npos ||
                (!action.empty() && action != each.substr(0, colon))) {
                action = fmt::format("{}", fmt::join(error.remedies, ", or "));
                of.clear();
                return;
            }
            action = each.substr(0, colon);
            of += (of.empty() ? "" : " or ") + each.substr(colon + 2);
        }
    }
};

}  // namespace

std::string CausingError::text() const {
    return fmt::format("{}", fmt::join(names, " ~ "));
}

std::string Cause::text() const {
    std::string all;
    for (const CausingError& error : errors)
        all += (all.empty() ? "" : " and ") + error.text();
    for (const std::string& other : alternatives())
        all += ", or " + other;
    return all;
}

std::vector<std::string> Cause::alternatives() const {
    constexpr std::size_t most = 3;
    const std::size_t shown = instead.size() <= most ? instead.size() : most - 1;
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < shown; ++i)
        texts.push_back(fmt::format("{}", fmt::join(instead[i], " and ")));
    if (shown < instead.size())
        texts.push_back(fmt::format("one of {} other sets", instead.size() - shown));
    return texts;
}

std::vector<std::string> Cause::remedies() const {
    std::vector<Remedy> all;
    for (const CausingError& error : errors) {
        const Remedy one(error);
        const auto same = std::ranges::find(all, one.action, &Remedy::action);
        if (same == all.end())
            all.push_back(one);
        else if (!one.of.empty())
            same->of += ", " + one.of;
    }
    std::vector<std::string> texts;
    for (const auto& [action, of] : all)
        if (!action.empty())
            texts.push_back(of.empty() ? action : action + ": " + of);
    return texts;
}

const Cause* Causes::named() const {
    return !ranked.empty() && ranked.front().probability > 0.5 ? &ranked.front() : nullptr;
}

Causes with_error(const CausingError& error, double probability, Causes causes) {
    for (Cause& cause : causes.ranked) {
        cause.probability *= probability;
        cause.errors.insert(cause.errors.begin(), error);
        for (std::vector<std::string>& names : cause.instead)
            names.insert(names.begin(), error.names.front());
    }
    causes.ranked.push_back({{error}, probability * causes.no_error});
    causes.none_of_these *= probability;
    causes.no_error = 0.0;
    std::ranges::stable_sort(causes.ranked, std::greater(), &Cause::probability);
    return causes;
}

Causes find_causes(const DiagnosisInput& evidence) {
    require_usable(evidence);
    const Start start = start_of(evidence);
    const ErrorCandidate smooth = smooth_change(evidence.request.chain);
    const Search plain(start.evidence, start.known);
    Causes causes = ranked(plain, smooth);
    const auto random = random_error_candidates(evidence.request);
    const std::vector<double> sizes = sizes_up_to(1.5);  // mm, or 0.01 mrad
    double best_odds = 0.0;
    for (const auto& beside : {std::vector<ErrorCandidate>{}, plain.best_candidates()}) {
        const auto scattered =
            best_scatter(start.evidence, random, sizes, beside, start.known.size());
        if (!scattered)
            continue;
        const Search search(scattered->evidence, start.known);
        const double odds =
            search.best_score() - plain.best_score() - price(evidence, start.known.size());
        if (!(odds > best_odds))
            continue;
        best_odds = odds;
        causes =
            with_error(scattered->error, 1.0 / (1.0 + std::exp(-odds)), ranked(search, smooth));
    }
    causes.corner_scatter_px = start.corner_scatter_px;
    return causes;
}

}  // namespace etalon
