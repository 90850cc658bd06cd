#include "compare/characterise/illumination_estimate.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "compare/characterise/code_statistics.h"
#include "compare/photometric/compared_area.h"
#include "core/program/errors.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr double max_clipped_of_a_patch = 1e-3;
constexpr double max_contrast = 20.0;
constexpr int blocks_across = 40;
constexpr int min_white_patches = 20, min_patches_of_a_photo = 4;
constexpr double min_radius = 0.6;
constexpr double max_residual = 0.05;
constexpr double max_corner_uncertainty = 0.025;
constexpr int illumination_rounds = 20;

// Radiance and its uncertainty from a code value's.
WhitePatch linear_patch(const CameraModel& camera, double mean, double uncertainty) {
    const Sensor sensor = camera.sensor.value_or(Sensor{});
    const double range = (1 << sensor.bits) - 1 - sensor.black_dn;
    const double code = (mean - sensor.black_dn) / range;
    constexpr double step = 1e-3;
    const double slope = (decode(sensor.transfer, std::min(code, 1.0 - step) + step) -
                          decode(sensor.transfer, std::min(code, 1.0 - step) - step)) /
                         (2.0 * step);
    WhitePatch patch;
    patch.radiance = decode(sensor.transfer, code);
    patch.standard_uncertainty = uncertainty / range * slope;
    return patch;
}

struct Row {
    double squared_radius;
    double x, y;  // from the image's centre, half diagonals
    double cos4;
    int photo;
};

class Falloff {
public:
    Falloff(const std::vector<WhitePatch>& patches, const CameraModel& camera) : patches_(patches) {
        const Projector projector(camera);
        const Eigen::Vector2d middle(0.5 * (camera.width - 1), 0.5 * (camera.height - 1));
        const double diagonal = std::hypot(camera.width, camera.height);
        for (const WhitePatch& patch : patches) {
            const Eigen::Vector2d place = 2.0 * (patch.centre_px - middle) / diagonal;
            const auto ray = projector.unproject(patch.centre_px);
            rows_.push_back({illumination_radius_squared(camera, patch.centre_px), place.x(),
                             place.y(), ray ? 1.0 / std::pow(1.0 + ray->squaredNorm(), 2) : 1.0,
                             patch.photo});
            photos_ = std::max(photos_, patch.photo + 1);
        }
    }

    int photos() const { return photos_; }
    const std::vector<Row>& rows() const { return rows_; }

    struct Fit {
        Eigen::Vector3d coefficients = Eigen::Vector3d::Zero();
        Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
        Eigen::VectorXd planes;  // level and slopes of each photograph
        double chi_square = 0.0;
    };

    // Gauss and Newton's method; the coefficients stay 0 for a fixed shape.
    Fit fit(Illumination::Kind kind) const {
        const int shape = kind == Illumination::Kind::polynomial ? 3 : 0;
        const int size = shape + 3 * photos_;
        Fit result;
        result.planes = Eigen::VectorXd::Zero(3 * photos_);
        for (std::size_t i = 0; i < rows_.size(); ++i)
            result.planes(3 * rows_[i].photo) = patches_[i].radiance;
        for (int round = 0; round < illumination_rounds; ++round) {
            Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size, size);
            Eigen::VectorXd right = Eigen::VectorXd::Zero(size);
            result.chi_square = accumulate(kind, result, normal, right);
            const Eigen::LDLT<Eigen::MatrixXd> factor(normal);
            const Eigen::VectorXd step = factor.solve(right);
            if (!step.allFinite())
                throw NumericalError("illumination: the white parts do not determine the falloff");
            result.planes += step.tail(3 * photos_);
            if (shape == 0)
                continue;
            result.coefficients += step.head<3>();
            result.covariance =
                factor.solve(Eigen::MatrixXd::Identity(size, size)).topLeftCorner(3, 3);
        }
        return result;
    }

    double plane(const Fit& fit, const Row& row) const {
        const Eigen::Vector3d p = fit.planes.segment<3>(3 * row.photo);
        return p(0) + p(1) * row.x + p(2) * row.y;
    }

private:
    static double shape_of(Illumination::Kind kind, const Fit& fit, const Row& row) {
        const Eigen::Vector3d& c = fit.coefficients;
        if (kind == Illumination::Kind::cos4)
            return row.cos4;
        return polynomial_illumination({c(0), c(1), c(2)}, row.squared_radius);
    }

    double accumulate(Illumination::Kind kind, const Fit& fit, Eigen::MatrixXd& normal,
                      Eigen::VectorXd& right) const {
        const int shape = static_cast<int>(normal.rows()) - 3 * photos_;
        double chi_square = 0.0;
        for (std::size_t i = 0; i < rows_.size(); ++i) {
            const Row& row = rows_[i];
            const double level = plane(fit, row), falloff = shape_of(kind, fit, row);
            const double weight = 1.0 / patches_[i].standard_uncertainty;
            const double residual = weight * (patches_[i].radiance - level * falloff);
            // Only the shape's and this photograph's parameters have a derivative.
            Eigen::Matrix<double, 6, 1> d;
            const double s = row.squared_radius;
            d << level * s, level * s * s, level * s * s * s, falloff, falloff * row.x,
                falloff * row.y;
            d *= weight;
            const int at = shape + 3 * row.photo;
            const auto own = d.tail<3>();
            normal.block<3, 3>(at, at) += own * own.transpose();
            right.segment<3>(at) += residual * own;
            if (shape > 0) {
                const auto common = d.head<3>();
                normal.topLeftCorner<3, 3>() += common * common.transpose();
                normal.block<3, 3>(0, at) += common * own.transpose();
                normal.block<3, 3>(at, 0) += own * common.transpose();
                right.head<3>() += residual * common;
            }
            chi_square += residual * residual;
        }
        return chi_square;
    }

    const std::vector<WhitePatch>& patches_;
    std::vector<Row> rows_;
    int photos_ = 0;
};

// Photographs with too few patches for a level and a plane are left out, the others renumbered.
std::vector<WhitePatch> usable(std::span<const WhitePatch> given) {
    std::map<int, int> count, number;
    for (const WhitePatch& patch : given)
        ++count[patch.photo];
    std::vector<WhitePatch> patches;
    for (WhitePatch patch : given) {
        if (count[patch.photo] < min_patches_of_a_photo)
            continue;
        patch.photo = number.emplace(patch.photo, static_cast<int>(number.size())).first->second;
        patches.push_back(patch);
    }
    if (patches.size() < min_white_patches)
        throw NumericalError(fmt::format("illumination: {} even white parts; {} are needed",
                                         patches.size(), min_white_patches));
    return patches;
}

void take_residuals(const std::vector<WhitePatch>& patches, const Falloff& falloff,
                    const Falloff::Fit& fit, IlluminationEstimate& estimate) {
    double square = 0.0;
    for (std::size_t i = 0; i < patches.size(); ++i) {
        const Row& row = falloff.rows()[i];
        const double level = falloff.plane(fit, row);
        const double expected = polynomial_illumination(estimate.coefficients, row.squared_radius);
        WhitePatch relative = patches[i];
        relative.radiance /= level;
        relative.standard_uncertainty /= std::abs(level);
        square += std::pow(relative.radiance / expected - 1.0, 2);
        estimate.used.push_back(relative);
    }
    estimate.residual_rms = std::sqrt(square / static_cast<double>(patches.size()));
    if (!(estimate.residual_rms < max_residual))
        throw NumericalError(
            fmt::format("illumination: the white parts scatter by {:.2g} % about any falloff: the "
                        "field is not uniform, or shadows lie on it",
                        100.0 * estimate.residual_rms));
}

// By the information criterion, chi-squares in units of the polynomial's.
void choose_kind(const Falloff& falloff, const Falloff::Fit& fit, Projection projection,
                 IlluminationEstimate& estimate) {
    const double excess = std::max(estimate.reduced_chi_square, 1.0);
    std::vector<std::pair<double, Illumination::Kind>> by_criterion;
    const auto add = [&](Illumination::Kind kind, double chi_square, int parameters) {
        by_criterion.emplace_back(chi_square / excess + parameters * std::log(estimate.patches),
                                  kind);
    };
    const int planes = 3 * estimate.photos;
    using enum Illumination::Kind;
    add(uniform, falloff.fit(uniform).chi_square, planes);
    if (projection == Projection::perspective)
        add(cos4, falloff.fit(cos4).chi_square, planes);
    add(polynomial, fit.chi_square, planes + 3);
    estimate.illumination.kind = std::ranges::min(by_criterion).second;
}

void require_positive(CameraModel camera, const Illumination& illumination) {
    if (!camera.sensor)
        camera.sensor.emplace();
    camera.sensor->illumination = illumination;
    if (const double least = least_polynomial_illumination(camera); !(least > 0.0))
        throw NumericalError(fmt::format(
            "illumination: the polynomial falls to {:.3g} where no white part was seen", least));
}

}  // namespace

std::vector<WhitePatch> flat_patches(const CodeImage& flat, const CameraModel& camera, int photo,
                                     const std::string& name) {
    const int saturation = saturation_code({&flat, 1});
    const auto refuse = [&](double share, const char* why) {
        if (share > max_clipped_of_a_patch)
            throw NumericalError(fmt::format("illumination: {}: {:.3g} % of the pixels are {}",
                                             name, 100.0 * share, why));
    };
    refuse(share_at_saturation(flat, saturation), "saturated: expose less");
    refuse(share_at_floor(flat), "at code 0: expose more, or raise the black level");
    const Mosaic mosaic = camera.sensor ? camera.sensor->mosaic : Mosaic::none;
    std::vector<WhitePatch> patches;
    for (const cv::Rect& block : image_blocks(flat.pixels.size(), blocks_across)) {
        const PatchStatistics statistics = patch_statistics(flat, block, saturation, mosaic);
        WhitePatch patch = linear_patch(camera, statistics.mean, statistics.standard_uncertainty);
        patch.photo = photo;
        patch.centre_px = {block.x + 0.5 * (block.width - 1), block.y + 0.5 * (block.height - 1)};
        patches.push_back(patch);
    }
    const auto [least, most] = std::ranges::minmax(patches, {}, &WhitePatch::radiance);
    if (!(most.radiance < max_contrast * least.radiance))
        throw NumericalError(
            fmt::format("illumination: {}: is no photo of a uniform field: the light falls from "
                        "{:.3g} to {:.3g} of full scale",
                        name, most.radiance, least.radiance));
    return patches;
}

double standard_uncertainty_at(const IlluminationEstimate& estimate, double radius) {
    const double s = radius * radius;
    const Eigen::Vector3d powers(s, s * s, s * s * s);
    return std::sqrt(std::max(powers.dot(estimate.covariance * powers), 0.0));
}

IlluminationEstimate estimate_illumination(std::span<const WhitePatch> given,
                                           const CameraModel& camera) {
    const std::vector<WhitePatch> patches = usable(given);
    const Falloff falloff(patches, camera);
    IlluminationEstimate estimate;
    estimate.patches = static_cast<int>(patches.size());
    estimate.photos = falloff.photos();
    for (const Row& row : falloff.rows())
        estimate.farthest_radius =
            std::max(estimate.farthest_radius, std::sqrt(row.squared_radius));
    if (estimate.farthest_radius < min_radius)
        throw NumericalError(fmt::format(
            "illumination: white parts reach {:.2f} of the way to the image's corners; {:.1f} are "
            "needed",
            estimate.farthest_radius, min_radius));
    const Falloff::Fit fit = falloff.fit(Illumination::Kind::polynomial);
    estimate.degrees_of_freedom = estimate.patches - 3 - 3 * estimate.photos;
    estimate.reduced_chi_square = fit.chi_square / std::max(estimate.degrees_of_freedom, 1);
    const double excess = std::max(estimate.reduced_chi_square, 1.0);
    estimate.covariance = fit.covariance * excess;
    for (int i = 0; i < 3; ++i) {
        estimate.coefficients[i] = fit.coefficients(i);
        estimate.standard_uncertainty[i] = std::sqrt(estimate.covariance(i, i));
    }
    take_residuals(patches, falloff, fit, estimate);
    double farthest = 0.0;
    for (const double x : {-0.5, camera.width - 0.5})
        for (const double y : {-0.5, camera.height - 0.5})
            farthest = std::max(farthest, illumination_radius_squared(camera, {x, y}));
    const double corner = std::sqrt(farthest);
    estimate.at_corner = polynomial_illumination(estimate.coefficients, corner * corner);
    estimate.at_corner_standard_uncertainty = standard_uncertainty_at(estimate, corner);

    // With less any falloff would fit, and the simplest one would be chosen without evidence.
    if (estimate.at_corner_standard_uncertainty > max_corner_uncertainty)
        throw NumericalError(fmt::format(
            "illumination: the white parts tell the falloff in the corner to {:.2f} +- {:.2f} only "
            "(k = 2): flats, or the target in more places up to the corners",
            estimate.at_corner, 2.0 * estimate.at_corner_standard_uncertainty));

    choose_kind(falloff, fit, camera.projection.kind, estimate);
    if (estimate.illumination.kind == Illumination::Kind::polynomial) {
        estimate.illumination.polynomial = estimate.coefficients;
        require_positive(camera, estimate.illumination);
    }
    return estimate;
}

// The white squares of a target as samples of the light that falls into the image.

namespace {

constexpr double inside_px = 4.0, inside_cell = 0.25;
constexpr int min_pixels_of_a_cell = 9;
constexpr float min_white = 0.5f;

struct CellSums {
    double pixels = 0.0, radiance = 0.0, square = 0.0, x = 0.0, y = 0.0;
    bool is_clipped = false;
};

// Where a pixel's ray meets the target's plane; nothing behind the lens or edge-on.
std::optional<Eigen::Vector2d> on_target(const Projector& projector,
                                         const Rigid& camera_from_marker,
                                         const Eigen::Vector2d& pixel) {
    const auto seen = projector.unproject(pixel);
    if (!seen)
        return std::nullopt;
    const bool is_telecentric = projector.camera().projection.kind == Projection::telecentric;
    const Rigid to_marker = camera_from_marker.inverse();
    const Eigen::Vector3d point = to_marker * Eigen::Vector3d(seen->x(), seen->y(), 0.0);
    const Eigen::Vector3d origin = is_telecentric ? point : to_marker.translation;
    const Eigen::Vector3d direction =
        to_marker.rotation *
        (is_telecentric ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d(seen->homogeneous()));
    const double along = -origin.z() / direction.z();
    if (std::abs(direction.z()) < 1e-9 || !(along > 0.0))
        return std::nullopt;
    return (origin + along * direction).head<2>();
}

// Pixels per mm on the target, the smaller of both directions.
double px_per_mm(const Projector& projector, const Rigid& camera_from_marker,
                 const Eigen::Vector2d& point) {
    const Eigen::Vector3d p(point.x(), point.y(), 0.0);
    const auto projected = projector.project_with_jacobian(camera_from_marker * p);
    if (!projected)
        return 0.0;
    const Eigen::Matrix<double, 2, 3> j =
        projected->jacobian * camera_from_marker.rotation.toRotationMatrix();
    return std::min(j.col(0).norm(), j.col(1).norm());
}

// Nothing of a cell that is clipped or hardly seen.
std::optional<WhitePatch> patch_of(const CellSums& cell, int photo, double full_scale) {
    if (cell.is_clipped || cell.pixels < min_pixels_of_a_cell)
        return std::nullopt;
    WhitePatch patch;
    patch.photo = photo;
    patch.radiance = cell.radiance / cell.pixels;
    patch.centre_px = Eigen::Vector2d(cell.x, cell.y) / cell.pixels;
    const double variance =
        std::max(cell.square / cell.pixels - patch.radiance * patch.radiance, 0.0) * cell.pixels /
        (cell.pixels - 1.0);
    const double rounding = 0.29 / full_scale;
    patch.standard_uncertainty = std::hypot(std::sqrt(variance), rounding) / std::sqrt(cell.pixels);
    return patch;
}

}  // namespace

std::vector<WhitePatch> white_cell_patches(const CodeImage& image, const Projector& projector,
                                           const CellGrid& grid, const Rigid& camera_from_marker,
                                           int photo) {
    const Radiance radiance = SensorModel(projector.camera()).linear_radiance(image);
    const cv::Mat clipped = image.pixels >= image.full_scale();
    std::map<std::pair<int, int>, CellSums> cells;
    const Eigen::Vector2d size =
        grid.cell_mm.cwiseProduct(Eigen::Vector2d(grid.columns(), grid.rows()));
    const cv::Rect box =
        candidate_pixels(projector, camera_from_marker,
                         {grid.corner_mm, grid.corner_mm + size, grid.cell_mm, grid.corner_mm});
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x) {
            const auto point = on_target(projector, camera_from_marker, Eigen::Vector2d(x, y));
            if (!point)
                continue;
            const Eigen::Vector2d place = (*point - grid.corner_mm).cwiseQuotient(grid.cell_mm);
            const int column = static_cast<int>(std::floor(place.x()));
            const int row = static_cast<int>(std::floor(place.y()));
            // The outermost cells are the margin, of which prints have more or less.
            if (column < 1 || row < 1 || column + 1 >= grid.columns() || row + 1 >= grid.rows() ||
                grid.cells.at<float>(row, column) < min_white)
                continue;
            const Eigen::Array2d within(place.x() - column, place.y() - row);
            const double border = within.min(1.0 - within).minCoeff();
            const double border_px =
                border * grid.cell_mm.minCoeff() * px_per_mm(projector, camera_from_marker, *point);
            if (border < inside_cell || border_px < inside_px)
                continue;
            CellSums& cell = cells[{row, column}];
            const double value = radiance.at<float>(y, x);
            cell.is_clipped |= clipped.at<uchar>(y, x) > 0;
            cell.pixels += 1.0;
            cell.radiance += value;
            cell.square += value * value;
            cell.x += x;
            cell.y += y;
        }
    std::vector<WhitePatch> patches;
    for (const auto& [place, cell] : cells)
        if (const auto patch = patch_of(cell, photo, image.full_scale()))
            patches.push_back(*patch);
    return patches;
}

}  // namespace etalon
