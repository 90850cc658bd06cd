// Sets of candidates compared with what a run observed (compare/diagnosis/causes.h has the method).
#pragma once

#include "compare/diagnosis/cause_rows.h"

namespace etalon {

using CandidateSet = std::vector<std::size_t>;  // ascending indices
using CandidateScores = std::map<CandidateSet, double>;

CandidateSet with(CandidateSet set, std::size_t member);
CandidateSet without(CandidateSet set, std::size_t member);

// Products of the columns of all candidates with each other and with what was observed. The
// candidates must outlive it.
class HypothesisSet {
public:
    explicit HypothesisSet(Observation of) : of_(std::move(of)) {}

    // The same with these candidates alone.
    HypothesisSet only(const CandidateSet& set) const;

    // `freed`: its columns, freed of X and Y. Leaves out nothing: ask leaves_a_trace() before.
    void add(const ErrorCandidate& candidate, const Eigen::MatrixXd& freed);

    std::size_t size() const { return candidates_.size(); }
    const ErrorCandidate& candidate(std::size_t i) const { return *candidates_[i].candidate; }

    // Numbers of a set's columns, in units of the candidates' sizes; nothing where they cannot be
    // told apart at all.
    struct Fit {
        Eigen::VectorXd numbers;
        double rest = 0.0;  // sum of squares that is left
    };
    std::optional<Fit> fit(const CandidateSet& set) const;

    // Of the numbers of a set that can be told apart.
    Eigen::MatrixXd covariance(const CandidateSet& set) const;

    // What a set leaves of the observed, weighted as the covariance says.
    Eigen::VectorXd residual(const CandidateSet& set) const;

    // Of the corners beside an explanation, over what is stated; 1 at least.
    double scatter(const Fit& fit) const;

    // Log of the posterior odds against everything else, up to a constant: the likelihood under the
    // covariance, with the corners' scatter at its best value from 1 up, Schwarz's price of each
    // number, and the prior.
    double score(const CandidateSet& set) const;

private:
    std::vector<Eigen::Index> columns_of(const CandidateSet& set) const;

    struct Place {
        const ErrorCandidate* candidate;
        Eigen::Index first, count;
    };

    Observation of_;
    Eigen::MatrixXd columns_, products_;
    Eigen::VectorXd seen_;
    std::vector<Place> candidates_;
};

// Nothing, every candidate, every pair, and the best larger sets grown from the best smaller ones.
CandidateScores all_scores(const HypothesisSet& comparison);

}  // namespace etalon
