#include "compare/drift/drift_monitor.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <array>

#include "compare/detect/board/calibration_target.h"
#include "compare/make_detector.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {

TargetReference::TargetReference(TargetPoints points) : points_(std::move(points)) {
    if (points_.size() < min_target_points)
        throw NumericalError(fmt::format("a target with {} points: {} are needed", points_.size(),
                                         min_target_points));
    const auto count = static_cast<double>(points_.size());
    for (const auto& [id, pixel] : points_)
        centre_ += pixel / count;
    double squares = 0.0;
    for (const auto& [id, pixel] : points_)
        squares += (pixel - centre_).squaredNorm();
    radius_ = std::sqrt(squares / count);
    constexpr double min_radius_px = 1e-3;
    if (!(radius_ > min_radius_px) || !std::isfinite(radius_))
        throw NumericalError("a target whose points are all in one place");
}

Eigen::Matrix<double, 2, 4> TargetReference::at(const Eigen::Vector2d& pixel) const {
    const Eigen::Vector2d q = (pixel - centre_) / radius_;
    Eigen::Matrix<double, 2, 4> matrix;
    matrix << 1, 0, q.x(), -q.y(), 0, 1, q.y(), q.x();
    return matrix;
}

std::optional<TargetReference::Look> TargetReference::look(const TargetPoints& points) const {
    std::vector<std::pair<int, Eigen::Vector2d>> displacements;
    for (const auto& [id, pixel] : points)
        if (const auto first = points_.find(id); first != points_.end())
            displacements.emplace_back(id, pixel - first->second);
    if (displacements.size() < min_target_points || 2 * displacements.size() < points_.size())
        return std::nullopt;
    const auto rows = static_cast<Eigen::Index>(2 * displacements.size());
    Eigen::MatrixXd design(rows, 4);
    Eigen::VectorXd moved(rows);
    for (Eigen::Index i = 0; 2 * i < rows; ++i) {
        const auto& [id, displacement] = displacements[static_cast<std::size_t>(i)];
        design.middleRows<2>(2 * i) = at(points_.at(id));
        moved.segment<2>(2 * i) = displacement;
    }
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(design);
    if (qr.rank() < 4 || !moved.allFinite())
        return std::nullopt;
    Look result;
    result.movement = qr.solve(moved);
    const Eigen::VectorXd left = moved - design * result.movement;
    for (Eigen::Index i = 0; 2 * i < rows; ++i)
        result.residuals[displacements[static_cast<std::size_t>(i)].first] = left.segment<2>(2 * i);
    return result;
}

double TargetReference::largest(const Movement& movement) const {
    double largest = 0.0;
    for (const auto& [id, pixel] : points_)
        largest = std::max(largest, (at(pixel) * movement).norm());
    return largest;
}

double misfit(const TargetPoints& residuals) {
    if (residuals.size() <= 2)
        return 0.0;
    double squares = 0.0;
    for (const auto& [id, residual] : residuals)
        squares += residual.squaredNorm();
    return std::sqrt(squares / (2.0 * static_cast<double>(residuals.size()) - 4.0));
}

namespace {

TargetPoints by_id(const std::vector<Eigen::Vector2d>& pixels, const std::vector<int>& ids) {
    TargetPoints points;
    for (std::size_t i = 0; i < pixels.size(); ++i)
        points[ids.empty() ? static_cast<int>(i) : ids[i]] = pixels[i];
    return points;
}

}  // namespace

TargetFinder make_target_finder(const std::string& spec, const std::string& place) {
    const Marker marker = parse_marker(spec, place);
    if (marker.kind == Marker::Kind::apriltag || marker.kind == Marker::Kind::aruco ||
        marker.kind == Marker::Kind::stag || marker.kind == Marker::Kind::topotag)
        return [detector = *make_detector("auto", marker, place)](const CodeImage& image) mutable {
            const auto found = detector.detect(image).corners;
            return found ? by_id(found->pixels, found->points) : TargetPoints{};
        };
    return [target = calibration_target(marker, place)](const CodeImage& image) {
        const auto view = observe(target, image).view;
        return view ? by_id(view->pixels, view->ids) : TargetPoints{};
    };
}

namespace {

// The least-squares line of each quantity over time.
struct Lines {
    Eigen::Matrix4Xd residuals;
    Movement slope;
    double time_squares = 0.0;  // sum of (t - mean)^2, min^2
};

Lines fit_lines(std::span<const DriftBlock> blocks) {
    Eigen::VectorXd times(std::ssize(blocks));
    Eigen::Matrix4Xd values(4, times.size());
    for (Eigen::Index i = 0; i < times.size(); ++i) {
        times[i] = blocks[static_cast<std::size_t>(i)].time.count();
        values.col(i) = blocks[static_cast<std::size_t>(i)].movement;
    }
    times.array() -= times.mean();
    const Movement mean = values.rowwise().mean();
    values.colwise() -= mean;
    const Movement slope = values * times / times.squaredNorm();
    return {values - slope * times.transpose(), slope, times.squaredNorm()};
}

double correlation_of_neighbours(const Eigen::Matrix4Xd& residuals) {
    const double squares = residuals.squaredNorm();
    if (squares == 0.0)
        return 0.0;
    const Eigen::Index n = residuals.cols();
    const double products =
        residuals.leftCols(n - 1).cwiseProduct(residuals.rightCols(n - 1)).sum();
    return std::max(0.0, products / squares);
}

// Slope of a point's residuals; nothing where less than half of the blocks have the point.
std::optional<Eigen::Vector2d> residual_slope(std::span<const DriftBlock> blocks, int id) {
    std::vector<std::pair<double, Eigen::Vector2d>> rows;
    for (const DriftBlock& block : blocks)
        if (const auto at = block.residuals.find(id); at != block.residuals.end())
            rows.emplace_back(block.time.count(), at->second);
    if (2 * rows.size() < blocks.size())
        return std::nullopt;
    double middle = 0.0;
    for (const auto& [time, residual] : rows)
        middle += time / static_cast<double>(rows.size());
    double squares = 0.0;
    Eigen::Vector2d products = Eigen::Vector2d::Zero();
    for (const auto& [time, residual] : rows) {
        squares += (time - middle) * (time - middle);
        products += (time - middle) * residual;
    }
    return squares > 0.0 ? std::optional<Eigen::Vector2d>(products / squares) : std::nullopt;
}

double shape_drift(std::span<const DriftBlock> blocks, const TargetPoints& points) {
    double squares = 0.0;
    int count = 0;
    for (const auto& [id, pixel] : points)
        if (const auto slope = residual_slope(blocks, id)) {
            squares += slope->squaredNorm();
            ++count;
        }
    // Two points' worth of freedom went into the movement.
    return count > 2 ? std::sqrt(squares / (count - 2)) : 0.0;
}

void find_worst(DriftRate& rate, const Eigen::Matrix4d& covariance,
                const TargetReference& reference, cv::Size image) {
    rate.worst_px_per_min = -1.0;
    for (const double x : {-0.5, image.width - 0.5})
        for (const double y : {-0.5, image.height - 0.5}) {
            const auto at = reference.at({x, y});
            const double drift = (at * rate.per_min).norm();
            const Eigen::MatrixXd there = at * covariance * at.transpose();
            // In the direction in which it is largest.
            const double u = std::sqrt(std::max(
                0.0, Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(there, Eigen::EigenvaluesOnly)
                         .eigenvalues()[1]));
            rate.bound_px_per_min =
                std::max(rate.bound_px_per_min, drift + rate.coverage_factor * u);
            if (drift > rate.worst_px_per_min) {
                rate.worst_px_per_min = drift;
                rate.worst_pixel = {x, y};
                rate.standard_uncertainty_px_per_min = u;
            }
        }
    rate.expanded_uncertainty_px_per_min =
        rate.coverage_factor * rate.standard_uncertainty_px_per_min;
}

}  // namespace

std::optional<DriftRate> estimate_drift(std::span<const DriftBlock> blocks,
                                        const TargetReference& reference, cv::Size image,
                                        double chance_of_error) {
    if (blocks.size() < min_blocks || !(blocks.back().time > blocks.front().time))
        return std::nullopt;
    const Lines lines = fit_lines(blocks);
    const auto freedoms = static_cast<int>(blocks.size()) - 2;
    DriftRate rate;
    rate.from = blocks.front().time;
    rate.to = blocks.back().time;
    rate.per_min = lines.slope;
    rate.block_correlation = correlation_of_neighbours(lines.residuals);
    const double widening = (1.0 + rate.block_correlation) / (1.0 - rate.block_correlation);
    const Eigen::Matrix4d covariance =
        widening / (freedoms * lines.time_squares) * lines.residuals * lines.residuals.transpose();
    rate.standard_uncertainty = covariance.diagonal().cwiseSqrt();
    rate.coverage_factor = student_t_quantile(chance_of_error, freedoms);
    find_worst(rate, covariance, reference, image);
    rate.shape_px_per_min = shape_drift(blocks, reference.points());
    return rate;
}

namespace {

constexpr std::size_t half = 5;  // frames before and after
constexpr std::size_t min_steps = 20, max_steps = 300;
constexpr double chance_of_false_jump = 1e-7;  // per frame and component
constexpr double min_jump_px = 0.01;

// Of normal values: standard deviation of the difference of two medians of five over that of the
// difference of two values. The variance of a median of five is 0.2868 (Teichroew 1956).
const double medians_over_steps = std::sqrt(0.2868);

// A standard deviation from the median deviation of n values is as uncertain as the usual one of
// 0.37 n values.
constexpr double median_efficiency = 0.37;

template <class Movements>
std::vector<double> component(const Movements& movements, int index) {
    std::vector<double> values;
    for (const Movement& movement : movements)
        values.push_back(movement[index]);
    return values;
}

template <class Movements>
Movement medians(const Movements& movements) {
    Movement result;
    for (int i = 0; i < 4; ++i)
        result[i] = median(component(movements, i));
    return result;
}

template <class Item>
void push(std::deque<Item>& items, const Item& item, std::size_t most) {
    items.push_back(item);
    if (items.size() > most)
        items.pop_front();
}

// Where the last frames fall into two parts, and how far apart these are.
TargetJump largest_step(std::span<const Movement> frames) {
    const auto step = [&](std::size_t i) { return (frames[i] - frames[i - 1]).norm(); };
    std::size_t first_after = 1;
    for (std::size_t i = 2; i < frames.size(); ++i)
        if (step(i) > step(first_after))
            first_after = i;
    return {static_cast<int>(frames.size() - first_after),
            medians(frames.subspan(first_after)) - medians(frames.first(first_after))};
}

}  // namespace

double JumpFinder::noise_of_difference(int component_index) const {
    return std::max(medians_over_steps * median_deviation(component(steps_, component_index)),
                    median_deviation(component(differences_, component_index)));
}

bool JumpFinder::is_jump(const Movement& difference) const {
    if (steps_.size() < min_steps || differences_.size() < half)
        return false;
    const int freedoms = static_cast<int>(median_efficiency * static_cast<double>(steps_.size()));
    for (int i = 0; i < 4; ++i) {
        const double by_drift = median(component(differences_, i));
        const double size = std::abs(difference[i] - by_drift);
        if (size > min_jump_px && size > student_t_quantile(0.5 * chance_of_false_jump, freedoms) *
                                             noise_of_difference(i))
            return true;
    }
    return false;
}

std::optional<TargetJump> JumpFinder::add(const Movement& movement) {
    if (!recent_.empty())
        push<Movement>(steps_, movement - recent_.back(), max_steps);
    push(recent_, movement, 2 * half);
    if (recent_.size() < 2 * half)
        return std::nullopt;
    const std::vector<Movement> frames(recent_.begin(), recent_.end());
    const std::span all(frames);
    const Movement difference = medians(all.last(half)) - medians(all.first(half));
    if (is_jump(difference))
        return largest_step(all);
    push(differences_, difference, max_steps);
    return std::nullopt;
}

namespace {

constexpr std::array<std::size_t, 3> windows{20, 40, 80};  // blocks

DriftBlock median_of(const std::vector<std::pair<Minutes, TargetReference::Look>>& frames) {
    DriftBlock block;
    std::vector<Movement> movements;
    std::map<int, std::pair<std::vector<double>, std::vector<double>>> residuals;
    for (const auto& [time, look] : frames) {
        block.time += time / static_cast<double>(frames.size());
        movements.push_back(look.movement);
        for (const auto& [id, residual] : look.residuals) {
            residuals[id].first.push_back(residual.x());
            residuals[id].second.push_back(residual.y());
        }
    }
    block.movement = medians(movements);
    for (const auto& [id, xy] : residuals)
        block.residuals[id] = {median(xy.first), median(xy.second)};
    return block;
}

// The median over the true value, of standard deviations from 2 n - 4 normal values.
double median_over_deviation(std::size_t points) {
    const double freedoms = 2.0 * static_cast<double>(std::max<std::size_t>(points, 3)) - 4.0;
    return std::sqrt(reduced_chi_square(0.0, freedoms));
}

}  // namespace

DriftPlan drift_plan(cv::Size image, Minutes interval, Minutes longest) {
    DriftPlan plan;
    plan.image = image;
    plan.block = std::max(plan.block, interval);
    const double blocks = std::floor(longest / plan.block);
    plan.judgements =
        std::max(1, static_cast<int>(windows.size() * std::max(0.0, blocks - min_blocks + 1)));
    return plan;
}

void DriftMonitor::add(Minutes time, const TargetPoints& points) {
    frames_.push_back({.time = time, .part = static_cast<int>(jumps_.size())});
    if (points.size() >= min_target_points)
        look({time, points});
}

void DriftMonitor::look(const Seen& seen) {
    if (!reference_) {
        reference_.emplace(seen.points);
        part_start_ = seen.time;
    }
    const auto look = reference_->look(seen.points);
    if (!look)
        return;
    DriftFrame& frame = *std::find_if(frames_.rbegin(), frames_.rend(),
                                      [&](const DriftFrame& f) { return f.time == seen.time; });
    frame = {seen.time,
             true,
             static_cast<int>(jumps_.size()),
             look->movement,
             reference_->radius(),
             misfit(look->residuals)};
    push(last_seen_, seen, 2 * half);
    note_noise(*look);
    if (const auto jump = jump_finder_.add(look->movement))
        return start_anew(*jump);
    put_into_block(seen.time, *look);
}

void DriftMonitor::note_noise(const TargetReference::Look& look) {
    if (last_look_) {
        TargetPoints steps;
        for (const auto& [id, residual] : look.residuals)
            if (const auto before = last_look_->residuals.find(id);
                before != last_look_->residuals.end())
                steps[id] = (residual - before->second) / std::numbers::sqrt2;
        point_noise_.push_back(misfit(steps) / median_over_deviation(steps.size()));
        const Movement step = (look.movement - last_look_->movement) / std::numbers::sqrt2;
        shake_.push_back(1.4826 * std::abs(step[0]));
        shake_.push_back(1.4826 * std::abs(step[1]));
    }
    last_look_ = look;
}

void DriftMonitor::put_into_block(Minutes time, const TargetReference::Look& look) {
    const auto number = static_cast<long>(std::floor((time - part_start_) / plan_.block));
    if (number != block_number_ && !block_.empty()) {
        blocks_.push_back(median_of(block_));
        block_.clear();
        if (blocks_.size() > windows.back())
            blocks_.erase(blocks_.begin());
        judge();
    }
    block_number_ = number;
    block_.emplace_back(time, look);
}

void DriftMonitor::judge() {
    std::optional<DriftRate> best;
    for (const std::size_t window : windows) {
        const std::size_t count = std::min(window, blocks_.size());
        const auto rate = estimate_drift(std::span(blocks_).last(count), *reference_, plan_.image,
                                         DriftPlan::chance_of_error / plan_.judgements);
        if (rate && (!best || rate->bound_px_per_min < best->bound_px_per_min))
            best = rate;
        if (count < window)
            break;
    }
    if (best)
        rates_.push_back(*best);
    fresh_ = best.has_value();
}

void DriftMonitor::start_anew(const TargetJump& jump) {
    const std::vector<Seen> after(last_seen_.end() - jump.frames_after, last_seen_.end());
    jumps_.push_back({after.front().time, reference_->largest(jump.movement), jump.movement,
                      reference_->radius()});
    fresh_ = false;
    reference_.reset();
    last_seen_.clear();
    last_look_.reset();
    block_.clear();
    block_number_ = 0;
    blocks_.clear();
    jump_finder_.restart();
    for (const Seen& seen : after)
        look(seen);
}

std::optional<double> DriftMonitor::point_noise_px() const {
    return point_noise_.empty() ? std::nullopt : std::optional(median(point_noise_));
}

std::optional<double> DriftMonitor::shake_px() const {
    return shake_.empty() ? std::nullopt : std::optional(median(shake_));
}

}  // namespace etalon
