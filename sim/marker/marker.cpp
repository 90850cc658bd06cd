#include "sim/marker/marker.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "core/file/text.h"
#include "core/image/image.h"
#include "sim/marker/board_pattern.h"
#include "sim/marker/stag_pattern.h"
#include "sim/marker/tag_pattern.h"
#include "sim/marker/topotag_pattern.h"

namespace etalon {
namespace {

constexpr double max_size_mm = 1e6;  // a kilometre: anything above is a slip of the unit
constexpr int max_board_side = 500;  // corners, tags or circles

// The name in its parts: "apriltag:36h11:5@50mm" is kind "apriltag", what "36h11:5", size "50".
struct Spec {
    std::string whole, place;
    std::string kind, what, size;

    [[noreturn]] void fail(const std::string& message) const {
        throw ConfigError({place, 0, whole}, message);
    }
};

constexpr const char* form =
    "a marker is named KIND:WHAT@SIZEmm, for instance apriltag:36h11:5@50mm";

Spec take_apart(const std::string& text, const std::string& place) {
    Spec spec{text, place, {}, {}, {}};
    const auto colon = text.find(':');
    const auto at = text.rfind('@');  // a bitmap's path may hold one, too
    if (colon == std::string::npos || at == std::string::npos || at < colon)
        spec.fail(fmt::format("{}; the kinds are {}", form, fmt::join(marker_kinds(), ", ")));
    spec.kind = text.substr(0, colon);
    spec.what = text.substr(colon + 1, at - colon - 1);
    spec.size = text.substr(at + 1);
    if (!spec.size.ends_with("mm"))
        spec.fail("the size '" + spec.size + "' must end in mm");
    spec.size.resize(spec.size.size() - 2);
    return spec;
}

double length_mm(const Spec& spec, std::string_view text) {
    const auto length = parse_number(text);
    if (!length || *length <= 0.0 || *length > max_size_mm)
        spec.fail(fmt::format("'{}' is not a length above 0 and up to {} mm", text, max_size_mm));
    return *length;
}

// "9x6" as two numbers of whatever `parse` makes of each part.
template <class Parse>
auto pair_of(const Spec& spec, const std::string& text, Parse parse) {
    const std::vector<std::string> parts = split(text, 'x');
    if (parts.size() != 2)
        spec.fail("'" + text + "' is not of the form AxB");
    return std::pair{parse(parts[0]), parse(parts[1])};
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& candidates) {
    const auto ends_so = std::ranges::find_if(candidates, [&](const std::string& candidate) {
        return word.size() > 2 && candidate.ends_with(word);  // "41h12": Standard41h12
    });
    const std::string nearest =
        ends_so != candidates.end() ? *ends_so : nearest_word(word, candidates);
    return nearest.empty() ? std::string() : "; did you mean '" + nearest + "'?";
}

void check_family(const Spec& spec, const char* title, const std::string& family,
                  const std::vector<std::string>& families) {
    if (std::find(families.begin(), families.end(), family) == families.end())
        spec.fail(fmt::format("unknown {} '{}'{}", title, family, did_you_mean(family, families)));
}

int checked_id(const Spec& spec, const std::string& text, int count, const std::string& family) {
    const auto id = parse_integer(text);
    if (!id || *id < 0 || *id >= count)
        spec.fail(
            fmt::format("'{}' is not an id of {}: those are 0 to {}", text, family, count - 1));
    return static_cast<int>(*id);
}

// "36h11:5": the family, and what is behind it.
std::string read_family(const Spec& spec, const char* title, Marker& marker,
                        const std::vector<std::string>& families, const char* form) {
    const std::vector<std::string> parts = split(spec.what, ':');
    if (parts.size() != 2)
        spec.fail(fmt::format("expected {}:FAMILY:{}", spec.kind, form));
    marker.family = parts[0];
    check_family(spec, title, marker.family, families);
    return parts[1];
}

void read_family_and_id(const Spec& spec, const char* title, Marker& marker,
                        const std::vector<std::string>& families,
                        int (*count)(const std::string&)) {
    const std::string id = read_family(spec, title, marker, families, "ID@SIZEmm");
    marker.id = checked_id(spec, id, count(marker.family), marker.family);
}

// A square of the marker's size with a border around it; the points are its corners, from the top
// left clockwise.
void lay_out_square(const cv::Mat& cells, double cell, double border, Marker& marker) {
    const double half = marker.size_mm / 2.0, corner = -half - border;
    marker.grid = {cells, {corner, corner}, {cell, cell}};
    marker.points_mm = {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}};
}

void lay_out_tag(const Spec& spec, const TagPattern& pattern, Marker& marker) {
    cv::Mat turned;
    cv::flip(pattern.cells, turned, -1);
    if (cv::countNonZero(turned != pattern.cells) == 0)
        spec.fail(fmt::format("id {} looks the same after half a turn: its corners have no order",
                              marker.id));
    marker.size_mm = length_mm(spec, spec.size);
    const double cell = marker.size_mm / pattern.reference_cells;
    lay_out_square(pattern.cells, cell, pattern.reference_start * cell, marker);
}

void parse_apriltag(const Spec& spec, Marker& marker) {
    read_family_and_id(spec, "AprilTag family", marker, apriltag_families(), apriltag_count);
    lay_out_tag(spec, apriltag_pattern(marker.family, marker.id), marker);
}

void parse_aruco(const Spec& spec, Marker& marker) {
    read_family_and_id(spec, "ArUco dictionary", marker, aruco_dictionaries(), aruco_count);
    lay_out_tag(spec, aruco_pattern(marker.family, marker.id), marker);
}

void parse_stag(const Spec& spec, Marker& marker) {
    const auto colon = spec.what.rfind(':');
    if (colon == std::string::npos)
        spec.fail("expected stag:FAMILY:ID@SIZEmm");
    marker.family = spec.what.substr(0, colon);
    if (!is_stag_file(marker.family))
        check_family(spec, "STag family", marker.family, stag_families());
    const std::vector<StagCode> codes = stag_codes(marker.family);
    marker.id = checked_id(spec, spec.what.substr(colon + 1), static_cast<int>(codes.size()),
                           marker.family);
    if (stag_separation(codes, marker.id) == 0)
        spec.fail(
            fmt::format("id {} looks like another one or like itself after a turn", marker.id));
    marker.size_mm = length_mm(spec, spec.size);
    lay_out_square(stag_cells(codes[static_cast<std::size_t>(marker.id)]),
                   marker.size_mm / stag_cells_a_side, stag_border * marker.size_mm, marker);
    marker.detail_mm = stag_detail * marker.size_mm;
}

void parse_topotag(const Spec& spec, Marker& marker) {
    read_family_and_id(spec, "TopoTag family", marker, topotag_families(), topotag_count);
    marker.size_mm = length_mm(spec, spec.size);
    const TopotagPattern pattern = topotag_pattern(marker.family, marker.id);
    const int order = topotag_order(marker.family);
    const double cell = marker.size_mm / topotag_white_side(order);
    const double side = cell / pattern.pixels_per_cell;
    const double corner = -pattern.pixels.cols * side / 2.0;
    marker.grid = {pattern.pixels, {corner, corner}, {side, side}};
    for (const Eigen::Vector2d& vertex : topotag_vertices(order))
        marker.points_mm.emplace_back(vertex.x() * cell, vertex.y() * cell, 0.0);
    if (pattern.pixels_per_cell > 1)
        marker.detail_mm = cell / 10.0;  // what makes a dot round
}

// "9x6" of a board, each at least `least`.
void read_counts(const Spec& spec, const std::string& text, const char* what, int least,
                 Marker& marker) {
    std::tie(marker.columns, marker.rows) = pair_of(spec, text, [&](const std::string& part) {
        const auto number = parse_integer(part);
        if (!number || *number < least || *number > max_board_side)
            spec.fail(fmt::format("'{}' is not a number of {}: {} to {}", part, what, least,
                                  max_board_side));
        return static_cast<int>(*number);
    });
}

// "30mm/22mm", the last mm already gone.
void read_two_lengths(const Spec& spec, const char* what, Marker& marker) {
    const std::vector<std::string> parts = split(spec.size, '/');
    if (parts.size() != 2 || !parts[0].ends_with("mm"))
        spec.fail(fmt::format("the size must be two lengths, {}: for instance 20mm/12mm", what));
    marker.size_mm = length_mm(spec, std::string_view(parts[0]).substr(0, parts[0].size() - 2));
    marker.part_mm = length_mm(spec, parts[1]);
}

void require_ids(const Spec& spec, int needed, int available) {
    if (needed > available)
        spec.fail(fmt::format("{} tags are needed, but there are {}", needed, available));
}

void lay_out_board(BoardPattern board, Marker& marker) {
    marker.grid = board.grid;
    marker.points_mm = std::move(board.points_mm);
    marker.detail_mm = board.detail_mm;
}

void parse_chessboard(const Spec& spec, Marker& marker) {
    read_counts(spec, spec.what, "inner corners", 2, marker);
    marker.size_mm = length_mm(spec, spec.size);
    lay_out_board(chessboard_pattern(marker.columns, marker.rows, marker.size_mm), marker);
}

void parse_charuco(const Spec& spec, Marker& marker) {
    const std::vector<std::string> parts = split(spec.what, ':');
    if (parts.size() != 2 && parts.size() != 3)
        spec.fail(
            fmt::format("expected {0}:DICTIONARY:COLUMNSxROWS@... or "
                        "{0}:DICTIONARY:COLUMNSxROWS:FIRST_ID@...",
                        spec.kind));
    marker.family = parts[0];
    check_family(spec, "ArUco dictionary", marker.family, aruco_dictionaries());
    read_counts(spec, parts[1], "squares", 2, marker);
    if (parts.size() == 3)
        marker.id = checked_id(spec, parts[2], aruco_count(marker.family), marker.family);
    read_two_lengths(spec, "of a square and of a marker", marker);
    if (marker.part_mm >= marker.size_mm)
        spec.fail("the markers must be smaller than the squares that hold them");
    require_ids(spec, marker.id + marker.columns * marker.rows / 2, aruco_count(marker.family));
    // With an odd number of rows both layouts are one.
    marker.white_corner = spec.kind == "charuco-legacy" && marker.rows % 2 == 0;
    lay_out_board(charuco_pattern(marker.family, marker.columns, marker.rows, marker.size_mm,
                                  marker.part_mm, {marker.id, marker.white_corner}),
                  marker);
}

void parse_aprilgrid(const Spec& spec, Marker& marker) {
    const std::string counts =
        read_family(spec, "AprilTag family", marker, apriltag_families(), "COLUMNSxROWS@...");
    read_counts(spec, counts, "tags", 1, marker);
    read_two_lengths(spec, "of a tag and of the gap between tags", marker);
    require_ids(spec, marker.columns * marker.rows, apriltag_count(marker.family));
    lay_out_board(aprilgrid_pattern(marker.family, marker.columns, marker.rows, marker.size_mm,
                                    marker.part_mm),
                  marker);
}

void parse_circles(const Spec& spec, Marker& marker) {
    const auto layout = marker.kind == Marker::Kind::circles    ? CircleLayout::symmetric
                        : marker.kind == Marker::Kind::acircles ? CircleLayout::asymmetric
                                                                : CircleLayout::hexagonal;
    read_counts(spec, spec.what, "circles", 2, marker);
    read_two_lengths(spec, "the spacing and the diameter", marker);
    if (marker.part_mm >= nearest_circle_mm(layout, marker.size_mm))
        spec.fail("the circles touch: their diameter is not below the distance of their centres");
    lay_out_board(
        circles_pattern(layout, marker.columns, marker.rows, marker.size_mm, marker.part_mm),
        marker);
}

void parse_squares(const Spec& spec, Marker& marker) {
    read_counts(spec, spec.what, "squares", 2, marker);
    read_two_lengths(spec, "of a square and of the gap between squares", marker);
    lay_out_board(squares_pattern(marker.columns, marker.rows, marker.size_mm, marker.part_mm),
                  marker);
}

void parse_bitmap(const Spec& spec, Marker& marker) {
    const auto [width, height] =
        pair_of(spec, spec.size, [&](const std::string& text) { return length_mm(spec, text); });
    CodeImage image;
    try {
        image = read_image(spec.what);
    } catch (const ConfigError& error) {
        spec.fail(error.what());
    }
    marker.grid.corner_mm = {-width / 2.0, -height / 2.0};
    marker.grid.cell_mm = {width / image.pixels.cols, height / image.pixels.rows};
    image.pixels.convertTo(marker.grid.cells, CV_32F, 1.0 / image.full_scale());
}

struct ParserOfKind {
    const char* name;
    Marker::Kind kind;
    void (*parse)(const Spec&, Marker&);
};

constexpr ParserOfKind parsers[] = {{"apriltag", Marker::Kind::apriltag, parse_apriltag},
                                    {"aruco", Marker::Kind::aruco, parse_aruco},
                                    {"topotag", Marker::Kind::topotag, parse_topotag},
                                    {"stag", Marker::Kind::stag, parse_stag},
                                    {"chessboard", Marker::Kind::chessboard, parse_chessboard},
                                    {"charuco", Marker::Kind::charuco, parse_charuco},
                                    {"charuco-legacy", Marker::Kind::charuco, parse_charuco},
                                    {"aprilgrid", Marker::Kind::aprilgrid, parse_aprilgrid},
                                    {"circles", Marker::Kind::circles, parse_circles},
                                    {"acircles", Marker::Kind::acircles, parse_circles},
                                    {"hexcircles", Marker::Kind::hexcircles, parse_circles},
                                    {"squares", Marker::Kind::squares, parse_squares},
                                    {"bitmap", Marker::Kind::bitmap, parse_bitmap}};

}  // namespace

std::vector<std::string> marker_kinds() {
    std::vector<std::string> names;
    for (const ParserOfKind& parser : parsers)
        names.emplace_back(parser.name);
    return names;
}

Marker parse_marker(const std::string& text, const std::string& place) {
    const Spec spec = take_apart(text, place);
    const auto parser = std::ranges::find(parsers, spec.kind, &ParserOfKind::name);
    if (parser == std::end(parsers))
        spec.fail(fmt::format("unknown kind of marker '{}'; the kinds are {}{}", spec.kind,
                              fmt::join(marker_kinds(), ", "),
                              did_you_mean(spec.kind, marker_kinds())));
    Marker marker{text, parser->kind};
    try {
        parser->parse(spec, marker);
    } catch (const ConfigError& error) {
        const bool has_place = !error.place().file.empty() || !error.place().key.empty();
        if (has_place)
            throw;
        spec.fail(error.what());
    }
    return marker;
}

std::string marker_file(const Marker& marker) {
    if (marker.kind == Marker::Kind::bitmap)
        return take_apart(marker.spec, "").what;
    const bool has_table = marker.kind == Marker::Kind::stag && is_stag_file(marker.family);
    return has_table ? marker.family : "";
}

}  // namespace etalon
