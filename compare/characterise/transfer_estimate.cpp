#include "compare/characterise/transfer_estimate.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <set>

#include "compare/characterise/code_statistics.h"
#include "core/program/errors.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr int max_pieces = 12;
constexpr int reweighting_rounds = 12;  // the weights settle to 1e-6 in five

// A patch of the scene in one photograph.
struct ExposedPatch {
    int patch = 0;  // 0, 1, ...
    double exposure = 0.0;
    double code = 0.0;  // T, 0 without light, 1 at full scale
    double standard_uncertainty = 0.0;
};

int patch_count(const std::vector<ExposedPatch>& observed) {
    return std::ranges::max(observed, {}, &ExposedPatch::patch).patch + 1;
}

// A sensor's inverse transfer curve g(T) = E t for patches of unknown irradiance E: a cubic
// B-spline with g(0) = 0 and g = 1 at the highest code observed, straight below 0, with its bend
// beyond.
class InverseCurve {
public:
    InverseCurve(int pieces, double end)
        : pieces_(pieces),
          end_(end),
          weights_(Eigen::VectorXd::LinSpaced(pieces + 3, 0.0, 1.0)),
          covariance_(Eigen::MatrixXd::Zero(pieces + 3, pieces + 3)) {}

    void fit(const std::vector<ExposedPatch>& observed);
    bool rises() const;
    double radiance(double code) const { return basis(code).dot(weights_); }
    double slope(double code) const {  // d radiance / d code
        const double step = 1e-5 * end_;
        return (radiance(code + step) - radiance(code - step)) / (2.0 * step);
    }
    // Of radiance(code) / radiance(top). Unseen codes: the whole effect of the bend is added.
    double relative_uncertainty(double code, double top) const;
    int parameters() const { return static_cast<int>(weights_.size()) - 2; }

    std::vector<double> irradiance;  // of each patch
    double chi_square = 0.0;

private:
    Eigen::VectorXd basis(double code) const;  // values at `code`, continued outside 0..end
    Eigen::VectorXd bend_at_end() const;       // second derivative at the end

    int pieces_;
    double end_;
    Eigen::VectorXd weights_;     // of the basis functions; the first is 0, the last 1
    Eigen::MatrixXd covariance_;  // of all of them
};

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

// Linear in the inner weights and the irradiances; the equations' weights need the last round's
// slope.
void InverseCurve::fit(const std::vector<ExposedPatch>& observed) {
    const int inner = pieces_ + 1, patches = patch_count(observed);
    const double longest = std::ranges::max(observed, {}, &ExposedPatch::exposure).exposure;
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

// Of 1, 2, 3 ... 12 pieces those that Schwarz's criterion prefers where the curve rises.
InverseCurve fit_inverse_curve(const std::vector<ExposedPatch>& observed) {
    const double end = std::ranges::max(observed, {}, &ExposedPatch::code).code;
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
    return *std::ranges::min_element(curves, {}, [&](const InverseCurve& curve) {
        return curve.chi_square / excess + curve.parameters() * std::log(n);
    });
}

constexpr int min_times = 4;
constexpr double min_time_range = 4.0;
constexpr int min_patches = 4, max_patches = 100;
constexpr double max_drift = 0.01;
constexpr double min_top = 0.5;  // of full scale, that must be seen
constexpr int table_intervals = 128;

void require_times(std::span<const ExposedPhoto> photos) {
    std::set<double> times;
    for (const ExposedPhoto& photo : photos) {
        if (!(photo.exposure_us > 0.0 && std::isfinite(photo.exposure_us)))
            throw NumericalError(fmt::format("exposures: {} has the exposure time {} us",
                                             photo.name, photo.exposure_us));
        times.insert(photo.exposure_us);
    }
    if (times.size() < min_times || *times.rbegin() < min_time_range * *times.begin())
        throw NumericalError(
            fmt::format("exposures: {} different times over a factor of {:.3g}; {} over a factor "
                        "of {:.0f} are needed",
                        times.size(), times.empty() ? 0.0 : *times.rbegin() / *times.begin(),
                        min_times, min_time_range));
}

// Of a mosaic only the green pixels of every second row: one curve needs one colour.
std::vector<ExposedPhoto> one_channel(std::span<const ExposedPhoto> photos, Mosaic mosaic) {
    std::vector<ExposedPhoto> result(photos.begin(), photos.end());
    if (mosaic == Mosaic::none)
        return result;
    const int first = channel_of_pixel(mosaic, 0, 0) == Channel::green ? 0 : 1;
    for (ExposedPhoto& photo : result) {
        const cv::Mat all = photo.image.pixels;
        cv::Mat green((all.rows + 1) / 2, (all.cols - first + 1) / 2, all.type());
        for (int y = 0; y < green.rows; ++y)
            for (int x = 0; x < green.cols; ++x)
                all.col(2 * x + first).row(2 * y).copyTo(green.col(x).row(y));
        photo.image.pixels = green;
    }
    return result;
}

// The patches in every photograph where they are not clipped, as (patch, time, T).
std::vector<ExposedPatch> observations(std::span<const ExposedPhoto> photos,
                                       const std::vector<cv::Rect>& patches, int saturation,
                                       const Sensor& sensor) {
    const double range = (1 << sensor.bits) - 1 - sensor.black_dn;
    std::vector<ExposedPatch> result;
    for (const ExposedPhoto& photo : photos)
        for (std::size_t i = 0; i < patches.size(); ++i) {
            const PatchStatistics patch =
                patch_statistics(photo.image, patches[i], saturation, Mosaic::none);
            if (patch.is_clipped)
                continue;
            result.push_back({static_cast<int>(i), photo.exposure_us,
                              (patch.mean - sensor.black_dn) / range,
                              patch.standard_uncertainty / range});
        }
    return result;
}

// Patches that are uniform where they are brightest and not clipped, spread over the levels.
std::vector<cv::Rect> chosen_patches(std::span<const ExposedPhoto> photos, int saturation,
                                     const Sensor& sensor) {
    std::vector<ExposedPhoto> brightest_first(photos.begin(), photos.end());
    std::ranges::stable_sort(brightest_first, std::greater(), &ExposedPhoto::exposure_us);
    std::vector<std::pair<double, cv::Rect>> by_irradiance;  // blocks of equal ones row by row
    for (const cv::Rect& block : image_blocks(photos.front().image.pixels.size(), 40))
        for (const ExposedPhoto& photo : brightest_first) {
            const PatchStatistics patch =
                patch_statistics(photo.image, block, saturation, Mosaic::none);
            if (patch.is_clipped)
                continue;
            const double signal = patch.mean - sensor.black_dn;
            if (patch.unevenness < 0.03 * signal)
                by_irradiance.emplace_back(signal / photo.exposure_us, block);
            break;
        }
    std::ranges::stable_sort(by_irradiance, {}, &std::pair<double, cv::Rect>::first);
    std::vector<cv::Rect> patches;
    const std::size_t many = by_irradiance.size();
    const std::size_t wanted = std::min<std::size_t>(many, max_patches);
    for (std::size_t i = 0; i < wanted; ++i)
        patches.push_back(by_irradiance[(2 * i + 1) * many / (2 * wanted)].second);
    if (patches.size() < min_patches)
        throw NumericalError(
            fmt::format("exposures: {} uniform parts in the scene; {} are needed (a blurred or far "
                        "target, a gray wall)",
                        patches.size(), min_patches));
    return patches;
}

// Largest relative difference between photographs of one exposure time, as mean over the patches.
std::optional<double> light_drift(std::span<const ExposedPhoto> photos,
                                  const std::vector<cv::Rect>& patches, int saturation,
                                  const Sensor& sensor) {
    std::map<double, std::vector<double>> sums;
    for (const ExposedPhoto& photo : photos) {
        double sum = 0.0;
        for (const cv::Rect& rect : patches)
            sum += patch_statistics(photo.image, rect, saturation, Mosaic::none).mean -
                   sensor.black_dn;
        sums[photo.exposure_us].push_back(sum);
    }
    std::optional<double> drift;
    for (const auto& [time, values] : sums) {
        const auto [least, most] = std::minmax_element(values.begin(), values.end());
        if (values.size() > 1 && *least > 0.0)
            drift = std::max(drift.value_or(0.0), (*most - *least) / *most);
    }
    if (drift.value_or(0.0) > max_drift)
        throw NumericalError(fmt::format(
            "exposures: photos of equal exposure time differ by {:.2g} %: the light is not steady",
            100.0 * *drift));
    return drift;
}

// A curve that has no parameters of its own, with the irradiances that fit best.
TransferCandidate known_curve(Transfer::Kind kind, const std::vector<ExposedPatch>& observed) {
    const Transfer transfer{kind, {}};
    const auto inverse = [&](double code) { return decode(transfer, std::min(code, 1.0)); };
    const auto weight = [&](const ExposedPatch& o) {
        constexpr double step = 1e-5, least_slope = 1e-6;
        const double slope = (inverse(o.code + step) - inverse(o.code - step)) / (2.0 * step);
        return 1.0 / std::pow(o.standard_uncertainty * std::max(slope, least_slope), 2);
    };
    TransferCandidate candidate{kind};
    candidate.parameters = patch_count(observed);
    Eigen::VectorXd product = Eigen::VectorXd::Zero(candidate.parameters), square = product;
    for (const ExposedPatch& o : observed) {
        product[o.patch] += weight(o) * inverse(o.code) * o.exposure;
        square[o.patch] += weight(o) * o.exposure * o.exposure;
    }
    for (const ExposedPatch& o : observed) {
        const double residual = inverse(o.code) - product[o.patch] / square[o.patch] * o.exposure;
        candidate.chi_square += weight(o) * residual * residual;
    }
    return candidate;
}

// The known curves first: one of them is kept as long as its residuals are at most a fifth larger
// than the table's, which follows anything.
Transfer::Kind chosen(std::vector<TransferCandidate>& candidates, std::size_t observations) {
    for (TransferCandidate& candidate : candidates)
        candidate.degrees_of_freedom = static_cast<int>(observations) - candidate.parameters;
    const auto reduced = [](const TransferCandidate& c) {
        return c.chi_square / c.degrees_of_freedom;
    };
    // The richest model tells how much larger the scatter is than the stated noise.
    const double scatter = std::max(1.0, reduced(candidates.back()));
    for (TransferCandidate& candidate : candidates)
        candidate.information_criterion =
            candidate.chi_square / scatter +
            candidate.parameters * std::log(static_cast<double>(observations));
    const auto best =
        std::ranges::min_element(candidates, {}, &TransferCandidate::information_criterion);
    for (const TransferCandidate& candidate : candidates)
        if (candidate.kind == best->kind || reduced(candidate) < 1.5 * scatter)
            return candidate.kind;
    return best->kind;
}

// The whole curve up to saturation, radiance 1 there, as the estimate's table.
void tabulate(const InverseCurve& curve, double top, double black_uncertainty,
              TransferEstimate& estimate) {
    const double end = curve.radiance(top);
    auto& knots = estimate.transfer.table;
    for (int i = 0; i <= table_intervals; ++i) {
        const double code = top * i / table_intervals;
        const double slope = curve.slope(code) / end;
        const double u_radiance = curve.relative_uncertainty(code, top);
        knots.emplace_back(curve.radiance(code) / end, code);
        estimate.code_standard_uncertainty.push_back(
            std::hypot(u_radiance / slope, (1.0 - code) * black_uncertainty));
    }
    knots.front() = {0.0, 0.0};
    knots.back().first = 1.0;
    for (std::size_t i = 1; i < knots.size(); ++i)
        if (!(knots[i].first > knots[i - 1].first))
            throw NumericalError(
                fmt::format("exposures: the transfer curve does not rise at {:.3g} of full scale: "
                            "more exposure times and patches are needed there",
                            knots[i].second));
}

// Departure from the least-squares line through black, from 5 to 95 % of the range (EMVA 1288).
void take_nonlinearity(TransferEstimate& estimate) {
    const auto is_in_range = [&](double code) {
        return code >= 0.05 * estimate.highest_code && code <= 0.95 * estimate.highest_code;
    };
    double product = 0.0, square = 0.0;
    for (const auto& [radiance, code] : estimate.transfer.table)
        if (is_in_range(code)) {
            product += radiance * code;
            square += radiance * radiance;
        }
    for (std::size_t i = 0; i < estimate.transfer.table.size(); ++i) {
        const auto [radiance, code] = estimate.transfer.table[i];
        const double departure = std::abs(code - radiance * product / square);
        if (is_in_range(code) && departure > estimate.nonlinearity) {
            estimate.nonlinearity = departure;
            estimate.nonlinearity_standard_uncertainty = estimate.code_standard_uncertainty[i];
        }
    }
}

}  // namespace

TransferEstimate estimate_transfer(std::span<const ExposedPhoto> given, const Sensor& sensor,
                                   double black_standard_uncertainty_dn) {
    require_times(given);
    std::vector<CodeImage> images;
    for (const ExposedPhoto& photo : given)
        images.push_back(photo.image);
    require_alike(images, "exposures");
    const std::vector<ExposedPhoto> photos = one_channel(given, sensor.mosaic);
    TransferEstimate estimate;
    estimate.saturation_code = saturation_code(images);
    const std::vector<cv::Rect> patches = chosen_patches(photos, estimate.saturation_code, sensor);
    const std::vector<ExposedPatch> observed =
        observations(photos, patches, estimate.saturation_code, sensor);
    estimate.light_drift = light_drift(photos, patches, estimate.saturation_code, sensor);
    estimate.patches = static_cast<int>(patches.size());
    estimate.photos = static_cast<int>(photos.size());
    const auto [low, high] = std::ranges::minmax(observed, {}, &ExposedPatch::code);
    estimate.lowest_code = low.code;
    estimate.highest_code = high.code;
    if (estimate.highest_code < min_top)
        throw NumericalError(
            fmt::format("exposures: the brightest parts reach {:.0f} % of full scale without "
                        "clipping; {:.0f} % are needed",
                        100.0 * estimate.highest_code, 100.0 * min_top));

    const InverseCurve curve = fit_inverse_curve(observed);
    estimate.candidates = {known_curve(Transfer::Kind::linear, observed),
                           known_curve(Transfer::Kind::rec709, observed),
                           {Transfer::Kind::table, curve.chi_square}};
    estimate.candidates.back().parameters =
        estimate.candidates.front().parameters + curve.parameters();
    const double range = (1 << sensor.bits) - 1 - sensor.black_dn;
    const double top =
        std::max((estimate.saturation_code - sensor.black_dn) / range, estimate.highest_code);
    tabulate(curve, top, black_standard_uncertainty_dn / range, estimate);
    take_nonlinearity(estimate);
    for (const ExposedPatch& patch : observed)
        estimate.points.push_back({curve.irradiance[static_cast<std::size_t>(patch.patch)] *
                                       patch.exposure / curve.radiance(top),
                                   patch.code, patch.standard_uncertainty});
    estimate.transfer.kind = chosen(estimate.candidates, observed.size());
    if (estimate.transfer.kind != Transfer::Kind::table) {
        estimate.transfer.table.clear();
        estimate.code_standard_uncertainty.clear();
    }
    return estimate;
}

}  // namespace etalon
