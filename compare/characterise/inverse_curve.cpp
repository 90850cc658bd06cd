#include "compare/characterise/inverse_curve.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr int max_pieces = 12;
constexpr int reweighting_rounds = 12;  // of reweighting; the weights settle to 1e-6 in five

double longest_exposure(const std::vector<ExposedPatch>& observed) {
    double longest = 0.0;
    for (const ExposedPatch& o : observed)
        longest = std::max(longest, o.exposure);
    return longest;
}

}  // namespace

int patch_count(const std::vector<ExposedPatch>& observed) {
    int count = 0;
    for (const ExposedPatch& o : observed)
        count = std::max(count, o.patch + 1);
    return count;
}

InverseCurve::InverseCurve(int pieces, double end)
    : pieces_(pieces), end_(end), weights_(Eigen::VectorXd::LinSpaced(pieces + 3, 0.0, 1.0)) {
    covariance_ = Eigen::MatrixXd::Zero(pieces + 3, pieces + 3);
}

// Cox and de Boor's recursion on `pieces` equal intervals with fourfold ends.
Eigen::VectorXd InverseCurve::basis(double code) const {
    const double width = end_ / pieces_;
    const auto knot = [&](int i) { return width * std::clamp(i - 3, 0, pieces_); };
    const double inside = std::clamp(code, 0.0, end_);
    const int interval = std::min(static_cast<int>(inside / width), pieces_ - 1);
    Eigen::VectorXd values = Eigen::VectorXd::Zero(pieces_ + 3);
    values(interval) = 1.0;  // of degree 0, counted from the interval's first cubic
    for (int degree = 1; degree <= 3; ++degree) {
        Eigen::VectorXd next = Eigen::VectorXd::Zero(pieces_ + 3);
        for (int k = 0; k < degree; ++k) {
            const int i = interval + k, left = interval + 3 - degree + 1 + k;
            const double span = knot(left + degree) - knot(left);
            const double share = (inside - knot(left)) / span;
            next(i) += (1.0 - share) * values(i);
            next(i + 1) += share * values(i);
        }
        values = next;
    }
    const int last = pieces_ + 2;
    if (code > end_) {
        const double beyond = code - end_;
        values(last) += 3.0 * beyond / width;
        values(last - 1) -= 3.0 * beyond / width;
        values += 0.5 * beyond * beyond * bend_at_end();
    } else if (code < 0.0) {
        values(1) += 3.0 * code / width;
        values(0) -= 3.0 * code / width;
    }
    return values;
}

double InverseCurve::radiance(double code) const {
    return basis(code).dot(weights_);
}

double InverseCurve::slope(double code) const {
    const double step = 1e-5 * end_;
    return (radiance(code + step) - radiance(code - step)) / (2.0 * step);
}

// From the derivative's last two control values.
Eigen::VectorXd InverseCurve::bend_at_end() const {
    const double width = end_ / pieces_, span = width * std::min(pieces_, 2);
    const int last = pieces_ + 2;
    Eigen::VectorXd values = Eigen::VectorXd::Zero(pieces_ + 3);
    values(last) = 6.0 / (width * width);
    values(last - 1) = -6.0 / (width * width) - 6.0 / (span * width);
    values(last - 2) = 6.0 / (span * width);
    return values;
}

double InverseCurve::relative_uncertainty(double code, double top) const {
    const Eigen::VectorXd at_top = basis(top);
    const double scale = at_top.dot(weights_), ratio = radiance(code) / scale;
    const Eigen::VectorXd gradient = (basis(code) - ratio * at_top) / scale;
    const auto unseen = [&](double c) { return 0.5 * std::pow(std::max(c - end_, 0.0), 2); };
    const double bent = bend_at_end().dot(weights_) * (unseen(code) - ratio * unseen(top)) / scale;
    return std::sqrt(std::max(gradient.dot(covariance_ * gradient), 0.0) + bent * bent);
}

// Unknown are the inner weights and the irradiances; the equations are linear in both, and their
// weights need the curve's slope, which the last round gave.
void InverseCurve::fit(const std::vector<ExposedPatch>& observed) {
    const int inner = pieces_ + 1, patches = patch_count(observed);
    const double longest = longest_exposure(observed);
    Eigen::VectorXd solution;
    for (int round = 0; round < reweighting_rounds; ++round) {
        Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(inner + patches, inner + patches);
        Eigen::VectorXd right = Eigen::VectorXd::Zero(inner + patches);
        chi_square = 0.0;
        for (const ExposedPatch& o : observed) {
            const double least_slope = 0.02 / end_;  // where the curve is not settled yet
            const double sigma = o.standard_uncertainty * std::max(slope(o.code), least_slope);
            const Eigen::VectorXd values = basis(o.code) / sigma;
            const Eigen::VectorXd row = values.segment(1, inner);
            const double time = -o.exposure / longest / sigma, target = -values(inner + 1);
            const int p = inner + o.patch;
            normal.topLeftCorner(inner, inner) += row * row.transpose();
            normal.col(p).head(inner) += time * row;
            normal(p, p) += time * time;
            right.head(inner) += target * row;
            right(p) += target * time;
            if (round > 0) {
                const double residual = row.dot(solution.head(inner)) + time * solution(p) - target;
                chi_square += residual * residual;
            }
        }
        const Eigen::MatrixXd full = normal.selfadjointView<Eigen::Upper>();
        const Eigen::LDLT<Eigen::MatrixXd> factor(full);
        solution = factor.solve(right);
        if (!solution.allFinite())
            throw NumericalError("exposures: the times and patches do not determine the curve");
        weights_.segment(1, inner) = solution.head(inner);
        if (round + 1 == reweighting_rounds)
            covariance_.block(1, 1, inner, inner) =
                factor.solve(Eigen::MatrixXd::Identity(inner + patches, inner + patches))
                    .topLeftCorner(inner, inner);
    }
    irradiance.clear();
    for (int p = 0; p < patches; ++p)
        irradiance.push_back(solution(inner + p) / longest);
    const double excess =
        chi_square / std::max(1.0, static_cast<double>(observed.size()) - inner - patches);
    covariance_ *= std::max(excess, 1.0);
}

bool InverseCurve::rises() const {
    for (int i = 0; i <= 200; ++i)
        if (!(slope(end_ * i / 200.0) > 0.0))
            return false;
    return true;
}

InverseCurve fit_inverse_curve(const std::vector<ExposedPatch>& observed) {
    double end = 0.0;
    for (const ExposedPatch& o : observed)
        end = std::max(end, o.code);
    std::vector<InverseCurve> curves;
    for (int pieces = 1; pieces <= max_pieces; ++pieces) {
        InverseCurve curve(pieces, end);
        curve.fit(observed);
        if (curve.rises())
            curves.push_back(curve);
    }
    if (curves.empty())
        throw NumericalError(
            "exposures: codes do not rise with the exposure time as any one transfer curve would: "
            "automatic exposure or gain, or wrong times");
    const double n = static_cast<double>(observed.size());
    const double freedom = n - patch_count(observed) - curves.back().parameters();
    const double excess = std::max(1.0, curves.back().chi_square / std::max(freedom, 1.0));
    return *std::min_element(curves.begin(), curves.end(), [&](const auto& a, const auto& b) {
        return a.chi_square / excess + a.parameters() * std::log(n) <
               b.chi_square / excess + b.parameters() * std::log(n);
    });
}

double irradiance_chi_square(const std::vector<ExposedPatch>& observed,
                             const std::function<double(double)>& inverse,
                             const std::function<double(double)>& slope) {
    std::vector<double> product(static_cast<std::size_t>(patch_count(observed)), 0.0);
    std::vector<double> square = product;
    const auto weight = [&](const ExposedPatch& o) {
        return 1.0 / std::pow(o.standard_uncertainty * std::max(slope(o.code), 1e-6), 2);
    };
    for (const ExposedPatch& o : observed) {
        const auto p = static_cast<std::size_t>(o.patch);
        product[p] += weight(o) * inverse(o.code) * o.exposure;
        square[p] += weight(o) * o.exposure * o.exposure;
    }
    double chi_square = 0.0;
    for (const ExposedPatch& o : observed) {
        const auto p = static_cast<std::size_t>(o.patch);
        const double residual = inverse(o.code) - product[p] / square[p] * o.exposure;
        chi_square += weight(o) * residual * residual;
    }
    return chi_square;
}

}  // namespace etalon
