#include "core/optimize/root_search.h"

#include <vector>

namespace etalon {
namespace {

using Polynomial = std::vector<double>;  // coefficients, the constant first

double value_of(const Polynomial& p, double x) {
    double value = 0.0;
    for (auto c = p.rbegin(); c != p.rend(); ++c)
        value = value * x + *c;
    return value;
}

double crossing(const Polynomial& p, double low, double high) {
    const bool is_positive = value_of(p, low) > 0.0;
    for (double middle = 0.5 * (low + high); middle > low && middle < high;
         middle = 0.5 * (low + high))
        ((value_of(p, middle) > 0.0) == is_positive ? low : high) = middle;
    return high;
}

// Where the sign changes, ascending: between the stationary points, and beyond the last.
std::vector<double> sign_changes(const Polynomial& p) {
    if (p.size() < 2)
        return {};
    Polynomial derivative;
    for (std::size_t i = 1; i < p.size(); ++i)
        derivative.push_back(static_cast<double>(i) * p[i]);
    std::vector<double> ends = sign_changes(derivative);
    double far = ends.empty() ? 1.0 : 2.0 * ends.back();
    while ((value_of(p, far) > 0.0) != (p.back() > 0.0) && far < 1e150)
        far *= 2.0;
    ends.push_back(far);
    std::vector<double> changes;
    double low = 0.0;
    for (const double end : ends) {
        if ((value_of(p, low) > 0.0) != (value_of(p, end) > 0.0))
            changes.push_back(crossing(p, low, end));
        low = end;
    }
    return changes;
}

}  // namespace

double first_positive_root(std::initializer_list<double> coefficients) {
    Polynomial p(coefficients);
    while (!p.empty() && p.back() == 0.0)
        p.pop_back();
    if (p.empty() || !(p.front() > 0.0))
        return 0.0;
    const std::vector<double> changes = sign_changes(p);
    return changes.empty() ? std::numeric_limits<double>::infinity() : changes.front();
}

}  // namespace etalon
