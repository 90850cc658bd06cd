#include "sim/marker/stag_pattern.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <bit>
#include <map>
#include <numbers>
#include <span>

#include "core/file/text.h"
#include "core/statistics/random.h"
#include "sim/marker/cell_grid.h"

namespace etalon {
namespace {

// The published tables of the small families. Source: the authors' code,
// github.com/bbenligiray/stag, src/MarkerIDs.h, upright words.
// clang-format off
constexpr std::array<StagCode, 157> hd17{
    0xff773271f358, 0x7dfdbd98a365, 0xddde6eece370, 0x96fcf6f6a6d2, 0x95bfd307b5f9, 0x478afbfcb5d3,
    0xdeadece7b163, 0xefa594abf3f4, 0x799aaacf76b7, 0xebbb589ed7c3, 0xeb3d72fd82ed, 0x3027f5d93bf3,
    0xa3c5b5fe23d9, 0x70b67daa758f, 0x7dbae991177a, 0x9bb2c35fd72a, 0xe6b3565e76b8, 0xebae664b327e,
    0xbea2f8edb2d8, 0x40bffaf6d64c, 0x09b7bebd7561, 0xa51bfbd6223f, 0x7236ea9dc5f3, 0x30d73b07637d,
    0xc3ce386fa6cc, 0xc381edec167e, 0x9b89751b37e1, 0x6aafb595b4c2, 0x53a4fd4fd413, 0x1ca22e98f6fb,
    0xec90e41d33df, 0xbd9c762994d6, 0xa595a8dbb0f3, 0x9cbc1a9f5794, 0x521d6dbb62d9, 0xef212b9a679a,
    0xcf366bcb811d, 0x77342f49e666, 0x7d10ffc3c1c3, 0xd20673e3a3e7, 0x991c217fe573, 0xeb349ba7e445,
    0x673fd1eb0652, 0xdf1c3687037b, 0xf02dae1ee64b, 0x1f3a8c5dc45f, 0xf41bf23b415d, 0xf61a8ae487dd,
    0x8a0fecfae0b6, 0x6d27547ca1d7, 0x8e2a925b67f3, 0xf722b8de4365, 0x44f3e94d6619, 0x28dec36744f1,
    0x82e1b86de12f, 0x3186e1f5d7c0, 0xc6992a6a717a, 0xaa944c7e5655, 0x1629479764f6, 0xbe2d7518c634,
    0xce1711b92575, 0x953b93f0e2c4, 0x9137e92f0297, 0x59047cd063fe, 0x230a261fe3ed, 0x911b54cec3b9,
    0xb41c3c5d05ed, 0x7f24c69f228c, 0xc53596d6849d, 0xb62642ace62f, 0x2a3a48f166ee, 0x9f3528b684ea,
    0x1d0f92f7450b, 0x3d11b8fcc19c, 0xdd01f6e94625, 0xc11ab4b3c676, 0xcc357c724783, 0x813cf889e7a5,
    0xfb1d1a51c493, 0x878224f33687, 0xcc96ca8eb421, 0x1f92e00392f5, 0x708bc05d9267, 0x96a7625a11c5,
    0x0e1f5f3420cc, 0xc207c1d546ad, 0xbc2b494c234e, 0x4c2a7d1b0267, 0xaa1bc7892385, 0x1615a74a2793,
    0x540ab70dc7d0, 0x261863fbc330, 0xf507233e8524, 0x463cbb3ba082, 0x0923b48e661f, 0x6236b44342dd,
    0x3e23286b243d, 0x652a12bd44bc, 0x9906c8bba349, 0x3415a635c2a7, 0x54069cfe86a2, 0x6e09a4be0473,
    0xfa0b9622c2e1, 0x353854b62715, 0xe72a76a04543, 0x2b3d2eb04354, 0xa12726e98791, 0x5b321e2a07d2,
    0x50291efb8545, 0xe825e2c26371, 0x023dd246c1e7, 0x182ef0cf0574, 0xcd3fb01441f0, 0x4b38a8d283b3,
    0xb93baa020567, 0x2c0678d5e613, 0xea027a1aa4d5, 0x7b1b70c2e206, 0xc41b2add42c3, 0xfd01188f8656,
    0x3986422d113d, 0xe31aed50a140, 0x280d093727a5, 0x0e26b3ec4281, 0x12147692e529, 0x8d112440a77d,
    0x2c37ec8904c8, 0xd0286825467d, 0x610ff86c0309, 0xb201c4f1a670, 0xad0e8c2d4264, 0xd228267c2316,
    0x6131642fc342, 0x06203ca583d7, 0xf83204b14197, 0x4333c2d82526, 0x12ae28047343, 0x24b928169550,
    0x80302dc664e1, 0x852ace4202c9, 0x483700eac02b, 0x8811d02e07cc, 0x4300a83845cf, 0x9312aeb900a0,
    0xa52880cc85e2, 0x732c92110760, 0x90219a98c332, 0x74171ad22050, 0x5c0f0808e295, 0x8b17025ea280,
    0xb30f108424c5, 0x2714588a4097, 0x1e0c4a528646, 0xa308705702d2, 0x9a1060cd8487, 0x0b0b4a87c051,
    0x32135a1d4604};

constexpr std::array<StagCode, 38> hd19{
    0x258f6a3bd3ed, 0x5f1ec15fe0f9, 0xf8cd61d825ed, 0xd8bee75c9443, 0xdf147f2906dc, 0x3f0bf71da382,
    0x7126f9ba22d7, 0xca0e6653e76e, 0x502972ff84fb, 0x8437747de751, 0xff2d26bb2151, 0x539569e36c51,
    0xc7c1f0c6a3d1, 0x7e90ecce314a, 0x2dba60967754, 0xe30fd2e5054d, 0xf21acce2a6e1, 0x5b2246fcc3c5,
    0xa83ca0cf67a3, 0x953ed09187e6, 0x493baad38335, 0x861f2a9e06d7, 0xfd0338cfc246, 0xfb1d1a51c493,
    0x5ca53a887385, 0x36370030e2bf, 0x6b2b2a2c6668, 0x1604fabac70a, 0xc116d6aec072, 0x650cacb4c4a7,
    0xe6309ad641e4, 0x7729900e0737, 0x042c936be2c4, 0xd4228e19644d, 0x1c1bb86c0199, 0x1814d6770625,
    0x322d3c7007c4, 0x61331cab4581};

constexpr std::array<StagCode, 12> hd21{
    0x8f687aed31cc, 0xdab69f4f3250, 0xc585203c55ed, 0x27103d7f029a, 0x212f7399650a, 0x7211f4e824a7,
    0xeb2826346317, 0x7c3e0c6605c3, 0x8e30a0d3e5e2, 0x1b33fa1503a1, 0xa4268acdc335, 0x5729900e8776};

constexpr std::array<StagCode, 6> hd23{
    0x9a45b4f437c4, 0x4d42deb35352, 0xe5f4344223db, 0x32f35e05474d, 0x80aefa69f2c8, 0x57a9902e965e};
// clang-format on

constexpr StagCode all_bits = (StagCode{1} << stag_bits) - 1;

// The smallest distance of two words over their orientations.
int distance_over_turns(StagCode a, StagCode b) {
    int smallest = stag_bits;
    for (int quarters = 0; quarters < 4; ++quarters)
        smallest = std::min(smallest, hamming_distance(a, turned_stag_code(b, quarters)));
    return smallest;
}

// To itself after a quarter and half a turn (three quarters are as far as one).
int distance_to_itself(StagCode code) {
    return std::min(hamming_distance(code, turned_stag_code(code, 1)),
                    hamming_distance(code, turned_stag_code(code, 2)));
}

// Random words in the generator's fixed order; each that is far enough from those before it stays.
std::vector<StagCode> rotation_safe_codes() {
    constexpr std::size_t count = 128;
    constexpr int distance = 16, min_black = 18, max_black = 30;
    constexpr std::uint64_t key = 16;
    std::vector<StagCode> codes;
    for (std::uint32_t n = 0; codes.size() < count; ++n) {
        const auto words = philox(key, {n, 0, 0, 0});
        const StagCode code = (StagCode{words[1]} << 32 | words[0]) & all_bits;
        const int black = std::popcount(code);
        if (black < min_black || black > max_black || distance_to_itself(code) < distance)
            continue;
        if (std::all_of(codes.begin(), codes.end(), [&](StagCode other) {
                return distance_over_turns(code, other) >= distance;
            }))
            codes.push_back(code);
    }
    return codes;
}

StagCode code_of_line(std::string_view line, const SourcePlace& place) {
    if (line.size() != stag_bits || line.find_first_not_of("01") != std::string_view::npos)
        throw ConfigError(place, fmt::format("a codeword is {} characters 0 or 1", stag_bits));
    StagCode code = 0;
    for (std::size_t i = 0; i < line.size(); ++i)
        if (line[i] == '1')
            code |= StagCode{1} << i;
    return code;
}

std::vector<StagCode> read_codes(const std::string& path) {
    std::vector<StagCode> codes;
    const std::vector<std::string> lines = split(read_text(path), '\n');
    for (std::size_t i = 0; i < lines.size(); ++i) {
        const std::string_view line = trimmed(lines[i]);
        if (!line.empty() && !line.starts_with('#'))
            codes.push_back(code_of_line(line, {path, static_cast<int>(i) + 1, {}}));
    }
    if (codes.empty())
        throw ConfigError({path, 0, {}}, "holds no codeword");
    return codes;
}

constexpr double code_radius = 0.35;
// Published in units of the code's diameter: of a disc, and of one that joins two of them.
constexpr double disc_radius = 0.062482177287080 * 2.0 * code_radius;
constexpr double joint_radius = 0.7 * disc_radius;
constexpr double joined_below = 4.0 * disc_radius;  // distance of the centres

struct PolarPoint {
    double radius;  // in code diameters
    double angle;   // from x to the marker's upper edge
};

// A quadrant is symmetric about its diagonal.
std::array<PolarPoint, stag_bits_a_quarter> first_quadrant() {
    constexpr double right = std::numbers::pi / 2.0;
    return {{{0.088363142525988, right / 2.0},
             {0.206935928182607, 0.459275804122858},
             {0.206935928182607, right - 0.459275804122858},
             {0.313672146827381, 0.200579720495241},
             {0.327493143484516, 0.591687617505840},
             {0.327493143484516, right - 0.591687617505840},
             {0.313672146827381, right - 0.200579720495241},
             {0.437421957035861, 0.145724938287167},
             {0.437226762361658, 0.433363129825345},
             {0.430628029742607, right / 2.0},
             {0.437226762361658, right - 0.433363129825345},
             {0.437421957035861, right - 0.145724938287167}}};
}

std::array<Eigen::Vector2d, stag_bits> all_quadrants() {
    std::array<Eigen::Vector2d, stag_bits> points;
    std::size_t i = 0;
    for (int quarter = 0; quarter < 4; ++quarter)
        for (const PolarPoint& point : first_quadrant()) {
            const double angle = point.angle + quarter * std::numbers::pi / 2.0;
            points[i++] = 2.0 * code_radius * point.radius *
                          Eigen::Vector2d(std::cos(angle), -std::sin(angle));
        }
    return points;
}

// A disc given in sides of the marker, from its centre.
void draw_disc(cv::Mat& cells, const Eigen::Vector2d& centre, double radius, float radiance) {
    constexpr double cell = 1.0 / stag_cells_a_side;
    const Eigen::Vector2d middle = centre / cell + Eigen::Vector2d::Constant(cells.cols / 2.0);
    fill_disc(cells, middle, Eigen::Vector2d::Constant(radius / cell), radiance);
}

bool is_black(StagCode code, std::size_t point) {
    return (code >> point & 1) != 0;
}

void draw_code_discs(cv::Mat& cells, StagCode code) {
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < points.size(); ++i)
        draw_disc(cells, points[i], disc_radius, is_black(code, i) ? black : white);
}

void join_black_discs(cv::Mat& cells, StagCode code) {
    const auto& points = stag_code_points();
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            if (is_black(code, i) && is_black(code, j) &&
                (points[i] - points[j]).norm() < joined_below)
                draw_disc(cells, (points[i] + points[j]) / 2.0, joint_radius, black);
}

// Every cell takes the colour of most of those around it, which removes slivers between discs.
void round_off(cv::Mat& cells) {
    constexpr int reach = 5, passes = 5;  // 12 of 800 pixels a side in the generator
    cv::Mat kernel(2 * reach + 1, 2 * reach + 1, CV_32FC1);
    for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x)
            kernel.at<float>(reach + y, reach + x) = x * x + y * y <= reach * reach ? 1.0f : 0.0f;
    const double half = cv::sum(kernel)[0] / 2.0;
    for (int pass = 0; pass < passes; ++pass) {
        cv::Mat whites;
        cv::filter2D(cells, whites, CV_32F, kernel);
        cv::threshold(whites, cells, half, white, cv::THRESH_BINARY);
    }
}

// The code on white, as large as the disk; it does not reach the disk's edge.
cv::Mat code_cells(StagCode code) {
    constexpr int side = static_cast<int>(2.0 * stag_circle_radius * stag_cells_a_side);
    cv::Mat cells(side, side, CV_32FC1, cv::Scalar::all(white));
    draw_code_discs(cells, code);
    join_black_discs(cells, code);
    draw_code_discs(cells, code);
    round_off(cells);
    draw_code_discs(cells, code);
    return cells;
}

}  // namespace

const std::vector<std::string>& stag_families() {
    static const std::vector<std::string> names{"HD17", "HD19", "HD21", "HD23", "R16"};
    return names;
}

bool is_stag_file(const std::string& family) {
    return family.find_first_of("./") != std::string::npos;
}

std::vector<StagCode> stag_codes(const std::string& family) {
    if (is_stag_file(family))
        return read_codes(family);
    if (family == "R16") {
        static const std::vector<StagCode> r16 = rotation_safe_codes();
        return r16;
    }
    static const std::map<std::string, std::span<const StagCode>> published = {
        {"HD17", hd17}, {"HD19", hd19}, {"HD21", hd21}, {"HD23", hd23}};
    const auto found = published.find(family);
    if (found == published.end())
        throw ConfigError({}, "no STag family '" + family + "'");
    return {found->second.begin(), found->second.end()};
}

StagCode turned_stag_code(StagCode code, int quarters) {
    const int shift = ((quarters % 4 + 4) % 4) * stag_bits_a_quarter;
    return (code << shift | code >> (stag_bits - shift)) & all_bits;
}

int hamming_distance(StagCode a, StagCode b) {
    return std::popcount(a ^ b);
}

int stag_separation(const std::vector<StagCode>& codes, int id) {
    const StagCode own = codes.at(static_cast<std::size_t>(id));
    int smallest = distance_to_itself(own);
    for (std::size_t other = 0; other < codes.size(); ++other)
        if (other != static_cast<std::size_t>(id))
            smallest = std::min(smallest, distance_over_turns(own, codes[other]));
    return smallest;
}

const std::array<Eigen::Vector2d, stag_bits>& stag_code_points() {
    static const std::array<Eigen::Vector2d, stag_bits> points = all_quadrants();
    return points;
}

cv::Mat stag_cells(StagCode code) {
    constexpr int border = stag_cells_a_side / 8, whole = stag_cells_a_side + 2 * border;
    static_assert(border == stag_border * stag_cells_a_side);
    cv::Mat cells(whole, whole, CV_32FC1, cv::Scalar::all(white));
    cells(cv::Rect(border, border, stag_cells_a_side, stag_cells_a_side))
        .setTo(cv::Scalar::all(black));
    draw_disc(cells, Eigen::Vector2d::Zero(), stag_circle_radius, white);
    const cv::Mat inside = code_cells(code);
    const int corner = (whole - inside.cols) / 2;
    cv::Mat middle = cells(cv::Rect(corner, corner, inside.cols, inside.rows));
    cv::min(inside, middle, middle);
    return cells;
}

}  // namespace etalon
