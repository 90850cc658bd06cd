#include "station/compare_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/text.h"
#include "station/csv.h"
#include "station/html.h"
#include "station/qualify_result.h"
#include "station/svg_plot.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

ordered_json three(const Eigen::Vector3d& v) {
    return {v.x(), v.y(), v.z()};
}

ordered_json pose_json(const Rigid& transform) {
    const Vector6d v = vector_from_rigid(transform);
    return std::vector<double>(v.data(), v.data() + 6);
}

ordered_json statistics_json(const ResidualStatistics& statistics) {
    ordered_json json = {{"pixels", statistics.pixels},
                         {"rms_gray", statistics.rms_gray},
                         {"mean_gray", statistics.mean_gray},
                         {"p99_gray", statistics.p99_gray},
                         {"worst_gray", statistics.worst_gray}};
    if (statistics.significant)
        json["significant"] = *statistics.significant;
    return json;
}

ordered_json photo_json(const ComparedPhoto& photo) {
    ordered_json json = {{"photo", photo.photo.string()}};
    if (!photo.failure.empty()) {
        json["failure"] = photo.failure;
        return json;
    }
    json["camera_from_marker"] = pose_json(photo.camera_from_marker);
    if (photo.estimate) {
        json["reprojection_rms_px"] = photo.estimate->reprojection_rms_px;
        if (photo.estimate->alternative) {
            json["alternative"] = pose_json(*photo.estimate->alternative);
            json["alternative_rms_px"] = photo.estimate->alternative_rms_px;
        }
    }
    json["photometric_model"] = {{"black_gray", three(photo.model.black.head<3>())},
                                 {"white_gray", three(photo.model.white.head<3>())},
                                 {"psf_sigma_px", photo.model.psf_sigma_px}};
    json["fitted"] = statistics_json(photo.fitted);
    json["scored"] = statistics_json(photo.scored);
    json["overlay"] = photo.overlay_file;
    json["residual_map"] = photo.residual_file;
    return json;
}

std::string csv_row(const ComparedPhoto& photo) {
    std::vector<double> numbers;
    const Vector6d pose = vector_from_rigid(photo.camera_from_marker);
    numbers.assign(pose.data(), pose.data() + 6);
    for (const Vector6d& level : {photo.model.black, photo.model.white})
        numbers.insert(numbers.end(), {level[0], level[1], level[2]});
    numbers.insert(numbers.end(),
                   {photo.model.psf_sigma_px, static_cast<double>(photo.scored.pixels),
                    photo.scored.rms_gray, photo.scored.mean_gray, photo.scored.p99_gray,
                    photo.scored.worst_gray, photo.fitted.rms_gray});
    std::string row;
    for (const double number : numbers)
        row += "," + exact(number);
    row += "," + (photo.estimate ? exact(photo.estimate->reprojection_rms_px) : std::string());
    row += "," + (photo.scored.significant ? exact(*photo.scored.significant) : std::string());
    return row;
}

std::string scored_region(const Comparison& comparison) {
    if (!comparison.is_chessboard)
        return "the whole marker with its white border";
    return fmt::format("the inner corners and {} squares around them in x, {} in y",
                       comparison.margin.x, comparison.margin.y);
}

std::string source_of_poses(const Comparison& comparison) {
    if (comparison.detector.empty())
        return "given in " + std::filesystem::path(comparison.poses).filename().string();
    return "estimated from corners (" + comparison.detector + ")";
}

// Mean over the compared photographs of whatever `value` takes from each.
template <class Function>
double mean_over(const Comparison& comparison, Function value) {
    double sum = 0.0;
    for (const ComparedPhoto& photo : comparison.photos)
        if (photo.failure.empty())
            sum += value(photo);
    return sum / static_cast<double>(std::max<std::size_t>(comparison.compared(), 1));
}

void add_summary(HtmlPage& page, const Comparison& comparison) {
    const std::size_t compared = comparison.compared(), all = comparison.photos.size();
    page.add_verdict(
        fmt::format("{:.1f} gray", comparison.mean_rms_gray()),
        fmt::format("mean residual over {} photo{}{}", compared, compared == 1 ? "" : "s",
                    compared == all ? ""
                                    : fmt::format("; {} more could not be compared (see the table)",
                                                  all - compared)));
    std::vector<std::pair<std::string, std::string>> facts = {
        {"camera", comparison.camera_file.filename().string()},
        {"marker", comparison.marker},
        {"poses", source_of_poses(comparison)},
        {"scored", scored_region(comparison)}};
    if (!comparison.detector.empty())
        facts.emplace_back("reprojection RMS, mean",
                           fmt::format("{:.3f} px", mean_over(comparison, [](const auto& photo) {
                                           return photo.estimate->reprojection_rms_px;
                                       })));
    facts.emplace_back("fitted PSF sigma, mean",
                       fmt::format("{:.2f} px", mean_over(comparison, [](const auto& photo) {
                                       return photo.model.psf_sigma_px;
                                   })));
    facts.emplace_back("mean signed residual",
                       fmt::format("{:+.2f} gray", mean_over(comparison, [](const auto& photo) {
                                       return photo.scored.mean_gray;
                                   })));
    page.add_facts(facts);
}

void add_method(HtmlPage& page, const Comparison& comparison) {
    page.add_paragraph(
        "Each photograph is set against a rendering of the marker at its pose, made from the "
        "calibration alone. Fitted per photograph are seven numbers: a black and a white level, "
        "each a plane over the image, and one Gaussian PSF width. They are fitted on one half of "
        "the cells (blocks of 2 × 2 take turns) and scored on the other half; every figure here is "
        "of the scored half. The residual of a photograph is the RMS of photo minus rendering, in "
        "gray = code value / full scale × 255, behind the camera's tone curve.");
    page.add_paragraph("From the calibration, not fitted: intrinsics, distortion" +
                       std::string(comparison.camera.lens ? ", defocus and diffraction" : "") +
                       std::string(comparison.camera.sensor ? ", transfer curve" : "") +
                       ". Rendering of the last photograph: " + comparison.render_plan + ".");
}

std::string residual_plot(const Comparison& comparison) {
    std::vector<std::string> names;
    std::vector<double> values;
    for (const ComparedPhoto& photo : comparison.photos) {
        if (!photo.failure.empty())
            continue;
        names.push_back(photo.photo.stem().string());
        values.push_back(photo.scored.rms_gray);
    }
    SvgPlot plot("photo", "residual RMS, gray");
    plot.add_bars(names, values, Ink::blue);
    plot.add_level(comparison.mean_rms_gray(), Ink::orange,
                   fmt::format("mean {:.1f}", comparison.mean_rms_gray()));
    return plot.svg();
}

std::string radius_plot(const Comparison& comparison) {
    const double corner = std::hypot(comparison.camera.width - 1, comparison.camera.height - 1) / 2;
    std::vector<double> radii, rms;
    std::vector<std::string> notes;
    for (std::size_t i = 0; i < comparison.radial.pixels.size(); ++i) {
        if (comparison.radial.pixels[i] < 100)
            continue;  // too few for a figure
        radii.push_back((static_cast<double>(i) + 0.5) / radius_bins * corner);
        rms.push_back(std::sqrt(comparison.radial.squares[i] / comparison.radial.pixels[i]));
        notes.push_back(fmt::format("{:.0f} px: {:.1f} gray, {:.0f} pixels", radii.back(),
                                    rms.back(), comparison.radial.pixels[i]));
    }
    SvgPlot plot("distance from the image's centre, px", "residual RMS, gray");
    plot.add_line(radii, rms, Ink::blue, "");
    plot.add_points(radii, rms, Ink::blue, "", notes);
    if (!rms.empty())
        plot.set_y_range(0.0, 1.15 * *std::max_element(rms.begin(), rms.end()));
    return plot.svg();
}

void add_plots(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Residuals");
    page.add_figures(
        {{residual_plot(comparison), "Residual of each photograph, scored half."},
         {radius_plot(comparison),
          "Residual by distance from the image's centre, all photographs together: a rise "
          "outwards points at the distortion or at the lens, not at the sensor."}});
}

// Columns that say nothing in this run are left out.
struct TableColumns {
    bool noise = false, failures = false;
};

std::vector<std::string> table_row(const ComparedPhoto& photo, const TableColumns& columns) {
    std::vector<std::string> row = {photo.photo.filename().string()};
    if (!photo.failure.empty()) {
        row.insert(row.end(), columns.noise ? 10 : 9, "–");
        row.push_back(photo.failure);
        return row;
    }
    const auto add = [&](double value, int digits) {
        row.push_back(fmt::format("{:.{}f}", value, digits));
    };
    add(photo.scored.rms_gray, 2);
    add(photo.scored.p99_gray, 1);
    add(photo.scored.mean_gray, 2);
    if (columns.noise)
        row.push_back(photo.scored.significant
                          ? fmt::format("{:.1f}", 100.0 * *photo.scored.significant)
                          : "–");
    add(photo.model.white[0], 0);
    add(photo.model.black[0], 0);
    add(photo.model.psf_sigma_px, 2);
    row.push_back(photo.estimate ? fmt::format("{:.3f}", photo.estimate->reprojection_rms_px)
                                 : "–");
    add(photo.camera_from_marker.translation.z(), 1);
    row.push_back(std::to_string(photo.scored.pixels));
    if (columns.failures)
        row.push_back("compared");
    return row;
}

void add_photo_table(HtmlPage& page, const Comparison& comparison) {
    TableColumns columns;
    for (const ComparedPhoto& photo : comparison.photos) {
        columns.noise |= photo.scored.significant.has_value();
        columns.failures |= !photo.failure.empty();
    }
    std::vector<std::string> header = {"photo", "RMS gray", "99 % gray", "mean gray"};
    if (columns.noise)
        header.push_back("over 3 σ, %");
    for (const char* column :
         {"white gray", "black gray", "PSF σ px", "corners px", "z mm", "pixels"})
        header.push_back(column);
    if (columns.failures)
        header.push_back("state");
    std::vector<std::vector<std::string>> rows;
    for (const ComparedPhoto& photo : comparison.photos)
        rows.push_back(table_row(photo, columns));
    page.add_heading("Photographs");
    page.add_table(header, rows);
}

// The colour scale of the residual maps, in the residual maps' own colours.
std::string colour_scale() {
    return fmt::format(
        "<div style=\"display:flex;gap:10px;align-items:center;font-size:.85rem;margin:.8em "
        "0;max-width:440px\"><span>−{0:.0f}</span><span style=\"flex:1;height:14px;border:1px "
        "solid var(--line);background:linear-gradient(90deg,rgb(0,145,170),#fff,rgb(205,25,30))\">"
        "</span><span>+{0:.0f} gray</span></div>\n",
        residual_map_scale_gray);
}

void add_pictures(HtmlPage& page, const Comparison& comparison) {
    page.add_heading("Overlays and residual maps");
    page.add_paragraph(fmt::format(
        "Left: photograph and rendering laid over each other, differences times {:.0f}; red: the "
        "photograph is brighter, cyan: the rendering is, gray: equal; pale around it: the "
        "photograph alone. Right: the residual, white where it is zero, in the scale below.",
        overlay_gain));
    page.add_html(colour_scale());
    std::vector<HtmlPage::Figure> figures;
    for (const ComparedPhoto& photo : comparison.photos) {
        if (!photo.failure.empty())
            continue;
        const std::string name = photo.photo.filename().string();
        figures.push_back(
            {photo.overlay_image, fmt::format("{}: {:.1f} gray (99 %: {:.0f})", name,
                                              photo.scored.rms_gray, photo.scored.p99_gray)});
        figures.push_back(
            {photo.residual_image, fmt::format("{}: photo minus rendering, PSF σ {:.2f} px", name,
                                               photo.model.psf_sigma_px)});
    }
    page.add_figures(figures);
}

void add_provenance(HtmlPage& page, const Comparison& comparison) {
    const Intrinsics& k = comparison.camera.intrinsics;
    std::vector<std::vector<std::string>> rows = {
        {"image", fmt::format("{} x {} px", comparison.camera.width, comparison.camera.height)},
        {"fx, fy", fmt::format("{:.3f}, {:.3f} px", k.fx, k.fy)},
        {"cx, cy", fmt::format("{:.3f}, {:.3f} px", k.cx, k.cy)}};
    std::string coefficients;
    for (const double value : comparison.camera.distortion.in_opencv_order())
        coefficients += fmt::format("{}{:.6g}", coefficients.empty() ? "" : ", ", value);
    rows.push_back({"k1 k2 p1 p2 k3 k4 k5 k6 s1..s4 tau_x tau_y", coefficients});
    page.begin_details("Camera and software");
    page.add_table({"calibration", comparison.camera_file.string()}, rows);
    std::vector<std::vector<std::string>> versions;
    for (const SoftwareVersion& version : software_versions())
        versions.push_back({version.name, version.version});
    page.add_table({"software", "version"}, versions);
    page.end_details();
}

}  // namespace

std::size_t Comparison::compared() const {
    return static_cast<std::size_t>(
        std::count_if(photos.begin(), photos.end(),
                      [](const ComparedPhoto& photo) { return photo.failure.empty(); }));
}

double Comparison::mean_rms_gray() const {
    return mean_over(*this, [](const ComparedPhoto& photo) { return photo.scored.rms_gray; });
}

void write_comparison_csv(const std::filesystem::path& path, const Comparison& comparison) {
    std::string text =
        "photo,failure,rx,ry,rz,tx,ty,tz,black_gray,black_per_width,black_per_height,white_gray,"
        "white_per_width,white_per_height,psf_sigma_px,scored_pixels,rms_gray,mean_gray,p99_gray,"
        "worst_gray,fitted_rms_gray,reprojection_rms_px,significant\n";
    constexpr int columns_of_a_compared_photo = 21;
    for (const ComparedPhoto& photo : comparison.photos)
        text += csv_text(photo.photo.string()) + "," + csv_text(photo.failure) +
                (photo.failure.empty() ? csv_row(photo)
                                       : std::string(columns_of_a_compared_photo, ',')) +
                "\n";
    write_text(path, text);
}

std::string comparison_json(const Comparison& comparison) {
    ordered_json json = {{"etalon", "comparison/1"},
                         {"camera", comparison.camera_file.string()},
                         {"marker", comparison.marker},
                         {"poses", source_of_poses(comparison)},
                         {"mean_residual_gray", comparison.mean_rms_gray()},
                         {"photos_compared", comparison.compared()},
                         {"photos_failed", comparison.photos.size() - comparison.compared()}};
    if (comparison.is_chessboard)
        json["score_margin_squares"] = {comparison.margin.x, comparison.margin.y};
    json["photos"] = ordered_json::array();
    for (const ComparedPhoto& photo : comparison.photos)
        json["photos"].push_back(photo_json(photo));
    return json.dump(2, ' ', false, ordered_json::error_handler_t::replace);
}

std::string comparison_html(const Comparison& comparison) {
    HtmlPage page(
        "Photographs against their renderings",
        fmt::format("{}, {}", comparison.camera_file.filename().string(), comparison.marker));
    add_summary(page, comparison);
    add_method(page, comparison);
    add_plots(page, comparison);
    add_photo_table(page, comparison);
    add_pictures(page, comparison);
    add_provenance(page, comparison);
    return page.finish();
}

}  // namespace etalon
