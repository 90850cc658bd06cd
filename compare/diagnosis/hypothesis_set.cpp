#include "compare/diagnosis/hypothesis_set.h"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

namespace etalon {
namespace {

std::vector<CandidateSet> best_of(const CandidateScores& scores, std::size_t members,
                                  std::size_t count) {
    std::vector<std::pair<double, CandidateSet>> of_size;
    for (const auto& [set, score] : scores)
        if (set.size() == members)
            of_size.emplace_back(-score, set);
    std::ranges::sort(of_size);
    std::vector<CandidateSet> best;
    for (std::size_t i = 0; i < std::min(count, of_size.size()); ++i)
        best.push_back(of_size[i].second);
    return best;
}

}  // namespace

CandidateSet with(CandidateSet set, std::size_t member) {
    set.insert(std::ranges::upper_bound(set, member), member);
    return set;
}

CandidateSet without(CandidateSet set, std::size_t member) {
    std::erase(set, member);
    return set;
}

HypothesisSet HypothesisSet::only(const CandidateSet& set) const {
    HypothesisSet few(of_);
    for (const std::size_t i : set)
        few.add(candidate(i), columns_.middleCols(candidates_[i].first, candidates_[i].count));
    return few;
}

void HypothesisSet::add(const ErrorCandidate& candidate, const Eigen::MatrixXd& freed) {
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

std::optional<HypothesisSet::Fit> HypothesisSet::fit(const CandidateSet& set) const {
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
    fit.numbers = unscale.cwiseProduct(solver.solve(Eigen::VectorXd(unscale.cwiseProduct(seen))));
    fit.rest = of_.square - seen.dot(fit.numbers);
    return fit;
}

Eigen::MatrixXd HypothesisSet::covariance(const CandidateSet& set) const {
    const std::vector<Eigen::Index> at = columns_of(set);
    return products_(at, at).inverse();
}

Eigen::VectorXd HypothesisSet::residual(const CandidateSet& set) const {
    const std::vector<Eigen::Index> at = columns_of(set);
    const Eigen::VectorXd explained = columns_(Eigen::all, at) * fit(set)->numbers;
    return of_.metric->weighted(of_.values - explained);
}

double HypothesisSet::scatter(const Fit& fit) const {
    return std::sqrt(
        std::max(1.0, fit.rest / (of_.freedom - static_cast<double>(fit.numbers.size()))));
}

double HypothesisSet::score(const CandidateSet& set) const {
    const auto found = fit(set);
    if (!found)
        return -std::numeric_limits<double>::infinity();
    const double enlarged = std::max(1.0, found->rest / of_.freedom);
    double score =
        -0.5 * (of_.log_determinant + found->rest / enlarged + of_.freedom * std::log(enlarged)) -
        0.5 * static_cast<double>(found->numbers.size()) * std::log(of_.freedom);
    for (const std::size_t i : set)
        score -= std::log(of_.known * candidate(i).tried);
    return score;
}

std::vector<Eigen::Index> HypothesisSet::columns_of(const CandidateSet& set) const {
    std::vector<Eigen::Index> at;
    for (const std::size_t i : set)
        for (Eigen::Index k = 0; k < candidates_[i].count; ++k)
            at.push_back(candidates_[i].first + k);
    return at;
}

CandidateScores all_scores(const HypothesisSet& comparison) {
    constexpr std::size_t most_members = 4, grown_from = 40;
    CandidateScores scores{{{}, comparison.score({})}};
    for (std::size_t members = 0; members < most_members; ++members) {
        const std::size_t bases =
            members < 2 ? std::numeric_limits<std::size_t>::max() : grown_from;
        for (const CandidateSet& base : best_of(scores, members, bases))
            for (std::size_t i = 0; i < comparison.size(); ++i)
                if (!std::ranges::binary_search(base, i))
                    if (const CandidateSet set = with(base, i); !scores.contains(set))
                        scores[set] = comparison.score(set);
    }
    return scores;
}

}  // namespace etalon
