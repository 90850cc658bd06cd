// What displaces the edges of the two sets of real photographs (docs/validation.md): noise, JPEG,
// the camera or the board. A displacement that repeats at a place in the image is the camera's; one
// that repeats at an edge of the board is the board's. The test of the latter: a map of the board
// made from one camera's photographs, applied to those of the other, which it has not seen.
//
// Usage: edge_causes FOLDER, with left01.jpg .. right14.jpg.

#include <map>
#include <opencv2/imgcodecs.hpp>

#include "compare/edges/edge_summary.h"
#include "compare/photometric/photo_match.h"
#include "core/statistics/distributions.h"
#include "tests/compare/board_photos.h"

namespace {

using namespace etalon;

constexpr double square_mm = 25.0;

const Marker& board() {
    static const Marker marker = parse_marker("chessboard:9x6@25mm", "board");
    return marker;
}

// An edge in one photograph, and which of the board's edges it is.
struct BoardEdge {
    int photo;
    std::array<int, 3> name;  // across which axis, which grid line, which square along it
    EdgeShift seen;
    double px_per_mm;         // along the normal, for a displacement across the line in the plane
    double px_per_height_mm;  // the same for one off the plane
};

BoardEdge on_board(int photo, const EdgeShift& edge, const Projector& projector,
                   const Rigid& camera_from_board) {
    const Eigen::Vector3d ray = projector.unproject(edge.middle_px).value().homogeneous();
    const Eigen::Vector3d normal = camera_from_board.rotation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d point =
        camera_from_board.inverse() *
        (ray * (normal.dot(camera_from_board.translation) / normal.dot(ray)));
    const auto from_line = [&](int axis) {
        return std::abs(std::remainder(point[axis], square_mm));
    };
    const int axis = from_line(0) < from_line(1) ? 0 : 1;
    const auto moved = [&](const Eigen::Vector3d& by) {
        return (*projector.project(camera_from_board * Eigen::Vector3d(point + by)) -
                edge.middle_px)
            .dot(edge.normal);
    };
    return {photo,
            {axis, static_cast<int>(std::lround(point[axis] / square_mm)),
             static_cast<int>(std::floor(point[1 - axis] / square_mm))},
            edge,
            moved(Eigen::Vector3d::Unit(axis)),
            moved(Eigen::Vector3d::UnitZ())};
}

struct Set {
    std::vector<BoardEdge> calibrated, refined;
    double jpeg_squares = 0.0;  // sum over photographs of the squared shift that JPEG alone makes
    int photos = 0;
};

std::vector<EdgeShift> edges_in(const cv::Mat& gray, const PhotometricCamera& camera,
                                const PhotoFit& fit) {
    std::vector<EdgeShift> edges =
        edge_shifts({gray, board().grid, fit.use, pixel_fitted}, camera, fit.state);
    std::erase_if(edges, [](const EdgeShift& edge) { return edge.is_beyond_range; });
    return edges;
}

// The prediction in place of the photograph, compressed as the photographs are.
double squared_shift_by_jpeg(const CodeImage& photo, const PhotometricCamera& camera,
                             const PhotoFit& fit) {
    constexpr int quality = 50;
    cv::Mat gray = gray_of(photo), codes;
    fit.predicted.copyTo(gray, fit.use > 0);
    gray.convertTo(codes, CV_8U);
    std::vector<uchar> file;
    cv::imencode(".jpg", codes, file, {cv::IMWRITE_JPEG_QUALITY, quality});
    cv::imdecode(file, cv::IMREAD_GRAYSCALE).convertTo(gray, CV_32F);
    const double rms = edge_summary(edges_in(gray, camera, fit)).shift.with_noise_px;
    return rms * rms;
}

Set measured(const std::filesystem::path& folder, const std::string& side) {
    const auto [marker, names, photos, views, fit] = test::BoardPhotos(side, folder);
    const auto camera = std::make_shared<const PhotometricCamera>(fit.camera);
    const ComparedArea area = compared_area(board(), {}, "board");
    Set set;
    for (std::size_t i = 0; i < photos.size(); ++i) {
        const PhotoMatch match =
            match_photo(photos[i], board().grid, area, camera, fit.camera_from_target[i]);
        for (const bool refined : {false, true}) {
            const PhotoFit& at = refined ? match.refined : match.calibrated;
            for (const EdgeShift& edge : edges_in(gray_of(photos[i]), *camera, at))
                (refined ? set.refined : set.calibrated)
                    .push_back(on_board(static_cast<int>(i), edge, camera->projector(),
                                        at.state.camera_from_marker));
        }
        set.jpeg_squares += squared_shift_by_jpeg(photos[i], *camera, match.refined);
        ++set.photos;
    }
    return set;
}

// Mean over pairs of edges that `alike` brings together, in different photographs, of the product
// of their shifts with the sign that `alike` gives: the part that both have in common, squared.
template <class Alike>
double in_common_px(const std::vector<BoardEdge>& edges, Alike alike) {
    double sum = 0.0;
    long pairs = 0;
    for (std::size_t a = 0; a < edges.size(); ++a)
        for (std::size_t b = a + 1; b < edges.size(); ++b) {
            const double sign = edges[a].photo == edges[b].photo ? 0.0 : alike(edges[a], edges[b]);
            if (sign == 0.0)
                continue;
            sum += sign * edges[a].seen.shift_px * edges[b].seen.shift_px;
            ++pairs;
        }
    const double mean = sum / static_cast<double>(std::max(pairs, 1L));
    return std::copysign(std::sqrt(std::abs(mean)), mean);
}

double same_board_edge(const BoardEdge& a, const BoardEdge& b) {
    return a.name != b.name ? 0.0 : std::copysign(1.0, a.px_per_mm * b.px_per_mm);
}

double same_place_in_image(const BoardEdge& a, const BoardEdge& b) {
    constexpr double near_px = 20.0, parallel = 0.8;
    if (a.name == b.name || (a.seen.middle_px - b.seen.middle_px).norm() > near_px)
        return 0.0;
    const double cosine = a.seen.normal.dot(b.seen.normal);
    return std::abs(cosine) < parallel ? 0.0 : std::copysign(1.0, cosine);
}

double rms_px(const std::vector<BoardEdge>& edges) {
    double squares = 0.0;
    for (const BoardEdge& edge : edges)
        squares += edge.seen.shift_px * edge.seen.shift_px;
    return std::sqrt(squares / static_cast<double>(edges.size()));
}

// Median: a few edges are hardly determined.
double stated_px(const std::vector<BoardEdge>& edges) {
    std::vector<double> deviations;
    for (const BoardEdge& edge : edges)
        deviations.push_back(edge.seen.shift_deviation_px);
    return median(std::move(deviations));
}

double mean_px(const std::vector<BoardEdge>& edges) {
    double sum = 0.0;
    for (const BoardEdge& edge : edges)
        sum += edge.seen.shift_px;
    return sum / static_cast<double>(edges.size());
}

// What the board's edges are off by, mm: across their line in the plane, and in height.
using BoardMap = std::map<std::array<int, 3>, Eigen::Vector2d>;

Eigen::Vector2d sensitivity(const BoardEdge& edge, bool with_height) {
    return {edge.px_per_mm, with_height ? edge.px_per_height_mm : 0.0};
}

// Weighted least squares by edge; both unknowns are held near 0 (to 10 mm): some edges are seen
// from one side only. Besides its own deviation a shift has 0.1 px that are not the board's.
BoardMap map_from(const std::vector<BoardEdge>& edges, bool with_height) {
    struct Normal {
        Eigen::Matrix2d information = 0.01 * Eigen::Matrix2d::Identity();
        Eigen::Vector2d right = Eigen::Vector2d::Zero();
    };
    std::map<std::array<int, 3>, Normal> normals;
    for (const BoardEdge& edge : edges) {
        const double deviation = edge.seen.shift_deviation_px;
        const double weight = 1.0 / (deviation * deviation + 0.01);
        const Eigen::Vector2d row = sensitivity(edge, with_height);
        Normal& normal = normals[edge.name];
        normal.information += weight * row * row.transpose();
        normal.right += weight * edge.seen.shift_px * row;
    }
    BoardMap map;
    for (const auto& [name, normal] : normals)
        map[name] = normal.information.ldlt().solve(normal.right);
    return map;
}

std::vector<BoardEdge> without_board(std::vector<BoardEdge> edges, const BoardMap& map,
                                     bool with_height) {
    std::erase_if(edges, [&](const BoardEdge& edge) { return !map.contains(edge.name); });
    for (BoardEdge& edge : edges)
        edge.seen.shift_px -= sensitivity(edge, with_height).dot(map.at(edge.name));
    return edges;
}

void print(const std::string& side, const Set& set) {
    fmt::print("{}: {} photographs, {} edges\n", side, set.photos, set.calibrated.size());
    fmt::print("  edge shift RMS, calibrated poses   {:.3f} px\n", rms_px(set.calibrated));
    fmt::print("  edge shift RMS, photometric poses  {:.3f}\n", rms_px(set.refined));
    fmt::print("  stated by the edges' fits          {:.3f}\n", stated_px(set.refined));
    fmt::print("  JPEG alone                         {:.3f}\n",
               std::sqrt(set.jpeg_squares / set.photos));
    fmt::print("  mean, from dark to light           {:+.3f}\n", mean_px(set.refined));
    fmt::print("  common to a place in the image     {:.3f}\n",
               in_common_px(set.refined, same_place_in_image));
    fmt::print("  common to an edge of the board     {:.3f}\n",
               in_common_px(set.refined, same_board_edge));
}

void print_map(const std::string& from, const Set& seen, const std::string& to, const Set& unseen) {
    const auto after = [&](bool with_height) {
        const BoardMap map = map_from(seen.calibrated, with_height);
        return rms_px(without_board(unseen.calibrated, map, with_height));
    };
    fmt::print(
        "map of the {} camera, {} photographs: {:.3f} px, in the plane {:.3f}, with height "
        "{:.3f}\n",
        from, to, rms_px(unseen.calibrated), after(false), after(true));
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        fmt::print(stderr, "usage: edge_causes FOLDER\n");
        return 3;
    }
    const Set left = measured(argv[1], "left"), right = measured(argv[1], "right");
    print("left", left);
    print("right", right);
    print_map("left", left, "right", right);
    print_map("right", right, "left", left);
    return 0;
}
