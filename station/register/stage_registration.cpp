#include "station/register/stage_registration.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calib/registration/stage_motion.h"
#include "compare/expect/expected_view.h"
#include "compare/make_detector.h"
#include "compare/photo_pose.h"
#include "compare/photometric/photometric_detector.h"
#include "core/config/csv_file.h"
#include "core/file/sha256.h"
#include "report/json_text.h"
#include "stage/axes/kinematics.h"
#include "station/setup/stage_terms.h"

namespace etalon {
namespace {

// Of the column `photo`, taken as it stands, and one for each axis: `prefix` and its name.
std::vector<StagePhoto> read_rows(const CsvFile& file, const std::string& photo,
                                  const std::string& prefix, const std::vector<Axis>& axes) {
    const std::size_t photo_column = file.column(photo);
    std::vector<std::size_t> columns;
    for (const Axis& axis : axes)
        columns.push_back(file.column(prefix + AxisUnits(axis.kind).mm_key(axis.name)));
    std::vector<StagePhoto> photos;
    for (const CsvRow& row : file.rows) {
        photos.push_back({row.cells[photo_column], {}});
        for (std::size_t i = 0; i < axes.size(); ++i) {
            const AxisUnits units(axes[i].kind);
            photos.back().positions.push_back(row.number(columns[i], units.large().either_sign()) *
                                              units.per_large());
        }
    }
    if (photos.empty())
        throw ConfigError(file.place, "no photograph is listed");
    return photos;
}

// Of pose `number`; empty when none is whole.
std::filesystem::path first_frame(const std::filesystem::path& record, const std::string& number) {
    constexpr int max_frames = 1000;
    for (int frame = 0; frame < max_frames; ++frame) {
        const auto path = record / "frames" / fmt::format("{:0>4}_{}.png", number, frame);
        std::error_code ignored;
        if (std::filesystem::is_regular_file(path, ignored))
            return path;
    }
    return {};
}

// One photograph with what was found in it.
struct Sighting {
    std::size_t index;  // in the photographs given
    Rigid base_from_carriage;
    PhotoPose found;
    CodeImage image;
};

std::vector<Sighting> sightings(const StationFile& station, const std::vector<StagePhoto>& photos,
                                Detector& detector, const Projector& projector,
                                const std::stop_token& stop,
                                std::vector<RegisteredPhoto>& results) {
    std::vector<Sighting> seen;
    const std::filesystem::path calibration =
        station.inputs.size() > 1 ? station.inputs[1].path : std::filesystem::path();
    for (std::size_t i = 0; i < photos.size(); ++i) {
        throw_if_stopped(stop);
        const CodeImage image = read_photo(photos[i].photo, station.camera.model, calibration);
        PhotoPose found =
            find_as_drawn(photos[i].photo, image, detector, projector, station.marker);
        if (found.estimate && !found.corners->is_whole()) {
            found.failure = "marker seen in part only";
            found.estimate.reset();
        }
        results.push_back({photos[i].photo, found.estimate ? "" : found.failure, {}});
        if (found.estimate)
            seen.push_back(
                {i, base_from_carriage(station.stage.axes, photos[i].positions), found, image});
    }
    return seen;
}

void require_full_motion(const std::vector<Sighting>& seen, const std::vector<Axis>& axes) {
    if (seen.empty())
        throw NumericalError("registration: the marker is seen in no photograph");
    std::vector<Rigid> plan;
    for (const Sighting& one : seen)
        plan.push_back(one.base_from_carriage);
    require_full_motion(plan, stage_reach(axes));
}

void register_corners(const StationFile& station, std::vector<Sighting>& seen,
                      const Projector& projector, const std::stop_token& stop,
                      StageRegistration& result) {
    std::vector<RegistrationPose> poses;
    for (const Sighting& one : seen)
        poses.push_back({one.base_from_carriage, one.found.estimate->camera_from_marker,
                         one.found.corners->pixels});
    const RenderedCorners rendered(expected_scene(station), station.plan.frames, station.plan.seed);
    const BiasCorrectedRegistration corrected = register_bias_corrected(
        projector, station.marker.points_mm, poses, station.carriage_from_marker_nominal,
        [&](const Rigid& camera_from_marker) {
            throw_if_stopped(stop);
            return rendered.at(camera_from_marker);
        });
    result.registration = corrected.registration;
    result.rounds = corrected.rounds;
    result.used = static_cast<int>(corrected.used.size());
    result.scale = std::sqrt(corrected.registration.reduced_squares);
}

// Replaces the estimates by photometric poses; a pose that is refused takes no part.
void register_photometric(const StationFile& station, std::vector<Sighting>& seen,
                          const std::stop_token& stop, StageRegistration& result) {
    const PhotometricDetector photometric(station.camera.model, station.marker,
                                          station.marker.spec);
    std::vector<MeasuredPose> poses;
    std::vector<Sighting> kept;
    for (Sighting& one : seen) {
        throw_if_stopped(stop);
        auto pose = attempted([&] {
            return photometric.find(one.image, one.found.estimate->camera_from_marker,
                                    PhotometricDetector::detector_error_px);
        });
        result.photos[one.index].failure = pose.cause;
        if (!pose)
            continue;
        one.found.estimate->camera_from_marker = pose->camera_from_marker;
        poses.push_back({one.base_from_carriage, pose->camera_from_marker, pose->covariance});
        kept.push_back(one);
    }
    seen = kept;
    require_full_motion(seen, station.stage.axes);
    result.registration = register_stage_on_poses(poses, station.carriage_from_marker_nominal);
    result.used = static_cast<int>(poses.size());
    result.scale = std::sqrt(std::max(1.0, result.registration.reduced_squares));
}

}  // namespace

std::filesystem::path station_of_record(const std::filesystem::path& record) {
    const std::filesystem::path file = record / "run.json";
    const Json run = read_json(file);
    const auto text_at = [](const Json& object, const char* key) {
        const bool is_text = object.is_object() && object.contains(key) && object[key].is_string();
        return is_text ? object[key].get<std::string>() : "";
    };
    if (run.is_object() && run.contains("inputs"))
        for (const auto& input : run["inputs"]) {
            if (text_at(input, "role") != "station")
                continue;
            const std::string copy = text_at(input, "copy");
            const std::filesystem::path path =
                copy.empty() ? std::filesystem::path(text_at(input, "path")) : record / copy;
            if (sha256_of_file(path) != text_at(input, "sha256"))
                throw ConfigError({path.string()}, "is not the station file of this run any more");
            return path;
        }
    throw ConfigError({file.string()}, "names no station file");
}

std::vector<StagePhoto> read_stage_photos(const std::filesystem::path& csv,
                                          const std::vector<Axis>& axes) {
    const CsvFile file = read_csv(csv);
    if (file.header.size() > axes.size() + 1)
        throw ConfigError(
            file.place,
            fmt::format("must have `photo` and one column for each of {} axes", axes.size()));
    std::vector<StagePhoto> photos = read_rows(file, "photo", "", axes);
    for (StagePhoto& photo : photos) {
        require_within_limits(axes, photo.positions, {csv.string()});
        photo.photo = csv.parent_path() / photo.photo;
    }
    return photos;
}

std::vector<StagePhoto> read_record_photos(const std::filesystem::path& record,
                                           const std::vector<Axis>& axes) {
    const CsvFile file = read_csv(record / "poses.csv");
    std::vector<StagePhoto> photos;
    for (StagePhoto& row : read_rows(file, "pose", "read_back_", axes)) {
        row.photo = first_frame(record, row.photo.string());
        if (!row.photo.empty())
            photos.push_back(row);
    }
    return photos;
}

StageRegistration register_photos(const StationFile& station, const std::vector<StagePhoto>& photos,
                                  const std::string& detector, const std::stop_token& stop) {
    const bool photometric = detector == "photometric";
    const auto corners =
        make_detector(photometric ? "auto" : detector, station.marker, "--detector");
    const Projector projector(station.camera.model);
    StageRegistration result;
    result.detector = photometric ? detector : corners->name();
    std::vector<Sighting> seen =
        sightings(station, photos, *corners, projector, stop, result.photos);
    require_full_motion(seen, station.stage.axes);
    if (photometric)
        register_photometric(station, seen, stop, result);
    else
        register_corners(station, seen, projector, stop, result);
    result.deviations = result.scale * result.registration.covariance.diagonal().cwiseSqrt();
    for (const Sighting& one : seen)
        result.photos[one.index].residual =
            pose_error(one.found.estimate->camera_from_marker,
                       result.registration.camera_from_marker(one.base_from_carriage));
    return result;
}

}  // namespace etalon
