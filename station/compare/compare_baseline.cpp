#include "station/compare/compare_baseline.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "compare/pose/pose_bias.h"
#include "core/config/strict_reader.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// ---- reading --------------------------------------------------------------------------------

// Beyond these no figure of a photograph lies, and differences and squares stay finite.
constexpr Range believable{0.0, 1e9};
constexpr Range believable_pose{-1e9, 1e9};

std::optional<double> figure(const Value& of, std::string_view key) {
    const auto value = of.find(key);
    return value ? std::optional(value->number(believable)) : std::nullopt;
}

Rigid pose_of(const Value& fit) {
    const std::vector<double> pose = fit.at("camera_from_marker").numbers(6, believable_pose);
    return rigid_from_vector(Eigen::Map<const Vector6d>(pose.data()));
}

void read_fit(const Value& fit, std::optional<Rigid>& pose, std::optional<double>& residual_gray,
              std::optional<double>& edge_shift_px) {
    pose = pose_of(fit);
    residual_gray = fit.at("scored").at("rms_gray").number(believable);
    if (const auto edges = fit.find("edges"))
        edge_shift_px = figure(*edges, "shift_rms_px");
}

PhotoSummary read_photo_summary(const Value& entry) {
    PhotoSummary photo;
    photo.name = std::filesystem::path(entry.at("photo").text()).filename().string();
    if (photo.name.empty())
        entry.at("photo").fail("names no file");
    photo.outcome = entry.at("outcome").text();
    if (const auto fit = entry.find("calibrated")) {
        read_fit(*fit, photo.camera_from_marker, photo.residual_gray, photo.edge_shift_px);
        photo.psf_sigma_px = figure(fit->at("photometric_model"), "psf_sigma_px");
    }
    if (const auto fit = entry.find("refined"))
        read_fit(*fit, photo.refined_from_marker, photo.refined_residual_gray,
                 photo.refined_edge_shift_px);
    return photo;
}

// ---- pairing --------------------------------------------------------------------------------

std::map<std::string, int> occurrences(const ComparisonSummary& comparison) {
    std::map<std::string, int> counts;
    for (const PhotoSummary& photo : comparison.photos)
        ++counts[photo.name];
    return counts;
}

void pair_photos(const ComparisonSummary& earlier, const ComparisonSummary& now,
                 BaselineChange& change) {
    const std::map<std::string, int> before = occurrences(earlier), after = occurrences(now);
    for (const PhotoSummary& photo : now.photos)
        if (!before.contains(photo.name))
            change.only_now.push_back(photo.name);
    for (const PhotoSummary& photo : earlier.photos)
        if (!after.contains(photo.name))
            change.only_earlier.push_back(photo.name);
    for (const auto& [name, count] : after)
        if (before.contains(name) && std::max(count, before.at(name)) > 1)
            change.ambiguous.push_back(name);
    for (const PhotoSummary& photo : now.photos)
        for (const PhotoSummary& same : earlier.photos)
            if (same.name == photo.name && after.at(photo.name) == 1 && before.at(photo.name) == 1)
                change.pairs.push_back({same, photo});
}

// ---- differences ----------------------------------------------------------------------------

struct SummaryFigure {
    const char *key, *name, *unit;  // the key is of files
    std::optional<double> PhotoSummary::*value;
};
constexpr SummaryFigure summary_figures[] = {
    {"residual_gray", "residual", "gray", &PhotoSummary::residual_gray},
    {"refined_residual_gray", "residual, refined pose", "gray",
     &PhotoSummary::refined_residual_gray},
    {"edge_shift_px", "edge shift", "px", &PhotoSummary::edge_shift_px},
    {"refined_edge_shift_px", "edge shift, refined pose", "px",
     &PhotoSummary::refined_edge_shift_px},
    {"psf_sigma_px", "fitted blur", "px", &PhotoSummary::psf_sigma_px}};

struct Samples {
    std::string quantity, unit;
    std::vector<double> earlier, now;  // by pair
};

Samples samples_of(const SummaryFigure& figure, const std::vector<PhotoPair>& pairs) {
    Samples samples{figure.name, figure.unit, {}, {}};
    for (const PhotoPair& pair : pairs)
        if (pair.earlier.*figure.value && pair.now.*figure.value) {
            samples.earlier.push_back(*(pair.earlier.*figure.value));
            samples.now.push_back(*(pair.now.*figure.value));
        }
    return samples;
}

// Of a pose only the change has a meaning: it counts from 0.
std::vector<Samples> pose_samples(const std::string& what, std::optional<Rigid> PhotoSummary::*pose,
                                  const std::vector<PhotoPair>& pairs) {
    std::vector<Samples> samples;
    for (const char* component : {" x", " y", " z"})
        samples.push_back({what + component, "mm", {}, {}});
    for (const char* component : {" rx", " ry", " rz"})
        samples.push_back({what + component, "mrad", {}, {}});
    for (const PhotoPair& pair : pairs) {
        if (!(pair.earlier.*pose) || !(pair.now.*pose))
            continue;
        const Vector6d difference = pose_change(*(pair.earlier.*pose), *(pair.now.*pose));
        for (std::size_t i = 0; i < samples.size(); ++i) {
            samples[i].earlier.push_back(0.0);
            samples[i].now.push_back(difference[static_cast<Eigen::Index>(i)]);
        }
    }
    return samples;
}

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// Bonferroni: each of `quantities` intervals misses with a probability of (1 - confidence) /
// quantities at most.
PairedChange paired_change(const Samples& samples, std::size_t quantities) {
    const std::size_t n = samples.now.size();
    PairedChange change{samples.quantity,  samples.unit, static_cast<int>(n), mean(samples.earlier),
                        mean(samples.now), 0.0,          std::nullopt};
    change.mean = change.now - change.earlier;
    if (n < 2)
        return change;
    double squares = 0.0;
    for (std::size_t i = 0; i < n; ++i)
        squares += std::pow(samples.now[i] - samples.earlier[i] - change.mean, 2);
    const double count = static_cast<double>(n);
    const double error_of_mean = std::sqrt(squares / (count - 1.0) / count);
    const double tail = 0.5 * (1.0 - baseline_confidence) / static_cast<double>(quantities);
    change.half_width = student_t_quantile(tail, static_cast<int>(n) - 1) * error_of_mean;
    return change;
}

std::vector<PairedChange> paired_changes(const std::vector<PhotoPair>& pairs) {
    std::vector<Samples> all;
    for (const SummaryFigure& figure : summary_figures)
        all.push_back(samples_of(figure, pairs));
    for (const auto& [what, pose] : {std::pair("pose", &PhotoSummary::camera_from_marker),
                                     std::pair("refined pose", &PhotoSummary::refined_from_marker)})
        for (Samples& samples : pose_samples(what, pose, pairs))
            all.push_back(std::move(samples));
    std::erase_if(all, [](const Samples& samples) { return samples.now.empty(); });
    std::vector<PairedChange> changes;
    for (const Samples& samples : all)
        changes.push_back(paired_change(samples, all.size()));
    return changes;
}

}  // namespace

ComparisonSummary read_comparison(const std::filesystem::path& folder) {
    const StrictFile file(folder / "comparison.json", "comparison/1");
    const Value root = file.root();
    ComparisonSummary summary;
    if (const auto serial = root.find("serial"))
        summary.serial = serial->text();
    constexpr int max_side = 1 << 20;
    summary.width = root.at("image").at("width").integer(1, max_side);
    summary.height = root.at("image").at("height").integer(1, max_side);
    summary.marker = root.at("marker").text();
    for (const Value& photo : root.at("photos").items())
        summary.photos.push_back(read_photo_summary(photo));
    return summary;
}

void require_same_camera(const ComparisonSummary& earlier, const ComparisonSummary& now) {
    const auto require_equal = [](const std::string& what, const std::string& then,
                                  const std::string& today) {
        if (then != today)
            throw ConfigError({"--baseline"}, fmt::format("is of {} {}, these photographs of {}",
                                                          what, then, today));
    };
    if (!earlier.serial.empty() && !now.serial.empty())
        require_equal("camera", earlier.serial, now.serial);
    require_equal("images of", fmt::format("{} x {} px", earlier.width, earlier.height),
                  fmt::format("{} x {} px", now.width, now.height));
    require_equal("the marker", earlier.marker, now.marker);
}

Vector6d pose_change(const Rigid& earlier, const Rigid& now) {
    const PoseError change = pose_error(now, earlier);
    Vector6d numbers;
    numbers << change.translation_mm, 1e3 * change.rotation_rad;
    return numbers;
}

BaselineChange compare_with_baseline(const ComparisonSummary& earlier, const ComparisonSummary& now,
                                     const std::filesystem::path& folder) {
    BaselineChange change;
    change.folder = folder;
    change.serials_known = !earlier.serial.empty() && !now.serial.empty();
    pair_photos(earlier, now, change);
    change.quantities = paired_changes(change.pairs);
    return change;
}

ResultTable change_table(const BaselineChange& change) {
    const ColumnsOf<PairedChange> columns = {
        {"quantity", &PairedChange::quantity, "quantity"},
        {"unit", &PairedChange::unit, "unit"},
        {"",
         [](const PairedChange& one) {
             return one.changed()    ? "changed"
                    : one.half_width ? "not significant"
                                     : "one pair says nothing";
         },
         "outcome"},
        {"pairs", &PairedChange::pairs, "pairs"},
        {"earlier", &PairedChange::earlier, "then", "", "{:.4f}"},
        {"now", &PairedChange::now, "now", "", "{:.4f}"},
        {"change", &PairedChange::mean, "change", "", "{:+.4f}"},
        {"half_width", &PairedChange::half_width, "±", "", "{:.4f}"}};
    return table_of(columns, change.quantities);
}

std::string baseline_text(const BaselineChange& change) {
    std::string text =
        fmt::format("since {}: {} photos paired\n", change.folder.string(), change.pairs.size());
    for (const auto& [what, names] :
         {std::pair("only now", &change.only_now), std::pair("only then", &change.only_earlier),
          std::pair("not paired, two of a name", &change.ambiguous)})
        if (!names->empty())
            text += fmt::format("  {}: {}\n", what, fmt::join(*names, ", "));
    return text + text_table(change_table(change), {"then", "now", "pairs"});
}

std::string baseline_csv(const BaselineChange& change) {
    ColumnsOf<PhotoPair> columns = {
        {"photo", [](const PhotoPair& pair) { return pair.now.name; }},
        {"outcome_earlier", [](const PhotoPair& pair) { return pair.earlier.outcome; }},
        {"outcome_now", [](const PhotoPair& pair) { return pair.now.outcome; }}};
    for (const auto& [key, name, unit, value] : summary_figures) {
        const std::string start = key;
        const auto figure = value;
        columns.push_back(
            {start + "_earlier", [=](const PhotoPair& pair) { return pair.earlier.*figure; }});
        columns.push_back(
            {start + "_now", [=](const PhotoPair& pair) { return pair.now.*figure; }});
        columns.push_back({start + "_change", [=](const PhotoPair& pair) -> TableCell {
                               const auto &before = pair.earlier.*figure, &after = pair.now.*figure;
                               return before && after ? TableCell(*after - *before) : TableCell();
                           }});
    }
    for (const auto& [prefix, pose] : {std::pair("pose_", &PhotoSummary::camera_from_marker),
                                       {"refined_pose_", &PhotoSummary::refined_from_marker}})
        for (int i = 0;
             const char* end : {"x_mm", "y_mm", "z_mm", "rx_mrad", "ry_mrad", "rz_mrad"}) {
            const auto of = pose;
            columns.push_back({std::string(prefix) + end, [=](const PhotoPair& pair) -> TableCell {
                                   const auto &before = pair.earlier.*of, &after = pair.now.*of;
                                   return before && after ? pose_change(*before, *after)[i]
                                                          : TableCell();
                               }});
            ++i;
        }
    return csv_of(table_of(columns, change.pairs));
}

}  // namespace etalon
