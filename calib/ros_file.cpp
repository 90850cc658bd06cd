#include "calib/ros_file.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "calib/foreign_camera.h"
#include "core/text.h"

namespace etalon {
namespace {

YAML::Node parse(const std::string& text, const std::string& file) {
    try {
        const YAML::Node root = YAML::Load(text);
        if (!root.IsMap())
            throw ConfigError({file, 1}, "is no camera calibration of a known format");
        return root;
    } catch (const YAML::Exception& error) {
        throw ConfigError({file, error.mark.line + 1}, error.msg);
    }
}

// A value of a mapping with its place. yaml-cpp lets the first of two equal keys win; here that is
// an error.
class Entry {
public:
    Entry(YAML::Node node, SourcePlace place) : node_(std::move(node)), place_(std::move(place)) {}

    Entry at(const std::string& key) const {
        if (!node_.IsMap())
            throw ConfigError(place_, "must be a mapping (key: value)");
        SourcePlace place = place_;
        place.key += (place.key.empty() ? "" : ".") + key;
        std::optional<YAML::Node> found;
        for (const auto& entry : node_) {
            if (!entry.first.IsScalar() || entry.first.Scalar() != key)
                continue;
            place.line = entry.first.Mark().line + 1;
            if (found)
                throw ConfigError(place, "doubled key");
            found = entry.second;
        }
        if (!found)
            throw ConfigError(place, "missing");
        return {*found, place};
    }

    double number() const {
        const auto value = node_.IsScalar() ? parse_number(node_.Scalar()) : std::nullopt;
        if (!value)
            throw ConfigError(place_, "must be a finite number");
        return *value;
    }

    std::string text() const {
        if (!node_.IsScalar())
            throw ConfigError(place_, "must be a word");
        return node_.Scalar();
    }

    std::vector<double> numbers() const {
        if (!node_.IsSequence())
            throw ConfigError(place_, "must be a list of numbers");
        std::vector<double> numbers;
        for (const YAML::Node& item : node_)
            numbers.push_back(Entry(item, place_).number());
        return numbers;
    }

    const SourcePlace& place() const { return place_; }

private:
    YAML::Node node_;
    SourcePlace place_;
};

ForeignMatrix read_matrix(const Entry& entry) {
    ForeignMatrix matrix{entry.place()};
    const double rows = entry.at("rows").number(), cols = entry.at("cols").number();
    matrix.values = entry.at("data").numbers();
    if (!(rows >= 1 && cols >= 1 && rows * cols == static_cast<double>(matrix.values.size())))
        throw ConfigError(matrix.place, fmt::format("says {}x{} but has {} numbers", rows, cols,
                                                    matrix.values.size()));
    matrix.rows = static_cast<int>(rows);
    matrix.cols = static_cast<int>(cols);
    return matrix;
}

void check_model(const Entry& model, const ForeignMatrix& distortion) {
    const std::string name = model.text();
    if (name != "plumb_bob" && name != "rational_polynomial")
        throw ConfigError(model.place(),
                          "must be plumb_bob or rational_polynomial, not '" + name + "'");
    const std::size_t count = name == "plumb_bob" ? 5 : 8;
    if (distortion.values.size() != count)
        throw ConfigError(distortion.place, fmt::format("{} has {} coefficients, not {}", name,
                                                        count, distortion.values.size()));
}

}  // namespace

CameraModel read_ros_camera(const std::filesystem::path& path) {
    const std::string file = path.string();
    const Entry root(parse(read_text(path), file), {file, 1});
    const Entry camera_matrix = root.at("camera_matrix");
    const ForeignMatrix distortion = read_matrix(root.at("distortion_coefficients"));
    check_model(root.at("distortion_model"), distortion);
    CameraModel camera = camera_from_matrices(read_matrix(camera_matrix), distortion);
    const Entry width = root.at("image_width"), height = root.at("image_height");
    camera.width = checked_image_side(width.number(), width.place());
    camera.height = checked_image_side(height.number(), height.place());
    return camera;
}

}  // namespace etalon
