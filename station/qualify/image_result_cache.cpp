#include "station/qualify/image_result_cache.h"

#include <fmt/format.h>

#include <limits>

#include "core/config/json_entry.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "station/record/record_json.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

constexpr const char* pixels_file = "pixels.jsonl";

// ---- as JSON: numbers are written so that they are read back to the bit

RecordJson kept_points(const std::vector<Eigen::Vector2d>& points) {
    return json_list(points, [](const Eigen::Vector2d& point) { return numbers_json(point); });
}

RecordJson kept_rigid(const Rigid& rigid) {
    return {{"rotation", numbers_json(rigid.rotation.coeffs())},
            {"translation", numbers_json(rigid.translation)}};
}

template <class Type, class Function>
RecordJson kept_optional(const std::optional<Type>& value, Function json_of) {
    return value ? json_of(*value) : RecordJson();
}

constexpr double PhotoEvidence::*pixel_numbers[] = {&PhotoEvidence::depth_mm,
                                                    &PhotoEvidence::loss,
                                                    &PhotoEvidence::residual_scale,
                                                    &PhotoEvidence::squares,
                                                    &PhotoEvidence::noise_gray,
                                                    &PhotoEvidence::contrast_gray,
                                                    &PhotoEvidence::background_by_tone_gray};
constexpr std::optional<double> PhotoEvidence::*pixel_options[] = {
    &PhotoEvidence::noise_ratio, &PhotoEvidence::black_gray, &PhotoEvidence::background_gray};

RecordJson kept_photo(const PhotoEvidence& photo) {
    RecordJson numbers = RecordJson::array(), options = RecordJson::array();
    for (const auto number : pixel_numbers)
        numbers.push_back(photo.*number);
    for (const auto option : pixel_options)
        options.push_back(optional_number(photo.*option));
    return {{"information", numbers_json(photo.information)},
            {"score", numbers_json(photo.score)},
            {"score_by_log_noise", numbers_json(photo.score_by_log_noise)},
            {"largest_change", numbers_json(photo.largest_change)},
            {"shading", numbers_json(photo.shading)},
            {"pixels", photo.pixels},
            {"numbers", numbers},
            {"options", options}};
}

RecordJson kept_finding(const PhotoFinding& finding) {
    return {finding.name, finding.sentence};
}

RecordJson kept_pose_pixels(const ImageResultCache& pose) {
    const auto reading_json = [](const PhotometricReading& reading) -> RecordJson {
        return {{"pose", kept_rigid(reading.camera_from_marker)},
                {"covariance", numbers_json(reading.covariance)}};
    };
    return {{"reading", kept_optional(pose.reading, reading_json)},
            {"seen_at", kept_optional(pose.seen_at, kept_rigid)},
            {"detector_bias_px", kept_points(pose.detector_bias_px)},
            {"refusal", pose.refusal},
            {"compared_at", kept_rigid(pose.compared_at)},
            {"photo", kept_optional(pose.pixels, kept_photo)},
            {"findings", json_list(pose.findings, kept_finding)}};
}

RecordJson kept_frame(const FrameRecord& frame) {
    return {{"corners", kept_points(frame.corners)}, {"detection", frame.detection}};
}

// ---- and back

template <class Matrix>
void read_kept(const JsonEntry& entry, Matrix& matrix) {
    const std::vector<double> numbers = entry.numbers(static_cast<std::size_t>(matrix.size()));
    std::ranges::copy(numbers, matrix.data());
}

std::vector<Eigen::Vector2d> read_kept_points(const JsonEntry& list) {
    std::vector<Eigen::Vector2d> points;
    for (const JsonEntry& item : list.items())
        read_kept(item, points.emplace_back());
    return points;
}

Rigid read_kept_rigid(const JsonEntry& entry) {
    Rigid rigid;
    read_kept(entry.at("rotation"), rigid.rotation.coeffs());
    read_kept(entry.at("translation"), rigid.translation);
    return rigid;
}

PhotometricReading read_kept_reading(const JsonEntry& entry) {
    PhotometricReading reading;
    reading.camera_from_marker = read_kept_rigid(entry.at("pose"));
    read_kept(entry.at("covariance"), reading.covariance);
    return reading;
}

PhotoEvidence read_kept_photo(const JsonEntry& entry) {
    PhotoEvidence photo;
    read_kept(entry.at("information"), photo.information);
    read_kept(entry.at("score"), photo.score);
    read_kept(entry.at("score_by_log_noise"), photo.score_by_log_noise);
    read_kept(entry.at("largest_change"), photo.largest_change);
    read_kept(entry.at("shading"), photo.shading);
    photo.pixels = static_cast<int>(entry.at("pixels").integer(0, std::numeric_limits<int>::max()));
    const auto numbers = entry.at("numbers").numbers(std::size(pixel_numbers));
    for (std::size_t i = 0; i < numbers.size(); ++i)
        photo.*pixel_numbers[i] = numbers[i];
    const auto options = entry.at("options").items();
    if (options.size() != std::size(pixel_options))
        entry.fail("has other options");
    for (std::size_t i = 0; i < options.size(); ++i)
        if (!options[i].is_null())
            photo.*pixel_options[i] = options[i].number();
    return photo;
}

ImageResultCache read_kept_pose_pixels(const JsonEntry& entry) {
    ImageResultCache pose;
    if (const JsonEntry reading = entry.at("reading"); !reading.is_null())
        pose.reading = read_kept_reading(reading);
    if (const JsonEntry seen_at = entry.at("seen_at"); !seen_at.is_null())
        pose.seen_at = read_kept_rigid(seen_at);
    pose.detector_bias_px = read_kept_points(entry.at("detector_bias_px"));
    pose.refusal = entry.at("refusal").text();
    pose.compared_at = read_kept_rigid(entry.at("compared_at"));
    if (const JsonEntry photo = entry.at("photo"); !photo.is_null())
        pose.pixels = read_kept_photo(photo);
    for (const JsonEntry& finding : entry.at("findings").items()) {
        const std::vector<JsonEntry> words = finding.items();
        if (words.size() != 2)
            finding.fail("is no finding");
        pose.findings.push_back({words[0].text(), words[1].text()});
    }
    return pose;
}

// A line begins with what its content follows from and with that content's own hash: a disk that
// forgets must not change a result.
std::string line_start(const std::string& made_from, const std::string& content_hash) {
    return fmt::format(R"({{"made_from":"{}","sha256":"{}",)", made_from, content_hash);
}

void require_unharmed(const std::string& text, const JsonEntry& line) {
    const std::string hash = line.at("sha256").text();
    const std::string start = line_start(line.at("made_from").text(), hash);
    if (!text.starts_with(start) || sha256(std::string_view(text).substr(start.size())) != hash)
        line.fail("is not as it was written");
}

KeptPose read_kept_pose(const JsonEntry& line) {
    KeptPose pose;
    for (const JsonEntry& frame : line.at("frames").items())
        pose.frames.push_back(
            {read_kept_points(frame.at("corners")), frame.at("detection").text()});
    if (const JsonEntry pixels = line.at("pixels"); !pixels.is_null())
        pose.pixels = read_kept_pose_pixels(pixels);
    return pose;
}

// What a pose's pixels follow from.
std::string key_of(const VisitedPose& pose, const QualifyResult& run) {
    std::string all = program_fingerprint() + fmt::format("\n{} bit\n", run.settings.bits) +
                      (pose.hold_out ? "hold-out\n" : "training\n");
    for (const InputFile& input : run.station.inputs)
        all += input.role + " " + input.sha256 + "\n";
    for (const FrameRecord& frame : pose.frames)
        all += frame.file + " " + frame.sha256 + "\n";
    return sha256(all);
}

// Numbers of corners that a pose of this run can have.
bool fits(const KeptPose& kept, const VisitedPose& pose, const QualifyResult& run) {
    const std::size_t corners = run.station.marker.points_mm.size();
    const auto is_whole = [&](const auto& points) {
        return points.empty() || points.size() == corners;
    };
    return kept.frames.size() == pose.frames.size() &&
           std::ranges::all_of(kept.frames,
                               [&](const SeenFrame& f) { return is_whole(f.corners); }) &&
           (!kept.pixels || is_whole(kept.pixels->detector_bias_px));
}

}  // namespace

KeptPixels::KeptPixels(const QualifyResult& run) : run_(run) {
    const std::filesystem::path path = run.folder / pixels_file;
    std::ifstream file(path, std::ios::binary);
    int number = 0;
    for (std::string text; std::getline(file, text) && !file.eof();) {
        try {
            const JsonEntry line(text, {path.string(), ++number});
            require_unharmed(text, line);
            poses_.insert_or_assign(line.at("made_from").text(), read_kept_pose(line));
        } catch (const ConfigError&) {
            // found again
        }
    }
}

const KeptPose* KeptPixels::of(const VisitedPose& pose) const {
    const auto kept = poses_.find(key_of(pose, run_));
    return kept != poses_.end() && fits(kept->second, pose, run_) ? &kept->second : nullptr;
}

void KeptPixels::keep(const std::map<int, ImageResultCache>& by_index) const {
    if (std::ranges::all_of(run_.poses,
                            [&](const VisitedPose& pose) { return of(pose) != nullptr; }))
        return;
    std::string text;
    for (const VisitedPose& pose : run_.poses) {
        const auto pixels = by_index.find(pose.index);
        const RecordJson content{
            {"frames", json_list(pose.frames, kept_frame)},
            {"pixels", pixels == by_index.end() ? RecordJson() : kept_pose_pixels(pixels->second)}};
        const std::string rest = text_of(content, -1).substr(1);
        text += line_start(key_of(pose, run_), sha256(rest)) + rest + "\n";
    }
    try {
        write_text(run_.folder / pixels_file, text);
    } catch (const ConfigError&) {
        // a full disk
    }
}

}  // namespace etalon
