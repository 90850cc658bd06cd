#include "station/qualify/image_result_cache.h"

#include <fmt/format.h>

#include "core/config/json_entry.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "station/record/record_json.h"
#include "station/record/run_record.h"

namespace etalon {
namespace {

constexpr const char* pixels_file = "pixels.jsonl";

// ---- what is kept of each type, for writing and for reading

template <class Io>
void describe(Io& io, Rigid& rigid) {
    io("rotation", rigid.rotation.coeffs());
    io("translation", rigid.translation);
}

template <class Io>
void describe(Io& io, PhotometricReading& reading) {
    io("pose", reading.camera_from_marker);
    io("covariance", reading.covariance);
}

template <class Io>
void describe(Io& io, PhotoFinding& finding) {
    io("name", finding.name);
    io("sentence", finding.sentence);
}

template <class Io>
void describe(Io& io, PhotoEvidence& photo) {
    io("depth_mm", photo.depth_mm);
    io("information", photo.information);
    io("score", photo.score);
    io("score_by_log_noise", photo.score_by_log_noise);
    io("largest_change", photo.largest_change);
    io("loss", photo.loss);
    io("residual_scale", photo.residual_scale);
    io("pixels", photo.pixels);
    io("squares", photo.squares);
    io("noise_gray", photo.noise_gray);
    io("noise_ratio", photo.noise_ratio);
    io("contrast_gray", photo.contrast_gray);
    io("black_gray", photo.black_gray);
    io("shading", photo.shading);
    io("background_gray", photo.background_gray);
    io("background_by_tone_gray", photo.background_by_tone_gray);
}

template <class Io>
void describe(Io& io, ImageResultCache& pose) {
    io("reading", pose.reading);
    io("seen_at", pose.seen_at);
    io("detector_bias_px", pose.detector_bias_px);
    io("refusal", pose.refusal);
    io("compared_at", pose.compared_at);
    io("photo", pose.pixels);
    io("findings", pose.findings);
}

template <class Io>
void describe(Io& io, SeenFrame& frame) {
    io("corners", frame.corners);
    io("detection", frame.detection);
}

template <class Io>
void describe(Io& io, KeptPose& pose) {
    io("frames", pose.frames);
    io("pixels", pose.pixels);
}

// To JSON, to the bit.
class KeptWriter {
public:
    template <class Value>
    void operator()(const char* key, Value& value) {
        json_[key] = json_of(value);
    }
    template <class Described>
    static RecordJson json_of(Described& value) {
        KeptWriter writer;
        describe(writer, value);
        return writer.json_;
    }

private:
    static RecordJson json_of(int& number) { return number; }
    static RecordJson json_of(double& number) { return number; }
    static RecordJson json_of(std::string& text) { return text; }
    template <int Rows, int Columns>
    static RecordJson json_of(Eigen::Matrix<double, Rows, Columns>& matrix) {
        return numbers_json(matrix);
    }
    template <class Value>
    static RecordJson json_of(std::optional<Value>& value) {
        return value ? json_of(*value) : RecordJson();
    }
    template <class Value>
    static RecordJson json_of(std::vector<Value>& values) {
        RecordJson list = RecordJson::array();
        for (Value& value : values)
            list.push_back(json_of(value));
        return list;
    }

    RecordJson json_;
};

// And back.
class KeptReader {
public:
    explicit KeptReader(const JsonEntry& entry) : entry_(entry) {}

    template <class Value>
    void operator()(const char* key, Value& value) {
        read(entry_.at(key), value);
    }
    template <class Described>
    static void read(const JsonEntry& entry, Described& value) {
        KeptReader reader(entry);
        describe(reader, value);
    }

private:
    static void read(const JsonEntry& entry, int& number) {
        number = static_cast<int>(entry.integer(0, std::numeric_limits<int>::max()));
    }
    static void read(const JsonEntry& entry, double& number) { number = entry.number(); }
    static void read(const JsonEntry& entry, std::string& text) { text = entry.text(); }
    template <int Rows, int Columns>
    static void read(const JsonEntry& entry, Eigen::Matrix<double, Rows, Columns>& matrix) {
        std::ranges::copy(entry.numbers(Rows * Columns), matrix.data());
    }
    template <class Value>
    static void read(const JsonEntry& entry, std::optional<Value>& value) {
        if (!entry.is_null())
            read(entry, value.emplace());
    }
    template <class Value>
    static void read(const JsonEntry& list, std::vector<Value>& values) {
        for (const JsonEntry& item : list.items())
            read(item, values.emplace_back());
    }

    const JsonEntry& entry_;
};

// ---- lines of the file

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
            KeptPose pose;
            KeptReader::read(line, pose);
            poses_.insert_or_assign(line.at("made_from").text(), std::move(pose));
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
        KeptPose kept;
        for (const FrameRecord& frame : pose.frames)
            kept.frames.push_back({frame.corners, frame.detection});
        if (const auto pixels = by_index.find(pose.index); pixels != by_index.end())
            kept.pixels = pixels->second;
        const std::string rest = text_of(KeptWriter::json_of(kept), -1).substr(1);
        text += line_start(key_of(pose, run_), sha256(rest)) + rest + "\n";
    }
    try {
        write_text(run_.folder / pixels_file, text);
    } catch (const ConfigError&) {
        // a full disk
    }
}

}  // namespace etalon
