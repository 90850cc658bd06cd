#include "station/compare/compare_baseline.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tuple>

#include "compare/pose/pose_bias.h"
#include "core/config/strict_reader.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

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

// What is compared of a pair of photographs: then and now; nothing where one of them has none.
struct Quantity {
    std::string key, name, unit;  // the key is of files
    std::function<std::optional<std::pair<double, double>>(const PhotoPair&)> then_and_now;
    std::optional<double> PhotoSummary::*figure = nullptr;  // null of a pose's component
};

std::vector<Quantity> all_quantities() {
    std::vector<Quantity> all;
    for (const auto& [key, name, unit, figure] :
         {std::tuple("residual_gray", "residual", "gray", &PhotoSummary::residual_gray),
          std::tuple("refined_residual_gray", "residual, refined pose", "gray",
                     &PhotoSummary::refined_residual_gray),
          std::tuple("edge_shift_px", "edge shift", "px", &PhotoSummary::edge_shift_px),
          std::tuple("refined_edge_shift_px", "edge shift, refined pose", "px",
                     &PhotoSummary::refined_edge_shift_px),
          std::tuple("psf_sigma_px", "fitted blur", "px", &PhotoSummary::psf_sigma_px)})
        all.push_back({key, name, unit,
                       [figure = figure](const PhotoPair& pair) {
                           const auto &then = pair.earlier.*figure, &now = pair.now.*figure;
                           return then && now ? std::optional(std::pair(*then, *now))
                                              : std::nullopt;
                       },
                       figure});
    // Of a pose only the change has a meaning: it counts from 0.
    for (const auto& [prefix, name, pose] :
         {std::tuple("pose_", "pose", &PhotoSummary::camera_from_marker),
          std::tuple("refined_pose_", "refined pose", &PhotoSummary::refined_from_marker)})
        for (int i = 0; const std::string component : {"x", "y", "z", "rx", "ry", "rz"}) {
            const std::string unit = i < 3 ? "mm" : "mrad";
            all.push_back({prefix + component + "_" + unit, name + (" " + component), unit,
                           [pose = pose, i](const PhotoPair& pair) {
                               const auto &then = pair.earlier.*pose, &now = pair.now.*pose;
                               return then && now ? std::optional(
                                                        std::pair(0.0, pose_change(*then, *now)[i]))
                                                  : std::nullopt;
                           }});
            ++i;
        }
    return all;
}

std::vector<PairedChange> paired_changes(const std::vector<PhotoPair>& pairs) {
    std::vector<PairedChange> changes;
    std::vector<double> squares;  // of the deviations from the mean change
    for (const Quantity& quantity : all_quantities()) {
        PairedChange change{quantity.name, quantity.unit};
        std::vector<double> differences;
        for (const PhotoPair& pair : pairs)
            if (const auto values = quantity.then_and_now(pair)) {
                ++change.pairs;
                change.earlier += values->first;
                change.now += values->second;
                differences.push_back(values->second - values->first);
            }
        if (differences.empty())
            continue;
        change.earlier /= change.pairs;
        change.now /= change.pairs;
        change.mean = change.now - change.earlier;
        squares.push_back(0.0);
        for (const double difference : differences)
            squares.back() += std::pow(difference - change.mean, 2);
        changes.push_back(change);
    }
    // Bonferroni: each interval misses with a probability of (1 - confidence) / quantities at most.
    const double tail = 0.5 * (1.0 - baseline_confidence) / static_cast<double>(changes.size());
    for (std::size_t i = 0; i < changes.size(); ++i)
        if (const double n = changes[i].pairs; n > 1)
            changes[i].half_width = student_t_quantile(tail, changes[i].pairs - 1) *
                                    std::sqrt(squares[i] / (n - 1.0) / n);
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
    for (const Quantity& quantity : all_quantities()) {
        const auto figure = quantity.figure;
        if (figure) {
            columns.push_back({quantity.key + "_earlier",
                               [figure](const PhotoPair& pair) { return pair.earlier.*figure; }});
            columns.push_back({quantity.key + "_now",
                               [figure](const PhotoPair& pair) { return pair.now.*figure; }});
        }
        columns.push_back({quantity.key + (figure ? "_change" : ""),
                           [quantity](const PhotoPair& pair) -> TableCell {
                               const auto values = quantity.then_and_now(pair);
                               return values ? TableCell(values->second - values->first)
                                             : TableCell();
                           }});
    }
    return csv_of(table_of(columns, change.pairs));
}

}  // namespace etalon
