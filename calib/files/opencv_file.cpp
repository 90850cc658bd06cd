// Calibrations as OpenCV's programs write them: YAML, XML or JSON of cv::FileStorage.
//
//   camera_matrix | cameraMatrix | Camera_Matrix      3x3, [fx skew cx; 0 fy cy; 0 0 1]
//   distortion_coefficients | dist_coeffs | distCoeffs | Distortion_Coefficients
//                                                     4, 5, 8, 12 or 14, as a row or a column
//   image_width, image_height | image_Width, image_Height | cameraResolution    optional
//   cameraMatrix_std_dev | camera_matrix_std_dev, dist_coeffs_std_dev |
//   distortion_coefficients_std_dev                   optional: a covariance without correlations
//   fisheye_model, not 0                              the four coefficients are cv::fisheye's
//   xi                                                cv::omnidir's, a number or a 1x1 matrix
//
// Four coefficients without one of the last two keys are k1 k2 p1 p2. Perspective: no skew.
//
// Written is OpenCV YAML, or XML or JSON by the extension, with the shortest list of coefficients
// (at least 5) that holds all but 0; numbers read back as the same doubles. A covariance's standard
// deviations are cameraMatrix_std_dev and dist_coeffs_std_dev (0: not known).
#include "calib/files/foreign_file.h"

#include <fmt/format.h>

#include <cmath>
#include <regex>

#include "core/file/text.h"

namespace etalon {
namespace {

using Names = std::initializer_list<const char*>;
constexpr Names camera_matrix_names{"camera_matrix", "cameraMatrix", "Camera_Matrix"};
constexpr Names distortion_keys{"distortion_coefficients", "dist_coeffs", "distCoeffs",
                                "Distortion_Coefficients"};
constexpr Names width_names{"image_width", "image_Width"};
constexpr Names height_names{"image_height", "image_Height"};

int line_at(const std::string& text, std::size_t at) {
    return 1 + static_cast<int>(std::count(text.begin(), text.begin() + at, '\n'));
}

// cv::FileStorage does not say lines: the first one that holds the key as a word.
int line_of(const std::string& text, const std::string& key) {
    std::smatch match;
    return std::regex_search(text, match, std::regex("\\b" + key + "\\b"))
               ? line_at(text, static_cast<std::size_t>(match.position()))
               : 0;
}

// OpenCV's parsers descend by recursion, so that a hostile file could exhaust the stack. What opens
// a level is counted rather than followed: quoting and comments cannot hide it.
void refuse_deep_nesting(const std::string& text, const std::string& file) {
    constexpr int most = 1000;
    int openings = 0;
    for (std::size_t i = 0; i < text.size(); ++i)
        if (text[i] == '[' || text[i] == '{' || (text[i] == '<' && text.compare(i, 2, "</") != 0))
            ++openings;
    if (openings > most)
        throw ConfigError({file},
                          fmt::format("has {} lists, mappings or tags, more than the {} of any "
                                      "camera calibration",
                                      openings, most));
}

// Behind the '>' of the tag or comment that begins here, not one in quotes; npos: nowhere.
std::size_t end_of_tag(const std::string& text, std::size_t begin) {
    if (text.compare(begin, 4, "<!--") == 0) {
        const std::size_t end = text.find("-->", begin + 4);
        return end == std::string::npos ? end : end + 3;
    }
    char quote = 0;
    for (std::size_t i = begin + 1; i < text.size(); ++i) {
        const char c = text[i];
        if (quote != 0)
            quote = c == quote ? 0 : quote;
        else if (c == '"' || c == '\'')
            quote = c;
        else if (c == '>')
            return i + 1;
        else if (c == '<')
            break;
    }
    return std::string::npos;
}

// OpenCV's XML parser (4.6) reads on behind the end of a text that stops within a tag, and crashes.
void refuse_unfinished_xml(const std::string& text, const std::string& file) {
    if (!trimmed(text).starts_with("<?xml"))
        return;
    for (std::size_t at = text.find('<'); at != std::string::npos;) {
        const std::size_t end = end_of_tag(text, at);
        if (end == std::string::npos)
            throw ConfigError({file, line_at(text, at)},
                              "a tag or comment of the XML does not end");
        at = text.find('<', end);
    }
    if (!trimmed(text).ends_with("</opencv_storage>"))
        throw ConfigError({file}, "is XML that does not end with </opencv_storage>");
}

std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    return std::string(trimmed(text));
}

struct OpenedFile {
    std::string file, text;
    cv::FileStorage storage;

    SourcePlace place(const std::string& key) const { return {file, line_of(text, key), key}; }
};

OpenedFile open(const std::filesystem::path& path) {
    OpenedFile opened{path.string(), read_text(path), {}};
    constexpr std::size_t largest = 1u << 20;
    if (opened.text.size() > largest)
        throw ConfigError({opened.file}, "is larger than 1 MiB: no camera calibration");
    refuse_deep_nesting(opened.text, opened.file);
    refuse_unfinished_xml(opened.text, opened.file);
    try {
        opened.storage.open(opened.text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    } catch (const cv::Exception& error) {
        throw ConfigError({opened.file}, "OpenCV cannot parse it: " + one_line(error.err));
    } catch (const std::length_error&) {  // of some unfinished tags and quotes
        throw ConfigError({opened.file}, "OpenCV cannot parse it: a text without an end");
    }
    if (!opened.storage.isOpened() || !opened.storage.root().isMap())
        throw ConfigError({opened.file}, "is no OpenCV YAML, XML or JSON with named values");
    return opened;
}

struct NamedNode {
    std::string key;
    cv::FileNode node;
};

// The value under any one of its usual names.
std::optional<NamedNode> find(const OpenedFile& opened, Names names) {
    std::optional<NamedNode> found;
    for (const char* name : names) {
        const cv::FileNode node = opened.storage[name];
        if (node.empty())
            continue;
        if (found)
            throw ConfigError(opened.place(name), "is given as '" + found->key + "' too");
        found = NamedNode{name, node};
    }
    return found;
}

NamedNode require(const OpenedFile& opened, Names names) {
    if (auto found = find(opened, names))
        return *found;
    throw ConfigError({opened.file, 0, *names.begin()}, "missing");
}

double number(const cv::FileNode& node, const SourcePlace& place) {
    if (!node.isInt() && !node.isReal())
        throw ConfigError(place, "must hold numbers only");
    return static_cast<double>(node);
}

void append_numbers(const cv::FileNode& list, ForeignMatrix& matrix) {
    for (const cv::FileNode& item : list)
        matrix.values.push_back(number(item, matrix.place));
}

void read_nested_lists(const cv::FileNode& list, ForeignMatrix& matrix) {
    matrix.rows = static_cast<int>(list.size());
    for (const cv::FileNode& row : list) {
        if (!row.isSeq() || row.size() != (*list.begin()).size())
            throw ConfigError(matrix.place, "must have rows of one length");
        matrix.cols = static_cast<int>(row.size());
        append_numbers(row, matrix);
    }
}

// OpenCV's own matrices (rows, cols, data), and the plain lists of other writers. Read number by
// number: cv::Mat's reader would allocate whatever size the file claims.
ForeignMatrix read_matrix(const OpenedFile& opened, const NamedNode& named) {
    ForeignMatrix matrix{opened.place(named.key)};
    const cv::FileNode& node = named.node;
    if (node.isMap() && node["data"].isSeq()) {
        const double rows = number(node["rows"], matrix.place);
        const double cols = number(node["cols"], matrix.place);
        append_numbers(node["data"], matrix);
        set_size(matrix, rows, cols);
    } else if (node.isSeq() && node.size() > 0 && (*node.begin()).isSeq()) {
        read_nested_lists(node, matrix);
    } else if (node.isSeq()) {
        append_numbers(node, matrix);
        matrix.rows = 1;
        matrix.cols = static_cast<int>(matrix.values.size());
    } else {
        throw ConfigError(matrix.place, "must be a matrix");
    }
    return matrix;
}

const ParameterNames intrinsics_order{intrinsic_names.begin(), intrinsic_names.end()};

// Of the coefficients that a file lists at most, in its order.
ParameterNames names_in_file(Projection projection) {
    return projection == Projection::equidistant ? kannala_brandt : first_coefficients(14);
}

// Of fx fy cx cy, then of the first coefficients; 0 for parameters that were held fixed.
void append_deviations(const OpenedFile& opened, Names keys, const ParameterNames& names,
                       std::vector<std::pair<std::string, double>>& deviations) {
    const auto named = find(opened, keys);
    if (!named)
        return;
    const ForeignMatrix list = read_matrix(opened, *named);
    if ((list.rows != 1 && list.cols != 1) || list.values.size() > names.size())
        throw ConfigError(list.place,
                          fmt::format("must be a row or column of at most {}", names.size()));
    for (std::size_t i = 0; i < list.values.size(); ++i) {
        const double deviation = list.values[i];
        const double variance = deviation * deviation;
        if (!std::isfinite(variance) || deviation < 0.0 || (deviation > 0.0 && variance == 0.0))
            throw ConfigError(list.place,
                              "has a standard deviation that is negative or whose square is no "
                              "finite number");
        if (deviation > 0.0)
            deviations.emplace_back(names[i], deviation);
    }
}

std::optional<ParameterCovariance> read_covariance(const OpenedFile& opened,
                                                   Projection projection) {
    std::vector<std::pair<std::string, double>> deviations;
    append_deviations(opened, {"camera_matrix_std_dev", "cameraMatrix_std_dev"}, intrinsics_order,
                      deviations);
    append_deviations(opened, {"distortion_coefficients_std_dev", "dist_coeffs_std_dev"},
                      names_in_file(projection), deviations);
    if (deviations.empty())
        return std::nullopt;
    const Eigen::Index n = std::ssize(deviations);
    ParameterCovariance covariance{{}, Eigen::MatrixXd::Zero(n, n)};
    for (const auto& [name, deviation] : deviations) {
        const Eigen::Index i = std::ssize(covariance.order);
        covariance.order.push_back(name);
        covariance.matrix(i, i) = deviation * deviation;
    }
    return covariance;
}

// Some ROS drivers write camera_info with OpenCV and say the model.
void refuse_other_models(const OpenedFile& opened) {
    const cv::FileNode model = opened.storage["distortion_model"];
    if (model.empty())
        return;
    const std::string name = model.isString() ? model.string() : "";
    if (name != "plumb_bob" && name != "rational_polynomial")
        throw ConfigError(opened.place("distortion_model"),
                          "must be plumb_bob or rational_polynomial, not '" + one_line(name) + "'");
}

// As two numbers, or as the interactive calibration's cv::Size.
void read_image_size(const OpenedFile& opened, CameraModel& camera) {
    const auto width = find(opened, width_names), height = find(opened, height_names);
    const auto size = find(opened, {"cameraResolution"});
    const auto side = [&](const cv::FileNode& node, const std::string& key) {
        return checked_image_side(number(node, opened.place(key)), opened.place(key));
    };
    if (width.has_value() != height.has_value())
        throw ConfigError(opened.place(width ? width->key : height->key),
                          "image width and height must be given together");
    if (size && width)
        throw ConfigError(opened.place(size->key), "is given as '" + width->key + "' too");
    if (size && (!size->node.isSeq() || size->node.size() != 2))
        throw ConfigError(opened.place(size->key), "must be width and height");
    if (width) {
        camera.width = side(width->node, width->key);
        camera.height = side(height->node, height->key);
    } else if (size) {
        camera.width = side(size->node[0], size->key);
        camera.height = side(size->node[1], size->key);
    }
}

// What OpenCV's samples add to a file of cv::fisheye (fisheye_model) and cv::omnidir (xi).
void read_wide_projection(const OpenedFile& opened, const ForeignMatrix& distortion,
                          CameraModel& camera) {
    const auto fisheye = find(opened, {"fisheye_model"}), xi = find(opened, {"xi"});
    const bool is_fisheye = fisheye && number(fisheye->node, opened.place("fisheye_model")) != 0.0;
    if (!is_fisheye && !xi)
        return;
    if (distortion.values.size() != 4 || (is_fisheye && xi))
        throw ConfigError(distortion.place,
                          "of a fisheye or omnidirectional camera must be four "
                          "coefficients, of one of the two");
    if (is_fisheye) {
        camera.projection.kind = Projection::equidistant;
        camera.distortion = {};
        set_parameters(camera, kannala_brandt, distortion.values);
    } else {
        const SourcePlace place = opened.place("xi");
        const double offset =
            xi->node.isMap() ? read_matrix(opened, *xi).values.at(0) : number(xi->node, place);
        camera.projection = checked_projection({Projection::unified, offset}, place);
    }
}

std::size_t checked_count(const ForeignMatrix& distortion) {
    const std::size_t count = distortion.values.size();
    const bool is_vector = distortion.rows == 1 || distortion.cols == 1;
    if (!is_vector || (count != 4 && count != 5 && count != 8 && count != 12 && count != 14))
        throw ConfigError(distortion.place,
                          fmt::format("must be a row or column of 4, 5, 8, 12 or 14 coefficients, "
                                      "not {}x{} with {} numbers",
                                      distortion.rows, distortion.cols, count));
    if (std::ranges::any_of(distortion.values, [](double x) { return !std::isfinite(x); }))
        throw ConfigError(distortion.place, "has a number that is not finite");
    return count;
}

CameraModel read_camera_from(const OpenedFile& opened) {
    refuse_other_models(opened);
    const ForeignMatrix camera_matrix = read_matrix(opened, require(opened, camera_matrix_names));
    const ForeignMatrix distortion = read_matrix(opened, require(opened, distortion_keys));
    CameraModel camera;
    camera.intrinsics = intrinsics_of(camera_matrix);
    set_parameters(camera, first_coefficients(checked_count(distortion)), distortion.values);
    read_wide_projection(opened, distortion, camera);
    camera.covariance = read_covariance(opened, camera.projection.kind);
    read_image_size(opened, camera);
    return camera;
}

// Standard deviations of these parameters, 0 for those that the covariance does not have.
std::vector<double> deviations_of(const CameraModel& camera, const ParameterNames& names) {
    std::vector<double> deviations(names.size());
    if (!camera.covariance)
        return deviations;
    const auto& [order, matrix] = *camera.covariance;
    for (std::size_t i = 0; i < order.size(); ++i)
        if (const auto at = std::ranges::find(names, order[i]); at != names.end()) {
            const auto k = static_cast<Eigen::Index>(i);
            deviations[static_cast<std::size_t>(at - names.begin())] = std::sqrt(matrix(k, k));
        }
    return deviations;
}

// How many of 14 coefficients OpenCV would write to hold all that are not 0.
int shortest_list(const std::vector<double>& values) {
    int count = 14;
    for (const int shorter : {12, 8, 5})
        if (std::all_of(values.begin() + shorter, values.end(), [](double c) { return c == 0.0; }))
            count = shorter;
    return count;
}

}  // namespace

CameraModel read_opencv_camera(const std::filesystem::path& path) {
    const OpenedFile opened = open(path);
    try {
        return read_camera_from(opened);
    } catch (const cv::Exception& error) {
        throw ConfigError({opened.file}, "OpenCV cannot read it: " + one_line(error.err));
    }
}

void write_opencv_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "an OpenCV calibration file";
    const Projection projection = camera.projection.kind;
    require_projection(camera, path, format,
                       {Projection::perspective, Projection::equidistant, Projection::unified});
    const bool is_fisheye = projection == Projection::equidistant;
    if (projection == Projection::perspective)
        require_no_skew(camera, path, "OpenCV's perspective model");
    const ParameterNames names =
        projection == Projection::unified ? first_coefficients(4) : names_in_file(projection);
    require_only(camera, names, path, format);
    const Intrinsics& i = camera.intrinsics;
    const cv::Matx33d camera_matrix(i.fx, i.skew, i.cx, 0, i.fy, i.cy, 0, 0, 1);
    const std::vector<double> coefficients = parameters_of(camera, names),
                              deviations = deviations_of(camera, names);
    const int count = projection == Projection::perspective
                          ? std::max(shortest_list(coefficients), shortest_list(deviations))
                          : static_cast<int>(names.size());

    const std::string kind = path.extension();
    cv::FileStorage storage(kind == ".xml" || kind == ".json" ? kind : ".yml",
                            cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
    storage << "image_width" << camera.width << "image_height" << camera.height;
    storage << "camera_matrix" << cv::Mat(camera_matrix);
    storage << "distortion_coefficients" << cv::Mat(coefficients).rowRange(0, count).t();
    if (is_fisheye)
        storage << "fisheye_model" << 1;
    if (projection == Projection::unified)
        storage << "xi" << camera.projection.a;
    if (camera.covariance) {
        storage << "cameraMatrix_std_dev" << cv::Mat(deviations_of(camera, intrinsics_order));
        storage << "dist_coeffs_std_dev" << cv::Mat(deviations).rowRange(0, count);
    }
    write_text(path, storage.releaseAndGetString());
}

}  // namespace etalon
