#include "compare/detect/topotag/topotag_detector.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "compare/detect/detector_adaptors.h"
#include "sim/marker/topotag_pattern.h"

namespace etalon {
namespace {

struct Labelled {
    cv::Mat labels, statistics, centroids;
    std::vector<int> region;  // by label, -1: not met yet

    Labelled(const cv::Mat& pixels, int neighbours)
        : region(static_cast<std::size_t>(cv::connectedComponentsWithStats(
                     pixels, labels, statistics, centroids, neighbours)),
                 -1) {}
};

}  // namespace

std::vector<Region> region_tree(const cv::Mat& dark) {
    cv::Mat framed;  // what is outside is white
    cv::copyMakeBorder(dark, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar(0));
    Labelled white(framed == 0, 8), black(framed, 4);
    // The outermost one is what the others leave of the image.
    const double all = static_cast<double>(dark.total());
    std::vector<Region> regions{
        {-1, false, all, 0.5 * all * Eigen::Vector2d(dark.cols - 1, dark.rows - 1)}};
    white.region[static_cast<std::size_t>(white.labels.at<int>(0, 0))] = 0;
    for (int y = 1; y <= dark.rows; ++y)
        for (int x = 1; x <= dark.cols; ++x) {
            const bool is_dark = framed.at<uchar>(y, x) != 0;
            Labelled &own = is_dark ? black : white, &other = is_dark ? white : black;
            const int label = own.labels.at<int>(y, x);
            int& region = own.region[static_cast<std::size_t>(label)];
            if (region >= 0)
                continue;
            // To the left of a region's first pixel is the region around it.
            const int parent =
                other.region[static_cast<std::size_t>(other.labels.at<int>(y, x - 1))];
            region = static_cast<int>(regions.size());
            const double area = own.statistics.at<int>(label, cv::CC_STAT_AREA);
            const Eigen::Array2d centroid(own.centroids.ptr<double>(label));
            const Eigen::Vector2d sum = (centroid * area).round() - area;  // without the frame
            regions.front().area -= area;
            regions.front().sum -= sum;
            regions[static_cast<std::size_t>(parent)].children.push_back(region);
            regions.push_back({parent, is_dark, area, sum});
        }
    return regions;
}

namespace {

using Points = std::vector<Eigen::Vector2d>;

// A node or a dot of the scaled image.
struct Blob {
    double area = 0.0;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    std::vector<Eigen::Vector2d> dots;

    Eigen::Vector2d centroid() const { return sum / area; }
};

// A black region, filled, with the dots in it. Smaller holes are specks.
Blob node_of(const std::vector<Region>& tree, const Region& region) {
    constexpr double min_share = 0.02;  // of a node's area; a dot has 1/9 of it without blur
    Blob node{region.area, region.sum, {}};
    for (const int hole : region.children) {
        node.area += tree[hole].area;
        node.sum += tree[hole].sum;
    }
    for (const int hole : region.children)
        if (tree[hole].area > min_share * node.area)
            node.dots.push_back(tree[hole].sum / tree[hole].area);
    return node;
}

struct Candidate {
    std::vector<Eigen::Vector2d> nodes;  // without the baseline
    std::array<Eigen::Vector2d, 2> baseline;
};

// The nodes of a white region when there are as many as a tag of this order has.
std::optional<Candidate> candidate_in(const std::vector<Region>& tree, const Region& region,
                                      int order) {
    constexpr double min_area = 5.0, speck = 0.25, max_unlike = 8.0;
    const auto count = static_cast<std::size_t>(order * order - 1);
    if (region.children.size() < count)
        return std::nullopt;
    std::vector<Blob> nodes;
    for (const int child : region.children)
        if (tree[child].area >= min_area)
            nodes.push_back(node_of(tree, tree[child]));
    if (nodes.size() < count)
        return std::nullopt;
    std::ranges::sort(nodes, std::greater(), &Blob::area);
    if ((nodes.size() > count && nodes[count].area > speck * nodes[count - 1].area) ||
        nodes[0].area > max_unlike * nodes[count - 1].area)
        return std::nullopt;
    Candidate candidate;
    int baselines = 0;
    for (std::size_t i = 0; i < count; ++i) {
        if (nodes[i].dots.size() > 2)
            return std::nullopt;
        if (nodes[i].dots.size() == 2) {
            candidate.baseline = {nodes[i].dots[0], nodes[i].dots[1]};
            ++baselines;
        } else {
            candidate.nodes.push_back(nodes[i].centroid());
        }
    }
    return baselines == 1 ? std::optional(candidate) : std::nullopt;
}

// The corners of the convex hull, clockwise as seen (y is down).
Points hull_of(const Points& points) {
    std::vector<cv::Point2f> all;
    for (const Eigen::Vector2d& point : points)
        all.emplace_back(static_cast<float>(point.x()), static_cast<float>(point.y()));
    std::vector<int> indices;
    cv::convexHull(all, indices, false, false);
    Points result;
    for (const int i : indices)
        result.push_back(points[static_cast<std::size_t>(i)]);
    double area = 0.0;
    for (std::size_t i = 0; i < result.size(); ++i)
        area += cross(result[i], result[(i + 1) % result.size()]);
    if (area < 0.0)
        std::reverse(result.begin(), result.end());
    return result;
}

std::optional<std::array<Eigen::Vector2d, 4>> largest_quadrangle(const Points& hull) {
    double largest = 0.0;
    std::optional<std::array<Eigen::Vector2d, 4>> result;
    const std::size_t n = hull.size();
    for (std::size_t a = 0; a < n; ++a)
        for (std::size_t c = a + 2; c < n; ++c)
            for (std::size_t b = a + 1; b < c; ++b)
                for (std::size_t d = c + 1; d < n; ++d) {
                    const double area = std::abs(cross(hull[c] - hull[a], hull[d] - hull[b]));
                    if (area > largest) {
                        largest = area;
                        result = {hull[a], hull[b], hull[c], hull[d]};
                    }
                }
    return result;
}

// The point nearest to a place, taken out; nothing when none is near.
std::optional<Eigen::Vector2d> take_nearest(Points& points, const Eigen::Vector2d& place,
                                            double reach) {
    const auto nearest = std::ranges::min_element(
        points, {}, [&](const Eigen::Vector2d& point) { return (point - place).squaredNorm(); });
    if (nearest == points.end() || !((*nearest - place).norm() < reach))
        return std::nullopt;
    const Eigen::Vector2d result = *nearest;
    points.erase(nearest);
    return result;
}

// How far a vertex may be from where the others say, in distances to its nearest neighbour.
constexpr double loose_fit = 0.35, close_fit = 0.2;

double nearest_distance(const Points& points, std::size_t i) {
    double nearest = std::numeric_limits<double>::max();
    for (std::size_t j = 0; j < points.size(); ++j)
        if (j != i)
            nearest = std::min(nearest, (points[i] - points[j]).norm());
    return nearest;
}

// The vertices in their order; nothing when the points are not those of a tag.
std::optional<Points> in_order(const Candidate& candidate, int order) {
    Points all = candidate.nodes;
    all.insert(all.end(), candidate.baseline.begin(), candidate.baseline.end());
    auto corners = largest_quadrangle(hull_of(all));
    if (!corners)
        return std::nullopt;
    const auto first = std::find_first_of(corners->begin(), corners->end(),
                                          candidate.baseline.begin(), candidate.baseline.end());
    if (first == corners->end())
        return std::nullopt;
    std::rotate(corners->begin(), first, corners->end());
    const Points cells = topotag_vertices(order);
    const auto n = static_cast<std::size_t>(order);
    const auto h = homography({cells[0], cells[n - 1], cells[n * n - 1], cells[n * (n - 1)]},
                              {corners->begin(), corners->end()});
    if (!h)
        return std::nullopt;
    Points expected, vertices;
    for (const Eigen::Vector2d& cell : cells)
        expected.push_back(seen_at(*h, cell));
    Points dots(candidate.baseline.begin(), candidate.baseline.end()), nodes = candidate.nodes;
    for (std::size_t i = 0; i < expected.size(); ++i) {
        const auto vertex = take_nearest(i < 2 ? dots : nodes, expected[i],
                                         loose_fit * nearest_distance(expected, i));
        if (!vertex)
            return std::nullopt;
        vertices.push_back(*vertex);
    }
    return vertices;
}

bool fits_a_plane(const Points& vertices, int order) {
    const Points cells = topotag_vertices(order);
    const auto h = homography(cells, vertices);
    if (!h)
        return false;
    for (std::size_t i = 0; i < cells.size(); ++i)
        if (!((seen_at(*h, cells[i]) - vertices[i]).norm() <
              close_fit * nearest_distance(vertices, i)))
            return false;
    return true;
}

// What is known from another scale is not fitted again.
bool is_known(const std::vector<DetectedCorners>& tags, const Points& vertices) {
    const double reach = 0.5 * (vertices.front() - vertices.back()).norm();
    return std::ranges::any_of(tags, [&](const DetectedCorners& tag) {
        return (tag.pixels.front() - vertices.front()).norm() < reach &&
               (tag.pixels.back() - vertices.back()).norm() < reach;
    });
}

// Vertices of all that may be a tag, in px of the image before it was scaled.
std::vector<Points> candidates_at(const cv::Mat& scaled, double scale, int order) {
    // Black is what is darker than the square around it, by more than noise in an even area.
    constexpr int side = 15, less = 4;
    cv::Mat mean;
    cv::boxFilter(scaled, mean, CV_8U, {side, side}, {-1, -1}, true, cv::BORDER_REPLICATE);
    cv::subtract(mean, cv::Scalar::all(less), mean);
    const std::vector<Region> tree = region_tree(scaled < mean);
    std::vector<Points> found;
    for (const Region& region : tree) {
        if (region.is_dark)
            continue;
        const auto candidate = candidate_in(tree, region, order);
        auto vertices = candidate ? in_order(*candidate, order) : std::nullopt;
        if (!vertices || !fits_a_plane(*vertices, order))
            continue;
        for (Eigen::Vector2d& vertex : *vertices)  // pixel centres at integers in both
            vertex = ((vertex.array() + 0.5) / scale - 0.5).matrix();
        found.push_back(*vertices);
    }
    return found;
}

}  // namespace

std::vector<DetectedCorners> find_topotags(const cv::Mat& eight_bit, const cv::Mat& pixels,
                                           const std::string& family) {
    constexpr int min_side = 20;  // px, of an image that may hold a tag
    const int order = topotag_order(family);
    std::vector<DetectedCorners> tags;
    if (eight_bit.empty())
        return tags;
    cv::Mat scaled;
    cv::resize(eight_bit, scaled, {}, 2.0, 2.0, cv::INTER_LINEAR);
    for (double scale = 2.0; std::min(scaled.cols, scaled.rows) >= min_side; scale /= 2.0) {
        for (const Points& vertices : candidates_at(scaled, scale, order)) {
            if (is_known(tags, vertices))
                continue;
            const auto fit = fit_topotag(pixels, family, vertices);
            if (fit && fits_a_plane(fit->vertices, order) && !is_known(tags, fit->vertices))
                tags.push_back({fit->id, fit->vertices});
        }
        if (scale == 2.0) {
            scaled = eight_bit;
            continue;
        }
        // Of whole blocks of 2 x 2, so that places scale exactly.
        const cv::Size half(scaled.cols / 2, scaled.rows / 2);
        const cv::Mat even = scaled(cv::Rect({0, 0}, half * 2));
        scaled = cv::Mat();  // a picture of its own
        cv::resize(even, scaled, half, 0, 0, cv::INTER_AREA);
    }
    return tags;
}

std::unique_ptr<Detector> make_topotag_detector(const Marker& marker) {
    return std::make_unique<Detector>(
        "topotag", [id = marker.id, family = marker.family](const CodeImage& image) {
            return only_one(id, find_topotags(as_8_bit(image), as_float(image), family));
        });
}

}  // namespace etalon
