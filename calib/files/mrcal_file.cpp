// Calibrations as mrcal writes them (.cameramodel): a Python dictionary with lensmodel (once
// lens_model), intrinsics [fx, fy, cx, cy, distortion...] and imagersize [width, height]. Layout:
// mrcal's "Camera model representation in memory and on disk" and its cameramodel.py. The pose and
// optimization_inputs are not read.
//
// LENSMODEL_PINHOLE, _OPENCV4, 5, 8 and 12 (OpenCV's coefficients and order), _STEREOGRAPHIC,
// _SPLINED_STEREOGRAPHIC, _CAHVOR, and _CAHVORE with a fixed entrance pupil (its last three numbers
// are 0). Written is the first that holds the camera, at the reference frame's origin. Throws
// ConfigError for tau_x and tau_y, a skew, distortion of other than OpenCV models, and a splined
// field of view that is no whole number of degrees.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/file/text.h"

namespace etalon {
namespace {

// Python's literals as YAML: only the b before bytes must go. Columns and lines stay.
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

// LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170: a family, its configuration.
struct ModelName {
    std::string family;
    std::vector<double> configuration;
};
ModelName parsed(const Value& model, std::string name, std::initializer_list<const char*> keys) {
    ModelName result;
    for (const char* key : keys) {
        const std::string separator = fmt::format("_{}=", key);
        const std::size_t at = name.find(separator);
        if (at == std::string::npos)
            model.fail(fmt::format("must say {}", separator.substr(1)));
        const std::string rest = name.substr(at + separator.size());
        const auto number = parse_number(rest.substr(0, rest.find('_')));
        if (!number)
            model.fail(fmt::format("must say a number as {}", separator.substr(1)));
        if (result.family.empty())
            result.family = name.substr(0, at);
        result.configuration.push_back(*number);
    }
    return result;
}

using Numbers = std::span<const double>;  // what follows fx fy cx cy

void require_count(const Value& intrinsics, Numbers numbers, std::size_t count) {
    if (numbers.size() != count)
        intrinsics.fail(fmt::format("must have {} numbers, not {}", count + 4, numbers.size() + 4));
}

int whole(const Value& model, double number) {
    if (!(number >= 1.0 && number <= 1000.0) || number != std::floor(number))
        model.fail(fmt::format("must have whole numbers of 1 to 1000, not {}", number));
    return static_cast<int>(number);
}

LensProjection splined(const Value& model, const Value& intrinsics, Numbers numbers) {
    const ModelName name = parsed(model, model.text(), {"order", "Nx", "Ny", "fov_x_deg"});
    const int columns = whole(model, name.configuration[1]);
    const int rows = whole(model, name.configuration[2]);
    require_count(intrinsics, numbers, 2 * static_cast<std::size_t>(columns) * rows);
    return projection_at(model.place(), [&] {
        return splined_projection(whole(model, name.configuration[0]), columns, rows,
                                  name.configuration[3], {numbers.begin(), numbers.end()});
    });
}

LensProjection cahvor(const Value& intrinsics, Numbers n, double linearity) {
    return projection_at(intrinsics.place(), [&] {
        return cahvor_projection(n[0], n[1], n[2], n[3], n[4], linearity);
    });
}

LensProjection cahvore(const Value& model, const Value& intrinsics, Numbers numbers) {
    require_count(intrinsics, numbers, 8);
    for (const double e : numbers.last(3))
        if (e != 0.0)
            intrinsics.fail(
                "is of a CAHVORE lens whose entrance pupil moves with the angle (its last three "
                "numbers are not 0): its rays do not meet in one point, and no model here has "
                "such rays");
    return cahvor(intrinsics, numbers, parsed(model, model.text(), {"linearity"}).configuration[0]);
}

// Those without a configuration.
const ForeignModels& mrcal_models() {
    using enum Projection;
    static const ForeignModels all{{"PINHOLE", perspective, {}},
                                   {"OPENCV4", perspective, first_coefficients(4)},
                                   {"OPENCV5", perspective, first_coefficients(5)},
                                   {"OPENCV8", perspective, first_coefficients(8)},
                                   {"OPENCV12", perspective, first_coefficients(12)},
                                   {"STEREOGRAPHIC", stereographic, {}}};
    return all;
}

void read_model(const Value& model, const Value& intrinsics, Numbers numbers, CameraModel& camera) {
    const std::string name = model.text();
    const auto known = std::ranges::find_if(mrcal_models(), [&](const ForeignModel& one) {
        return name == std::string("LENSMODEL_") + one.name;
    });
    if (known != mrcal_models().end()) {
        require_count(intrinsics, numbers, known->parameters.size());
        camera.projection.kind = known->projection;
        set_parameters(camera, known->parameters, {numbers.begin(), numbers.end()});
    } else if (name == "LENSMODEL_CAHVOR") {
        require_count(intrinsics, numbers, 5);
        camera.projection = cahvor(intrinsics, numbers, 1.0);
    } else if (name.starts_with("LENSMODEL_CAHVORE_")) {
        camera.projection = cahvore(model, intrinsics, numbers);
    } else if (name.starts_with("LENSMODEL_SPLINED_STEREOGRAPHIC_")) {
        camera.projection = splined(model, intrinsics, numbers);
    } else {
        model.fail(
            "must be LENSMODEL_PINHOLE, _STEREOGRAPHIC, _OPENCV4, _OPENCV5, _OPENCV8, _OPENCV12, "
            "_CAHVOR, _CAHVORE or _SPLINED_STEREOGRAPHIC, not '" +
            name + "'");
    }
}

Value lens_model(const Value& root) {
    if (const auto old = root.find("lens_model"))
        return *old;
    return root.at("lensmodel");
}

// The name of the model for a camera, and what follows fx fy cx cy.
struct Written {
    std::string model;
    std::vector<double> numbers;
};

Written written_splined(const LensTable& table, const std::filesystem::path& path) {
    if (table.field_of_view_deg != std::floor(table.field_of_view_deg))
        throw ConfigError({path.string()}, fmt::format("mrcal has whole degrees only as a splined "
                                                       "model's field of view, not {}",
                                                       table.field_of_view_deg));
    return {fmt::format("SPLINED_STEREOGRAPHIC_order={}_Nx={}_Ny={}_fov_x_deg={:.0f}", table.order,
                        table.columns, table.rows, table.field_of_view_deg),
            table.coefficients};
}

Written written_cahvor(const LensTable& table) {
    std::vector<double> numbers(table.coefficients.begin(), table.coefficients.begin() + 5);
    const double linearity = table.coefficients[5];
    if (linearity == 1.0)
        return {"CAHVOR", numbers};
    numbers.insert(numbers.end(), 3, 0.0);
    return {fmt::format("CAHVORE_linearity={}", exact(linearity)), numbers};
}

Written written(const CameraModel& camera, const std::filesystem::path& path) {
    const bool is_wide = camera.projection.kind != Projection::perspective;
    if (is_wide)
        require_only(camera, {}, path, "mrcal's models of wide lenses");
    if (camera.projection.kind == Projection::cahvor)
        return written_cahvor(*camera.projection.table);
    if (camera.projection.kind == Projection::splined_stereographic)
        return written_splined(*camera.projection.table, path);
    const ForeignModel& model =
        model_holding(mrcal_models(), camera, path, "an mrcal OpenCV model");
    return {model.name, parameters_of(camera, model.parameters)};
}

}  // namespace

CameraModel read_mrcal_camera(const std::filesystem::path& path) {
    const Value root = foreign_root(without_bytes_prefix(read_text(path)), path.string());
    const Value intrinsics = root.at("intrinsics");
    const std::vector<double> i = intrinsics.numbers(0, any_number);
    if (i.size() < 4)
        intrinsics.fail("must have at least 4 numbers");
    CameraModel camera;
    camera.intrinsics = checked_intrinsics(i[0], i[1], i[2], i[3], intrinsics.place());
    read_model(lens_model(root), intrinsics, Numbers(i).subspan(4), camera);
    std::tie(camera.width, camera.height) = image_sides(root.at("imagersize"));
    return camera;
}

void write_mrcal_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "an mrcal model";
    using enum Projection;
    require_foreign_camera(camera, path, format,
                           {perspective, stereographic, cahvor, splined_stereographic});
    require_no_skew(camera, path, format);
    const Written model = written(camera, path);
    const Intrinsics& i = camera.intrinsics;
    std::vector<std::string> numbers{exact(i.fx), exact(i.fy), exact(i.cx), exact(i.cy)};
    for (const double number : model.numbers)
        numbers.push_back(exact(number));
    write_text(path,
               fmt::format("{{\n"
                           "    'lensmodel':  'LENSMODEL_{}',\n\n"
                           "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
                           "    'intrinsics': [ {},],\n\n"
                           "    'extrinsics': [ 0, 0, 0, 0, 0, 0,],\n\n"
                           "    'imagersize': [ {}, {},],\n\n"
                           "}}\n",
                           model.model, fmt::join(numbers, ", "), camera.width, camera.height));
}

}  // namespace etalon
