#include "station/qualify/image_result_cache.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "station/record/run_record.h"

// Written and read back to the bit.
namespace nlohmann {

template <int Rows, int Columns>
struct adl_serializer<Eigen::Matrix<double, Rows, Columns>> {
    using Matrix = Eigen::Matrix<double, Rows, Columns>;
    static void to_json(json& json, const Matrix& matrix) {
        json = std::vector<double>(matrix.data(), matrix.data() + matrix.size());
    }
    static void from_json(const json& json, Matrix& matrix) {
        for (Eigen::Index i = 0; i < matrix.size(); ++i)
            matrix.data()[i] = json.at(static_cast<std::size_t>(i));
    }
};

template <class Value>
struct adl_serializer<std::optional<Value>> {
    static void to_json(json& json, const std::optional<Value>& value) {
        if (value)
            json = *value;
    }
    static void from_json(const json& json, std::optional<Value>& value) {
        if (!json.is_null())
            json.get_to(value.emplace());
    }
};

}  // namespace nlohmann

namespace etalon {

using nlohmann::json;

void to_json(json& json, const Rigid& rigid) {
    json = {rigid.rotation.coeffs(), rigid.translation};
}
void from_json(const json& json, Rigid& rigid) {
    json.at(0).get_to(rigid.rotation.coeffs());
    json.at(1).get_to(rigid.translation);
}
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PhotometricReading, camera_from_marker, covariance)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PhotoFinding, name, sentence)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PhotoEvidence, depth_mm, information, score, score_by_log_noise,
                                   largest_change, loss, residual_scale, pixels, squares,
                                   noise_gray, noise_ratio, contrast_gray, black_gray, shading,
                                   background_gray, background_by_tone_gray)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ImageResultCache, reading, seen_at, detector_bias_px, refusal,
                                   compared_at, pixels, findings)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(SeenFrame, corners, detection)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(KeptPose, frames, pixels)

namespace {

constexpr const char* pixels_file = "pixels.jsonl";

// Its sources and its content's own hash: a disk that forgets must not change a result.
std::string line_start(const std::string& made_from, const std::string& content_hash) {
    return fmt::format(R"({{"made_from":"{}","sha256":"{}",)", made_from, content_hash);
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
    std::ifstream file(run.folder / pixels_file, std::ios::binary);
    for (std::string text; std::getline(file, text) && !file.eof();) {
        try {
            const json line = json::parse(text);
            const std::string made_from = line.at("made_from"), hash = line.at("sha256");
            const std::string start = line_start(made_from, hash);
            if (text.starts_with(start) && sha256(text.substr(start.size())) == hash)
                poses_[made_from] = line.get<KeptPose>();
        } catch (const json::exception&) {
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
        KeptPose kept;
        for (const FrameRecord& frame : pose.frames)
            kept.frames.push_back({frame.corners, frame.detection});
        if (const auto pixels = by_index.find(pose.index); pixels != by_index.end())
            kept.pixels = pixels->second;
        const std::string rest =
            json(kept).dump(-1, ' ', false, json::error_handler_t::replace).substr(1);
        text += line_start(key_of(pose, run_), sha256(rest)) + rest + "\n";
    }
    try {
        write_text(run_.folder / pixels_file, text);
    } catch (const ConfigError&) {
        // a full disk
    }
}

}  // namespace etalon
