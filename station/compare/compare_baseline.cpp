#include "station/compare/compare_baseline.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "compare/pose/pose_bias.h"
#include "core/config/strict_reader.h"
#include "core/file/text.h"
#include "core/statistics/distributions.h"
#include "report/csv.h"

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
    for (const SummaryFigure& figure : summary_figures())
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

// ---- words ----------------------------------------------------------------------------------

std::string text_line(const PairedChange& change) {
    const std::string interval =
        change.half_width ? fmt::format("+- {:.4f}", *change.half_width) : "(one pair)";
    return fmt::format("  {:<26} {:+10.4f} {:<12} {}{}\n", change.quantity, change.mean, interval,
                       change.unit, change.changed() ? "  changed" : "");
}

std::string cells(const std::optional<double>& earlier, const std::optional<double>& now) {
    const auto cell = [](const std::optional<double>& value) {
        return value ? exact(*value) : std::string();
    };
    return "," + cell(earlier) + "," + cell(now) + "," +
           (earlier && now ? exact(*now - *earlier) : std::string());
}

std::string pose_cells(const std::optional<Rigid>& earlier, const std::optional<Rigid>& now) {
    if (!earlier || !now)
        return std::string(6, ',');
    std::string text;
    for (const double value : pose_change(*earlier, *now))
        text += "," + exact(value);
    return text;
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

const std::array<SummaryFigure, 5>& summary_figures() {
    static const std::array<SummaryFigure, 5> figures{{
        {"residual_gray", "residual", "gray", &PhotoSummary::residual_gray},
        {"refined_residual_gray", "residual, refined pose", "gray",
         &PhotoSummary::refined_residual_gray},
        {"edge_shift_px", "edge shift", "px", &PhotoSummary::edge_shift_px},
        {"refined_edge_shift_px", "edge shift, refined pose", "px",
         &PhotoSummary::refined_edge_shift_px},
        {"psf_sigma_px", "fitted blur", "px", &PhotoSummary::psf_sigma_px},
    }};
    return figures;
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

std::string baseline_text(const BaselineChange& change) {
    std::string text =
        fmt::format("since {}: {} photos paired\n", change.folder.string(), change.pairs.size());
    for (const auto& [what, names] :
         {std::pair("only now", &change.only_now), std::pair("only then", &change.only_earlier),
          std::pair("not paired, two of a name", &change.ambiguous)})
        if (!names->empty())
            text += fmt::format("  {}: {}\n", what, fmt::join(*names, ", "));
    for (const PairedChange& quantity : change.quantities)
        text += text_line(quantity);
    return text;
}

std::string baseline_csv(const BaselineChange& change) {
    std::string text = "photo,outcome_earlier,outcome_now";
    for (const SummaryFigure& figure : summary_figures())
        text += fmt::format(",{0}_earlier,{0}_now,{0}_change", figure.key);
    for (const char* pose : {"pose", "refined_pose"})
        text +=
            fmt::format(",{0}_x_mm,{0}_y_mm,{0}_z_mm,{0}_rx_mrad,{0}_ry_mrad,{0}_rz_mrad", pose);
    text += "\n";
    for (const auto& [earlier, now] : change.pairs) {
        text += csv_text(now.name) + "," + csv_text(earlier.outcome) + "," + csv_text(now.outcome);
        for (const SummaryFigure& figure : summary_figures())
            text += cells(earlier.*figure.value, now.*figure.value);
        text += pose_cells(earlier.camera_from_marker, now.camera_from_marker) +
                pose_cells(earlier.refined_from_marker, now.refined_from_marker) + "\n";
    }
    return text;
}

}  // namespace etalon
