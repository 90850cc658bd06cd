#include "sim/sensor/disturbances.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "core/image/picture_codec.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"
#include "sim/tiles/lens_average.h"

namespace etalon {
namespace {

constexpr double mid_gray = 0.5;

// Upper half of a stream's index: what the numbers are for. The sensor's noise has 0 there.
constexpr std::uint64_t for_directions = std::uint64_t{1} << 32;
constexpr std::uint64_t for_noise = std::uint64_t{2} << 32;

[[noreturn]] void refuse(const DisturbanceAxis& axis, double value) {
    throw NumericalError(fmt::format("disturbance {}: {} is not within {}..{}", axis.name, value,
                                     axis.least, axis.most));
}

bool is_undisturbed(const Disturbances& disturbances) {
    return std::all_of(disturbance_axes.begin(), disturbance_axes.end(), [&](const auto& axis) {
        return axis.value == &Disturbances::jpeg_quality ||
               disturbances.*axis.value == axis.neutral();
    });
}

void fade(double contrast, Radiance& radiance) {
    for (int y = 0; y < radiance.rows; ++y)
        for (float *p = radiance.ptr<float>(y), *end = p + radiance.cols; p != end; ++p)
            *p = static_cast<float>(mid_gray + contrast * (*p - mid_gray));
}

// `fall` points to the dark corner. The extent is the image's, from outer corner to outer corner
// of the pixels, along it.
void light(double exposure, double uneven, const Eigen::Vector2d& fall, Radiance& radiance) {
    const double extent = std::abs(fall.x()) * radiance.cols + std::abs(fall.y()) * radiance.rows;
    const Eigen::Vector2d centre(0.5 * (radiance.cols - 1), 0.5 * (radiance.rows - 1));
    for (int y = 0; y < radiance.rows; ++y) {
        float* row = radiance.ptr<float>(y);
        for (int x = 0; x < radiance.cols; ++x) {
            const double along = fall.x() * (x - centre.x()) + fall.y() * (y - centre.y());
            row[x] =
                static_cast<float>(row[x] * exposure * (1.0 - uneven * (0.5 + along / extent)));
        }
    }
}

// The card hides where edge . (x, y, 1) >= 0, for undistorted sensor points (x, y): its edge in
// the grid's coordinates (u, v, 1), taken to the sensor by the view's homography.
Eigen::Vector3d card_edge(const PlacedMarker& marker, const MarkerView& view, double share,
                          const Eigen::Vector2d& from) {
    const Eigen::Vector2d cells(view.columns(), view.rows());
    // In a square of side 1 about the marker's centre shares of the area are the same.
    const Eigen::Vector2d gradient = from.cwiseProduct(marker.grid.cell_mm.cwiseProduct(cells));
    const double offset = offset_of_area(gradient, share);
    const Eigen::Vector2d by_cell = gradient.cwiseQuotient(cells);
    const Eigen::Vector3d edge(by_cell.x(), by_cell.y(), offset - 0.5 * gradient.sum());
    return view.h().transpose() * edge;
}

// Draws the card group by group of tiles, pixel by pixel only along its edge.
class CardDrawing {
public:
    CardDrawing(const UndistortionMap& map, const Eigen::Vector3d& edge, Radiance& radiance)
        : map_(map), edge_(edge), image_({0, 0}, radiance.size()), radiance_(radiance) {
        const int top = map_.levels() - 1;
        draw_groups(top, map_.groups(top));
    }

private:
    void draw_groups(int level, const cv::Rect& groups) {
        for (int j = groups.y; j < groups.br().y; ++j)
            for (int i = groups.x; i < groups.br().x; ++i)
                draw_group(level, i, j);
    }

    void draw_group(int level, int i, int j) {
        const UndistortionMap::Validity validity = map_.group(level, i, j).validity;
        const Box& box = map_.group(level, i, j).bounds;
        if (validity == UndistortionMap::Validity::none)
            return;
        const double middle = edge_.head<2>().dot(box.centre()) + edge_.z();
        const double reach = edge_.head<2>().cwiseAbs().dot(box.half());
        if (middle + reach <= 0.0)
            return;
        if (middle - reach >= 0.0 && validity == UndistortionMap::Validity::all)
            radiance_(square(tile_px << 2 * level, i, j) & image_).setTo(mid_gray);
        else if (level > 0)
            draw_groups(level - 1,
                        square(UndistortionMap::group_side, i, j) & map_.groups(level - 1));
        else
            draw_tile(i, j);
    }

    static cv::Rect square(int side, int i, int j) { return {side * i, side * j, side, side}; }

    // The edge is taken as straight within a pixel.
    void draw_tile(int i, int j) {
        constexpr int n = tile_px;
        map_.sample(i, j, n, points_);
        for (int k = 0; k < n * n; ++k) {
            const cv::Point pixel(n * i + k % n, n * j + k / n);
            const auto& point = points_[static_cast<std::size_t>(k)];
            if (!point || !image_.contains(pixel))
                continue;
            const Eigen::Vector2d gradient = point->jacobian.transpose() * edge_.head<2>();
            const double offset = edge_.head<2>().dot(point->x) + edge_.z();
            float& seen = radiance_.at<float>(pixel);
            seen = static_cast<float>(seen + square_cut(gradient, offset).area * (mid_gray - seen));
        }
    }

    const UndistortionMap& map_;
    Eigen::Vector3d edge_;
    cv::Rect image_;
    Radiance& radiance_;
    std::vector<std::optional<MappedPoint>> points_;
};

// The pixels at +- `at` count with this weight each.
struct Tap {
    cv::Point at;
    float weight;
};

double keys_weight(double distance) {
    const double t = std::abs(distance);
    if (t < 1.0)
        return (1.5 * t - 2.5) * t * t + 1.0;
    return t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0 : 0.0;
}

// Where the line (from -1/2 to 1/2 of the motion) passes from one polynomial to the next, and its
// ends.
std::vector<double> pieces(const Eigen::Vector2d& motion_px) {
    std::vector<double> ends{-0.5, 0.5};
    for (const double length : {std::abs(motion_px.x()), std::abs(motion_px.y())})
        for (int n = 0; n < 0.5 * length; ++n) {
            ends.push_back(n / length);
            ends.push_back(-n / length);
        }
    std::sort(ends.begin(), ends.end());
    return ends;
}

cv::Point reach_of(const Eigen::Vector2d& motion_px) {
    return {static_cast<int>(std::ceil(0.5 * std::abs(motion_px.x()))) + 2,
            static_cast<int>(std::ceil(0.5 * std::abs(motion_px.y()))) + 2};
}

// Gauss and Legendre's four points are exact for the degree 6 of a product of two cubics. One tap
// of each pair: a line is its own mirror image. The middle's weight is what they leave of 1.
std::vector<Tap> line_taps(const Eigen::Vector2d& motion_px) {
    constexpr std::array<std::pair<double, double>, 4> gauss{
        {{-0.8611363115940526, 0.3478548451374538},
         {-0.3399810435848563, 0.6521451548625461},
         {0.3399810435848563, 0.6521451548625461},
         {0.8611363115940526, 0.3478548451374538}}};
    const cv::Point reach = reach_of(motion_px);
    cv::Mat_<double> kernel = cv::Mat_<double>::zeros(2 * reach.y + 1, 2 * reach.x + 1);
    const auto add_point = [&](const Eigen::Vector2d& point, double weight) {
        const int left = static_cast<int>(std::floor(point.x())) - 1;
        const int top = static_cast<int>(std::floor(point.y())) - 1;
        for (int y = top; y < top + 4; ++y)
            for (int x = left; x < left + 4; ++x)
                kernel(reach.y + y, reach.x + x) +=
                    weight * keys_weight(point.x() - x) * keys_weight(point.y() - y);
    };
    const std::vector<double> ends = pieces(motion_px);
    for (std::size_t i = 1; i < ends.size(); ++i) {
        const double half = 0.5 * (ends[i] - ends[i - 1]), middle = 0.5 * (ends[i] + ends[i - 1]);
        if (half > 0.0)
            for (const auto& [node, weight] : gauss)
                add_point((middle + half * node) * motion_px, half * weight);
    }
    std::vector<Tap> taps;
    for (int y = 0; y <= reach.y; ++y)
        for (int x = y == 0 ? 1 : -reach.x; x <= reach.x; ++x)
            if (const auto weight = static_cast<float>(kernel(reach.y + y, reach.x + x));
                weight != 0.0f)
                taps.push_back({{x, y}, weight});
    return taps;
}

// As differences from the middle pixel, so that what is even stays so to the last bit.
void add_tap(const Tap& tap, const float* middle, std::ptrdiff_t row, int count, float* to) {
    const std::ptrdiff_t offset = tap.at.y * row + tap.at.x;
    const float *ahead = middle + offset, *behind = middle - offset;
    for (int x = 0; x < count; ++x)
        to[x] += tap.weight * ((ahead[x] - middle[x]) + (behind[x] - middle[x]));
}

}  // namespace

DisturbanceDirections disturbance_directions(const NoiseKey& key) {
    RandomStream random(key.seed, key.frame, for_directions);
    const auto direction = [&]() -> Eigen::Vector2d {
        const double angle = 2.0 * std::numbers::pi * random.uniform();
        return {std::cos(angle), std::sin(angle)};
    };
    return {direction(), direction(), direction()};
}

Disturber::Disturber(const CameraModel& camera, const SensorModel& sensor)
    : projector_(camera),
      aperture_(aperture_of(camera)),
      response_(sensor.relative_response()),
      range_dn_(sensor.range_dn()) {
    if (camera.projection.is_flat())
        map_.emplace(projector_, 0);
}

void Disturber::hide(const PlacedMarker& marker, double share, const Eigen::Vector2d& from,
                     Radiance& radiance) const {
    const Eigen::Quaterniond turn = turn_towards(marker, projector_.camera());
    const PlacedMarker seen = map_ ? marker : turned(marker, turn);
    const Eigen::Vector3d edge = card_edge(seen, MarkerView(seen, 0.0, aperture_), share, from);
    if (map_)
        CardDrawing(*map_, edge, radiance);
    else
        CardDrawing(UndistortionMap(projector_.turned(turn), 0), edge, radiance);
}

// The sensor multiplies by its response, which must not reach this noise. One stream a row.
void Disturber::add_noise(double noise_dn, const NoiseKey& key, Radiance& radiance) const {
    const double deviation = noise_dn / range_dn_;
    for (int y = 0; y < radiance.rows; ++y) {
        RandomStream random(key.seed, key.frame, for_noise + static_cast<std::uint64_t>(y));
        float* row = radiance.ptr<float>(y);
        const float* response = response_.empty() ? nullptr : response_.ptr<float>(y);
        for (int x = 0; x < radiance.cols; ++x) {
            const double noise = deviation * random.normal();
            row[x] = static_cast<float>(row[x] + (response ? noise / response[x] : noise));
        }
    }
}

Radiance Disturber::disturbed(const Radiance& radiance, const PlacedMarker& marker,
                              const Disturbances& disturbances, const NoiseKey& key) const {
    for (const DisturbanceAxis& axis : disturbance_axes)
        if (const double value = disturbances.*axis.value; !axis.is_valid(value))
            refuse(axis, value);
    const CameraModel& camera = projector_.camera();
    if (radiance.type() != CV_32FC1 || radiance.size() != cv::Size(camera.width, camera.height))
        throw NumericalError(
            fmt::format("the camera of {} x {} px has float images of that size, "
                        "not {} x {}",
                        camera.width, camera.height, radiance.cols, radiance.rows));
    if (is_undisturbed(disturbances))
        return radiance;
    const Disturbances& d = disturbances;
    const DisturbanceDirections directions = disturbance_directions(key);
    Radiance result = radiance.clone();
    if (d.contrast != 1.0)
        fade(d.contrast, result);
    if (d.motion_px > 0.0)
        result = line_blurred(result, d.motion_px * directions.motion);
    if (d.occlusion > 0.0)
        hide(marker, d.occlusion, directions.card, result);
    if (d.exposure != 1.0 || d.uneven > 0.0)
        light(d.exposure, d.uneven, directions.fall, result);
    if (d.noise_dn > 0.0)
        add_noise(d.noise_dn, key, result);
    for (int y = 0; y < result.rows; ++y)
        if (!all_finite(result.ptr<float>(y), result.cols))
            throw NumericalError(
                fmt::format("a radiance in row {} of the disturbed image is not finite", y));
    return result;
}

CodeImage compressed(const CodeImage& image, double quality) {
    constexpr const DisturbanceAxis& axis = disturbance_axes.back();
    static_assert(axis.value == &Disturbances::jpeg_quality);
    if (!axis.is_valid(quality))
        refuse(axis, quality);
    if (quality == axis.neutral())
        return image;
    if (image.bits != 8 || image.pixels.type() != CV_8UC1 || image.pixels.empty())
        throw NumericalError(fmt::format("JPEG holds 8 bits, not an image of {} and {} x {} px",
                                         image.bits, image.pixels.cols, image.pixels.rows));
    const int whole = static_cast<int>(std::floor(quality + 0.5));
    return {decode_picture(encode_jpeg(image.pixels, whole)), image.bits};
}

Radiance line_blurred(const Radiance& radiance, const Eigen::Vector2d& motion_px) {
    if (radiance.empty() || motion_px.isZero(0.0))
        return radiance;
    cv::Mat differs;
    cv::compare(radiance, radiance.at<float>(0, 0), differs, cv::CMP_NE);
    const cv::Rect uneven = cv::boundingRect(differs);  // outside of it all pixels are equal
    Radiance result = radiance.clone();
    if (uneven.empty())
        return result;
    const std::vector<Tap> taps = line_taps(motion_px);
    const cv::Point reach = reach_of(motion_px);
    const cv::Rect part = grown(uneven, reach.x, reach.y) & cv::Rect({0, 0}, radiance.size());
    cv::Mat bordered;
    cv::copyMakeBorder(radiance, bordered, reach.y, reach.y, reach.x, reach.x,
                       cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    for (int y = part.y; y < part.br().y; ++y)
        for (const Tap& tap : taps)
            add_tap(tap, bordered.ptr<float>(y + reach.y) + part.x + reach.x,
                    static_cast<std::ptrdiff_t>(bordered.step1()), part.width,
                    result.ptr<float>(y) + part.x);
    return result;
}

}  // namespace etalon
