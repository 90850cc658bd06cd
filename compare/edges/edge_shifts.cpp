#include "compare/edges/edge_shifts.h"

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include "compare/edges/edge_spread.h"
#include "core/program/errors.h"
#include "core/statistics/covariance.h"

namespace etalon {
namespace {

constexpr int places = 5;  // that are rendered, the state's own in the middle
using Weights = Eigen::Matrix<double, places, 1>;

// A piece's place in the image and how the rendered places displace it along its normal.
struct Band {
    Eigen::Vector2d middle, normal, tangent;
    double half_length, half_width;
    double depth_mm;
    Weights displacements;  // px, in the places' order
};

// The five renderings in one region, as the sensor's pixels receive them behind the model's blur.
struct RenderedPlaces {
    cv::Rect region;
    std::array<cv::Mat, places> radiance;  // CV_32FC1 of the region
    std::array<Rigid, places> poses;
};

// The lens's blur of a point at this depth, the model's Gaussian included.
double blur_reach_px(const CameraModel& camera, double depth_mm, double psf_sigma_px) {
    double variance = psf_sigma_px * psf_sigma_px;
    double reach = blur_radius_px(camera, depth_mm);
    if (camera.lens && camera.lens->psf.kind == PointSpread::Kind::gaussian)
        variance += camera.lens->psf.sigma_px * camera.lens->psf.sigma_px;
    else if (camera.lens && camera.lens->psf.kind == PointSpread::Kind::measured)
        reach += 1.0;
    return reach + 2.0 * std::sqrt(variance) + 0.5;
}

// From place to place the marker moves parallel to the image plane: depth and blur stay. It moves
// along the middle between the normals of both families of edges, each edge by `step_px` or so.
Eigen::Vector3d step_between_places(const Projector& projector, const Rigid& camera_from_marker,
                                    const CellGrid& grid) {
    constexpr double step_px = 0.3;
    const auto projected = projector.project_with_jacobian(
        camera_from_marker * grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows()));
    if (!projected)
        throw NumericalError("the marker's centre is not seen by the camera");
    const Eigen::Matrix3d rotation = camera_from_marker.rotation.toRotationMatrix();
    const Eigen::Matrix2d along = projected->jacobian * rotation.leftCols<2>();
    const auto normal_to = [](const Eigen::Vector2d& line) -> Eigen::Vector2d {
        return Eigen::Vector2d(-line.y(), line.x()).normalized();
    };
    const Eigen::Vector2d a = normal_to(along.col(0)), b = normal_to(along.col(1));
    const Eigen::Vector2d middle = (a.dot(b) > 0.0 ? Eigen::Vector2d(a + b) : a - b).normalized();
    if (!middle.allFinite())
        throw NumericalError("the marker is seen edge-on");
    const Eigen::Vector2d displacement_px =
        step_px / std::min(std::abs(middle.dot(a)), std::abs(middle.dot(b))) * middle;
    const Eigen::Matrix2d by_xy = projected->jacobian.leftCols<2>();
    const Eigen::Vector2d xy = by_xy.inverse() * displacement_px;
    if (!xy.allFinite())
        throw NumericalError("the camera's projection is singular at the marker's centre");
    return {xy.x(), xy.y(), 0.0};
}

RenderedPlaces rendered_places(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state) {
    constexpr int room = 16;  // what the model's widest Gaussian brings in
    RenderedPlaces rendered;
    rendered.region = padded(cv::boundingRect(photo.use), room, photo.use.size());
    const Rigid& pose = state.camera_from_marker;
    const Eigen::Vector3d step = step_between_places(camera.projector(), pose, photo.grid);
    for (int place = 0; place < places; ++place) {
        const auto k = static_cast<std::size_t>(place);
        rendered.poses[k] = {pose.rotation, pose.translation + (place - places / 2) * step};
        rendered.radiance[k] =
            blurred(camera.at_sensor({{{photo.grid, rendered.poses[k]}}, photo.background},
                                     rendered.region),
                    state.photometry.psf_sigmas_px());
    }
    return rendered;
}

// Where the pieces of the marker's edges are in the image.
class BandFinder {
public:
    BandFinder(const CellGrid& grid, const Projector& projector, const RenderedPlaces& rendered,
               double psf_sigma_px)
        : grid_(grid), projector_(projector), rendered_(rendered), psf_sigma_px_(psf_sigma_px) {}

    void add_pieces(const GridEdge& edge, std::vector<Band>& bands) const {
        const Eigen::Vector2d middle = edge.at(0.5 * (edge.first + edge.last + 1));
        const auto first = pixel(edge.at(edge.first)), last = pixel(edge.at(edge.last + 1));
        if (!first || !last || !pixel(middle))
            return;  // not in the image
        const double length = (*last - *first).norm();
        const double depth = depth_mm(projector_.camera().projection, pose() * point(middle));
        const double clearance =
            blur_reach_px(projector_.camera(), depth, psf_sigma_px_) + tangential_px;
        const double usable = length - 2.0 * clearance;
        if (usable < min_length_px)
            return;
        const double most = std::max(length / edge.cells(), min_piece_px);
        const int pieces = std::max(1, static_cast<int>(std::ceil(usable / most - 1e-9)));
        // Perspective is even enough along a run of cells to divide it evenly.
        const double keep = clearance / length * edge.cells();
        const double part = (edge.cells() - 2.0 * keep) / pieces;
        for (int i = 0; i < pieces; ++i) {
            const double begin = edge.first + keep + i * part;
            if (const auto band = band_of(edge, begin, begin + part))
                bands.push_back(*band);
        }
    }

private:
    static constexpr double min_length_px = 3.0, min_piece_px = 12.0, min_half_width_px = 2.0;
    static constexpr double tangential_px = 0.6;  // how far crossings move in the displaced places

    const Rigid& pose() const { return rendered_.poses[places / 2]; }
    Eigen::Vector3d point(const Eigen::Vector2d& uv) const {
        return grid_.point_mm(uv.x(), uv.y());
    }
    std::optional<Eigen::Vector2d> pixel(const Eigen::Vector2d& uv) const {
        return projector_.project(pose() * point(uv));
    }

    std::optional<Band> band_of(const GridEdge& edge, double begin, double end) const {
        const Eigen::Vector2d middle_uv = edge.at(0.5 * (begin + end));
        const Eigen::Vector2d across = (edge.rises ? 1.0 : -1.0) * Eigen::Vector2d::Unit(edge.axis);
        const auto first = pixel(edge.at(begin)), last = pixel(edge.at(end));
        const auto middle = pixel(middle_uv), lighter = pixel(middle_uv + 0.5 * across);
        if (!first || !last || !middle || !lighter)
            return {};
        Band band;
        band.middle = *middle;
        band.tangent = (*last - *first).normalized();
        band.normal = {-band.tangent.y(), band.tangent.x()};
        const double half_cell = (*lighter - *middle).dot(band.normal);
        if (half_cell < 0.0)
            band.normal = -band.normal;
        band.half_length = 0.5 * (*last - *first).norm();
        band.depth_mm = depth_mm(projector_.camera().projection, pose() * point(middle_uv));
        band.half_width =
            std::min(std::abs(half_cell) * std::min(edge.reach_before, edge.reach_after),
                     blur_reach_px(projector_.camera(), band.depth_mm, psf_sigma_px_) + 2.0);
        if (!(band.half_width >= min_half_width_px) || !band.tangent.allFinite())
            return {};
        for (int place = 0; place < places; ++place) {
            const auto moved = projector_.project(rendered_.poses[static_cast<std::size_t>(place)] *
                                                  point(middle_uv));
            if (!moved)
                return {};
            band.displacements[place] = (*moved - *middle).dot(band.normal);
        }
        return band;
    }

    const CellGrid& grid_;
    const Projector& projector_;
    const RenderedPlaces& rendered_;
    double psf_sigma_px_;
};

// Values and derivatives of the polynomial through the five places.
class PlaceInterpolant {
public:
    explicit PlaceInterpolant(const Weights& displacements) {
        Eigen::MatrixXd powers(places, places);
        powers.col(0).setOnes();
        for (int j = 1; j < places; ++j)
            powers.col(j) = powers.col(j - 1).cwiseProduct(displacements);
        coefficients_ = powers.partialPivLu().inverse();
    }
    // Of the values at the places: those that make R and its four derivatives at a displacement.
    Eigen::Matrix<double, places, places> weights(double s) const {
        Eigen::Matrix<double, places, places> basis;
        basis << 1.0, 0.0, 0.0, 0.0, 0.0,               //
            s, 1.0, 0.0, 0.0, 0.0,                      //
            s * s, 2.0 * s, 2.0, 0.0, 0.0,              //
            s * s * s, 3.0 * s * s, 6.0 * s, 6.0, 0.0,  //
            s * s * s * s, 4.0 * s * s * s, 12.0 * s * s, 24.0 * s, 24.0;
        return coefficients_.transpose() * basis;
    }

private:
    Eigen::Matrix<double, places, places> coefficients_;
};

struct BandPixel {
    double photo, black, white;  // gray: what is seen, and the prediction's two levels
    double distance;             // px along the normal
    double noise;                // gray
    Vector6d terms;              // level_terms()
    Weights radiance;            // at the places
};

// A pixel's radiance with the edge displaced and with more blur, and its derivatives by both.
struct MovedRadiance {
    double value, displaced, by_shift, by_variance;

    MovedRadiance(const Weights& at_places, const Eigen::Matrix<double, places, places>& weights,
                  double variance) {
        const Eigen::Matrix<double, 1, places> r = at_places.transpose() * weights;
        displaced = r[0];
        value = r[0] + 0.5 * variance * (r[2] + 0.25 * variance * r[4]);
        by_shift = r[1] + 0.5 * variance * r[3];
        by_variance = 0.5 * r[2] + 0.25 * variance * r[4];
    }
};

// What a photograph is expected to show of a radiance.
struct Seen {
    double gray, slope;
    double light;  // 0 on the dark side, 1 on the light one
};

class Photometry {
public:
    Photometry(const PhotometricModel& model, const PhotometricCamera& camera)
        : model_(model), curve_(camera.curve(model)) {}

    Seen seen(const BandPixel& pixel, double radiance) const {
        const auto [encoded, slope] = curve_.at(radiance);
        const PhotometricModel::Point point = model_.at(pixel.terms, encoded);
        return {point.gray, point.by_seen * slope,
                (point.gray - pixel.black) / (pixel.white - pixel.black)};
    }
    double gray(const Vector6d& terms, double seen) const { return model_.at(terms, seen).gray; }

private:
    const PhotometricModel& model_;
    LightCurve curve_;
};

struct EdgePixels {
    std::vector<BandPixel> pixels;
    std::array<int, 3> uses = {};  // by PixelUse
};

EdgePixels pixels_of(const Band& band, const PhotoOfMarker& photo, const RenderedPlaces& rendered,
                     const Photometry& photometry, const PhotometricCamera& camera) {
    const cv::Rect& region = rendered.region;
    const cv::Rect box =
        band_pixels(band.middle, band.normal, band.half_length, band.half_width, region);
    EdgePixels result;
    for (int y = box.y; y < box.br().y; ++y)
        for (int x = box.x; x < box.br().x; ++x) {
            const Eigen::Vector2d from_middle = Eigen::Vector2d(x, y) - band.middle;
            BandPixel pixel;
            pixel.distance = from_middle.dot(band.normal);
            const uchar use = photo.use.at<uchar>(y, x);
            if (use == pixel_outside || std::abs(pixel.distance) > band.half_width ||
                std::abs(from_middle.dot(band.tangent)) > band.half_length)
                continue;
            pixel.terms = level_terms(x, y, photo.use.size());
            pixel.photo = photo.gray.at<float>(y, x);
            pixel.black = photometry.gray(pixel.terms, 0.0);
            pixel.white = photometry.gray(pixel.terms, 1.0);
            for (int k = 0; k < places; ++k)
                pixel.radiance[k] = rendered.radiance[static_cast<std::size_t>(k)].at<float>(
                    y - region.y, x - region.x);
            pixel.noise =
                camera.noise_gray(photometry.seen(pixel, pixel.radiance[places / 2]).gray);
            result.pixels.push_back(pixel);
            ++result.uses[use == pixel_fitted ? 1 : 2];
        }
    return result;
}

class EdgeRegression {
public:
    EdgeRegression(const std::vector<BandPixel>& pixels, const Photometry& photometry,
                   bool knows_noise, const Band& band)
        : pixels_(pixels),
          photometry_(photometry),
          knows_noise_(knows_noise),
          interpolant_(band.displacements),
          range_(1.1 * std::min(std::abs(band.displacements[0]),
                                std::abs(band.displacements[places - 1]))),
          rows_(static_cast<Eigen::Index>(pixels.size()), 4),
          residuals_(static_cast<Eigen::Index>(pixels.size())) {}

    // False when the pixels do not determine the unknowns.
    bool solve(EdgeShift& edge) {
        constexpr int max_steps = 8;
        constexpr double settled = 0.01;  // of a deviation
        constexpr double rounding = 1e-8;
        for (int step = 0; step < max_steps; ++step) {
            evaluate();
            const auto inverse = covariance_from_information(rows_.transpose() * rows_, rounding);
            if (!inverse)
                return false;
            covariance_ = *inverse;
            const Eigen::Vector4d change = covariance_ * (rows_.transpose() * residuals_);
            unknowns_ += change;
            if (std::abs(unknowns_[0]) > range_) {
                unknowns_[0] = std::copysign(range_, unknowns_[0]);
                edge.is_beyond_range = true;
                break;
            }
            if ((change.array().abs() < settled * covariance_.diagonal().array().sqrt()).all())
                break;
        }
        evaluate();
        report(edge);
        return true;
    }

private:
    // Rows and residuals, both over the noise, at the unknowns.
    void evaluate() {
        const auto weights = interpolant_.weights(unknowns_[0]);
        for (Eigen::Index i = 0; i < residuals_.size(); ++i) {
            const BandPixel& pixel = pixels_[static_cast<std::size_t>(i)];
            const MovedRadiance radiance(pixel.radiance, weights, unknowns_[1]);
            const Seen seen = photometry_.seen(pixel, radiance.value);
            const double gray =
                seen.gray + (1.0 - seen.light) * unknowns_[2] + seen.light * unknowns_[3];
            rows_.row(i) << seen.slope * radiance.by_shift, seen.slope * radiance.by_variance,
                1.0 - seen.light, seen.light;
            rows_.row(i) /= pixel.noise;
            residuals_[i] = (pixel.photo - gray) / pixel.noise;
        }
    }

    void report(EdgeShift& edge) const {
        const double freedom = std::max(1.0, static_cast<double>(pixels_.size()) - 4.0);
        edge.reduced_chi_square = residuals_.squaredNorm() / freedom;
        const double factor = knows_noise_ ? std::max(1.0, std::sqrt(edge.reduced_chi_square))
                                           : std::sqrt(edge.reduced_chi_square);
        const Eigen::Vector4d deviations = factor * covariance_.diagonal().cwiseSqrt();
        const auto set = [&](int i, double& value, double& deviation) {
            value = unknowns_[i];
            deviation = deviations[i];
        };
        set(0, edge.shift_px, edge.shift_deviation_px);
        set(1, edge.blur_variance_px2, edge.blur_deviation_px2);
        set(2, edge.black_gray, edge.black_deviation_gray);
        set(3, edge.white_gray, edge.white_deviation_gray);
        edge.pixels = static_cast<int>(pixels_.size());
        const auto at_rest = interpolant_.weights(0.0), moved = interpolant_.weights(unknowns_[0]);
        double spread = 0.0, second_moment = 0.0, step = 0.0;
        for (std::size_t i = 0; i < pixels_.size(); ++i) {
            const BandPixel& pixel = pixels_[i];
            const MovedRadiance before(pixel.radiance, at_rest, 0.0);
            const MovedRadiance after(pixel.radiance, moved, unknowns_[1]);
            const double predicted = photometry_.seen(pixel, before.value).gray;
            const double displaced = photometry_.seen(pixel, after.displaced).gray;
            const Seen fitted = photometry_.seen(pixel, after.value);
            const double residual = pixel.photo - predicted;
            const double shift = displaced - predicted, blur = fitted.gray - displaced;
            const double levels = (1.0 - fitted.light) * unknowns_[2] + fitted.light * unknowns_[3];
            edge.shares.shift += shift * residual;
            edge.shares.blur += blur * residual;
            edge.shares.photometric += levels * residual;
            edge.shares.rest += (residual - shift - blur - levels) * residual;
            spread -= before.by_shift;
            second_moment -= before.by_shift * pixel.distance * pixel.distance;
            step += pixel.white - pixel.black;
        }
        edge.rendered_variance_px2 = spread > 0.0 ? second_moment / spread : 0.0;
        edge.step_gray = step / static_cast<double>(pixels_.size()) + unknowns_[3] - unknowns_[2];
    }

    const std::vector<BandPixel>& pixels_;
    const Photometry& photometry_;
    bool knows_noise_;
    PlaceInterpolant interpolant_;
    double range_;
    Eigen::Matrix<double, Eigen::Dynamic, 4> rows_;
    Eigen::VectorXd residuals_;
    Eigen::Vector4d unknowns_ = Eigen::Vector4d::Zero();
    Eigen::Matrix4d covariance_ = Eigen::Matrix4d::Zero();
};

}  // namespace

std::vector<EdgeShift> edge_shifts(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                                   const PhotoState& state) {
    constexpr float min_contrast = 0.1f;  // of radiance, between the cells
    constexpr std::size_t min_pixels = 16;
    require_point_of_view(camera.model(), "comparing edges");
    require_fitting(photo, camera);
    const PhotometricModel& model = state.photometry;
    if (!cv::checkRange(photo.gray) || !model.black.allFinite() || !model.white.allFinite() ||
        !std::isfinite(model.tone) || !std::isfinite(model.psf_sigma_px))
        throw NumericalError("edges: a photograph or photometric model that is not finite");
    if (cv::countNonZero(photo.use) == 0)
        throw NumericalError("edges: no pixel of the marker is compared");
    const RenderedPlaces rendered = rendered_places(photo, camera, state);
    const Photometry photometry(state.photometry, camera);
    const BandFinder finder(photo.grid, camera.projector(), rendered,
                            state.photometry.psf_sigma_px);
    std::vector<EdgeShift> result;
    std::vector<Band> bands;
    for (const GridEdge& edge : grid_edges(photo.grid))
        if (edge.contrast >= min_contrast)
            finder.add_pieces(edge, bands);
    const Eigen::Vector2d centre(0.5 * (photo.use.cols - 1), 0.5 * (photo.use.rows - 1));
    for (const Band& band : bands) {
        const EdgePixels found = pixels_of(band, photo, rendered, photometry, camera);
        if (found.pixels.size() < min_pixels)
            continue;
        EdgeShift edge{.middle_px = band.middle,
                       .normal = band.normal,
                       .length_px = 2.0 * band.half_length,
                       .half_width_px = band.half_width,
                       .depth_mm = band.depth_mm,
                       .radius_px = (band.middle - centre).norm(),
                       .use = found.uses[1] >= found.uses[2] ? pixel_fitted : pixel_scored};
        if (EdgeRegression(found.pixels, photometry, camera.knows_noise(), band).solve(edge))
            result.push_back(edge);
    }
    return result;
}

}  // namespace etalon
