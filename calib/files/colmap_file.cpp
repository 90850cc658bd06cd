#include "calib/files/colmap_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>

#include "calib/files/foreign_camera.h"
#include "calib/files/pixel_origin.h"
#include "core/text.h"

namespace etalon {
namespace {

// A model's parameters after the focal lengths and the principal point.
struct Model {
    const char* name;
    bool one_focal_length;
    int coefficients;  // in OpenCV's order; of the radial ones only k1, k2 if not 4 or more
};
constexpr std::array models{Model{"SIMPLE_PINHOLE", true, 0}, Model{"PINHOLE", false, 0},
                            Model{"SIMPLE_RADIAL", true, 1},  Model{"RADIAL", true, 2},
                            Model{"OPENCV", false, 4},        Model{"FULL_OPENCV", false, 8}};

struct Line {
    SourcePlace place;
    std::vector<std::string> words;
};

std::vector<std::string> words_of(std::string_view line) {
    std::vector<std::string> words;
    std::string word;
    for (const char c : std::string(line) + " ") {
        if (c != ' ' && c != '\t' && c != '\r') {
            word += c;
        } else if (!word.empty()) {
            words.push_back(word);
            word.clear();
        }
    }
    return words;
}

std::vector<Line> camera_lines(const std::filesystem::path& path) {
    std::vector<Line> cameras;
    int number = 0;
    for (const std::string& line : split(read_text(path), '\n')) {
        ++number;
        const std::string_view content = trimmed(line);
        if (!content.empty() && content.front() != '#')
            cameras.push_back({{path.string(), number, ""}, words_of(content)});
    }
    return cameras;
}

Line choose_camera(const std::filesystem::path& path, const std::string& id) {
    std::vector<Line> cameras = camera_lines(path);
    if (!id.empty())
        std::erase_if(cameras, [&](const Line& line) { return line.words.front() != id; });
    if (cameras.empty())
        throw ConfigError({path.string()}, id.empty() ? "has no camera" : "has no camera " + id);
    if (cameras.size() > 1 && id.empty())
        throw ConfigError({path.string()},
                          fmt::format("has {} cameras: name one, by `etalon camera "
                                      "convert --select`",
                                      cameras.size()));
    if (cameras.size() > 1)
        throw ConfigError(cameras[1].place, "camera " + id + " is there twice");
    return cameras.front();
}

double number(const Line& line, std::size_t index, const std::string& name) {
    SourcePlace place = line.place;
    place.key = name;
    if (index >= line.words.size())
        throw ConfigError(place, "missing");
    if (const auto value = parse_number(line.words[index]))
        return *value;
    throw ConfigError(place, "must be a finite number, not '" + line.words[index] + "'");
}

const Model& model_of(const Line& line) {
    const std::string name = line.words.size() > 1 ? line.words[1] : "";
    for (const Model& model : models)
        if (name == model.name)
            return model;
    throw ConfigError({line.place.file, line.place.line, "MODEL"},
                      "must be SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or "
                      "FULL_OPENCV, not '" +
                          name + "'");
}

}  // namespace

CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& id) {
    const Line line = choose_camera(path, id);
    const Model& model = model_of(line);
    const std::size_t first = 4, focal_lengths = model.one_focal_length ? 1 : 2;
    const std::size_t coefficients = static_cast<std::size_t>(model.coefficients);
    const std::size_t count = focal_lengths + 2 + coefficients;
    if (line.words.size() != first + count)
        throw ConfigError({line.place.file, line.place.line, "PARAMS"},
                          fmt::format("{} has {} parameters, not {}", model.name, count,
                                      line.words.size() - std::min(first, line.words.size())));
    CameraModel camera;
    camera.width = checked_image_side(number(line, 2, "WIDTH"), line.place);
    camera.height = checked_image_side(number(line, 3, "HEIGHT"), line.place);
    std::vector<double> p;
    for (std::size_t i = 0; i < count; ++i)
        p.push_back(number(line, first + i, "PARAMS"));
    const std::size_t centre = focal_lengths;
    camera.intrinsics = from_pixels_of(
        CalibrationTool::colmap,
        checked_intrinsics(p[0], p[focal_lengths - 1], p[centre], p[centre + 1], line.place));
    std::array<double, 14> all{};
    std::copy(p.begin() + static_cast<std::ptrdiff_t>(centre + 2), p.end(), all.begin());
    camera.distortion = Distortion::from_opencv_order(all);
    return camera;
}

void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(camera, path, "COLMAP");
    const int count = shortest_distortion(camera, {0, 4, 8}, path, "COLMAP");
    const Intrinsics i = to_pixels_of(CalibrationTool::colmap, camera.intrinsics);
    std::vector<std::string> parameters{exact(i.fx), exact(i.fy), exact(i.cx), exact(i.cy)};
    const auto coefficients = camera.distortion.in_opencv_order();
    for (int k = 0; k < count; ++k)
        parameters.push_back(exact(coefficients[static_cast<std::size_t>(k)]));
    write_text(path, fmt::format("# Camera list with one line of data per camera:\n"
                                 "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
                                 "# Number of cameras: 1\n"
                                 "1 {} {} {} {}\n",
                                 count == 0   ? "PINHOLE"
                                 : count == 4 ? "OPENCV"
                                              : "FULL_OPENCV",
                                 camera.width, camera.height, fmt::join(parameters, " ")));
}

}  // namespace etalon
