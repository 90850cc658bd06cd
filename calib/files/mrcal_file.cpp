#include "calib/files/mrcal_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/foreign_camera.h"
#include "calib/files/foreign_value.h"
#include "calib/files/pixel_origin.h"
#include "core/text.h"

namespace etalon {
namespace {

constexpr const char* known_models =
    "LENSMODEL_PINHOLE, LENSMODEL_STEREOGRAPHIC or LENSMODEL_OPENCV4, _OPENCV5, _OPENCV8 or "
    "_OPENCV12";

// Python's literals as YAML: only the b before bytes has to go, which else would be a plain word
// that ends at the first bracket of the base-85 text. Columns and lines stay.
std::string without_bytes_prefix(std::string text) {
    char quote = 0;
    bool in_comment = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (in_comment) {
            in_comment = c != '\n';
        } else if (quote != 0) {
            quote = c == quote ? 0 : quote;
        } else if (c == '#') {
            in_comment = true;
        } else if (c == '\'' || c == '"') {
            quote = c;
            if (i > 0 && text[i - 1] == 'b')
                text[i - 1] = ' ';
        }
    }
    return text;
}

int coefficients_of(const ForeignValue& model) {
    const std::string name = model.text();
    if (name == "LENSMODEL_PINHOLE" || name == "LENSMODEL_STEREOGRAPHIC")
        return 0;
    for (const int count : {4, 5, 8, 12})
        if (name == fmt::format("LENSMODEL_OPENCV{}", count))
            return count;
    model.fail(fmt::format("must be {}, not '{}'", known_models, name));
}

ForeignValue lens_model(const ForeignValue& root) {
    if (const auto old = root.find("lens_model"))
        return *old;
    return root.at("lensmodel");
}

}  // namespace

CameraModel read_mrcal_camera(const std::filesystem::path& path) {
    const ForeignValue root =
        ForeignValue::parse(without_bytes_prefix(read_text(path)), path.string());
    const auto count = static_cast<std::size_t>(coefficients_of(lens_model(root)));
    const ForeignValue intrinsics = root.at("intrinsics"), size = root.at("imagersize");
    const auto i = intrinsics.numbers(4 + count), sides = size.numbers(2);
    CameraModel camera;
    camera.intrinsics = from_pixels_of(
        CalibrationTool::mrcal, checked_intrinsics(i[0], i[1], i[2], i[3], intrinsics.place()));
    std::array<double, 14> all{};
    std::copy(i.begin() + 4, i.end(), all.begin());
    camera.distortion = Distortion::from_opencv_order(all);
    if (lens_model(root).text() == "LENSMODEL_STEREOGRAPHIC")
        camera.projection.kind = Projection::stereographic;
    camera.width = checked_image_side(sides[0], size.place());
    camera.height = checked_image_side(sides[1], size.place());
    return camera;
}

void write_mrcal_camera(const std::filesystem::path& path, const CameraModel& camera) {
    const bool is_stereographic = camera.projection.kind == Projection::stereographic;
    const char* format = is_stereographic ? "mrcal's stereographic model" : "an mrcal OpenCV model";
    require_foreign_camera(camera, path, format,
                           {Projection::perspective, Projection::stereographic});
    require_no_skew(camera, path, format);
    if (is_stereographic)
        require_only(camera, {}, path, format);
    const int count = shortest_distortion(camera, {0, 4, 5, 8, 12}, path, format);
    const Intrinsics i = to_pixels_of(CalibrationTool::mrcal, camera.intrinsics);
    std::vector<std::string> numbers{exact(i.fx), exact(i.fy), exact(i.cx), exact(i.cy)};
    const auto coefficients = camera.distortion.in_opencv_order();
    for (int k = 0; k < count; ++k)
        numbers.push_back(exact(coefficients[static_cast<std::size_t>(k)]));
    write_text(path, fmt::format("{{\n"
                                 "    'lensmodel':  'LENSMODEL_{}',\n\n"
                                 "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
                                 "    'intrinsics': [ {},],\n\n"
                                 "    'extrinsics': [ 0, 0, 0, 0, 0, 0,],\n\n"
                                 "    'imagersize': [ {}, {},],\n\n"
                                 "}}\n",
                                 is_stereographic ? "STEREOGRAPHIC"
                                 : count == 0     ? "PINHOLE"
                                                  : fmt::format("OPENCV{}", count),
                                 fmt::join(numbers, ", "), camera.width, camera.height));
}

}  // namespace etalon
