// Calibrations as COLMAP keeps them (cameras.txt): a line `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`
// for every camera, and comments #. Layout: COLMAP's "Output Format" and "Camera Models";
// parameters: its sensor/models.h. Models: colmap_models() below.
//
// Written is one camera with the id 1, as the first model with two focal lengths that holds it.
// Throws ConfigError for coefficients that COLMAP does not have there, and for a skew.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <sstream>

#include "core/file/text.h"

namespace etalon {
namespace {

// After the focal lengths and the principal point.
const ForeignModels& colmap_models() {
    using enum Projection;
    static const ForeignModels all{
        {"SIMPLE_PINHOLE", perspective, {}, true},
        {"PINHOLE", perspective, {}},
        {"SIMPLE_RADIAL", perspective, {"k1"}, true},
        {"RADIAL", perspective, {"k1", "k2"}, true},
        {"OPENCV", perspective, first_coefficients(4)},
        {"FULL_OPENCV", perspective, first_coefficients(8)},
        {"FOV", field_of_view, {"omega"}},
        {"SIMPLE_RADIAL_FISHEYE", equidistant, {"k1"}, true},
        {"RADIAL_FISHEYE", equidistant, {"k1", "k2"}, true},
        {"OPENCV_FISHEYE", equidistant, kannala_brandt},
        {"THIN_PRISM_FISHEYE", equidistant, {"k1", "k2", "p1", "p2", "k3", "k7", "s1", "s3"}}};
    return all;
}

struct Line {
    SourcePlace place;
    std::vector<std::string> words;
};

std::vector<Line> camera_lines(const std::filesystem::path& path) {
    std::vector<Line> cameras;
    int number = 0;
    for (const std::string& line : split(read_text(path), '\n')) {
        ++number;
        std::istringstream stream{line};
        std::vector<std::string> words{std::istream_iterator<std::string>(stream), {}};
        if (!words.empty() && words.front().front() != '#')
            cameras.push_back({{path.string(), number, ""}, std::move(words)});
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

}  // namespace

CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& id) {
    const Line line = choose_camera(path, id);
    const ForeignModel& model =
        model_named(colmap_models(), line.words.size() > 1 ? line.words[1] : "",
                    {line.place.file, line.place.line, "MODEL"});
    const std::size_t first = 4, focal_lengths = model.one_focal_length ? 1 : 2;
    const std::size_t count = focal_lengths + 2 + model.parameters.size();
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
    camera.intrinsics =
        checked_intrinsics(p[0], p[focal_lengths - 1], p[centre], p[centre + 1], line.place);
    camera.projection.kind = model.projection;
    set_parameters(camera, model.parameters, {p.begin() + focal_lengths + 2, p.end()});
    checked_projection(camera.projection, line.place);
    return camera;
}

void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(
        camera, path, "COLMAP",
        {Projection::perspective, Projection::equidistant, Projection::field_of_view});
    require_no_skew(camera, path, "COLMAP");
    const ForeignModel& model = model_holding(colmap_models(), camera, path, "COLMAP");
    const Intrinsics& i = camera.intrinsics;
    std::vector<std::string> parameters{exact(i.fx), exact(i.fy), exact(i.cx), exact(i.cy)};
    for (const double number : parameters_of(camera, model.parameters))
        parameters.push_back(exact(number));
    write_text(path,
               fmt::format("# Camera list with one line of data per camera:\n"
                           "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
                           "# Number of cameras: 1\n"
                           "1 {} {} {} {}\n",
                           model.name, camera.width, camera.height, fmt::join(parameters, " ")));
}

}  // namespace etalon
