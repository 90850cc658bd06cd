#include "study/study_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/camera_file.h"
#include "compare/detect/detector_adaptors.h"
#include "compare/make_detector.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "sim/scene/pose_file.h"

namespace etalon {

const std::vector<std::string>& study_switch_names() {
    static const std::vector<std::string> names = {"tone", "half-pixel", "noise", "blur",
                                                   "undistortion"};
    return names;
}

std::string name_of(StudySwitch one) {
    return study_switch_names().at(static_cast<std::size_t>(one));
}

StudySwitch parse_study_switch(const std::string& name, const SourcePlace& place) {
    const std::vector<std::string>& names = study_switch_names();
    const auto at = std::ranges::find(names, name);
    if (at == names.end())
        throw ConfigError(place,
                          fmt::format("there is no switch '{}': {}", name, fmt::join(names, ", ")));
    return static_cast<StudySwitch>(at - names.begin());
}

void toggle(StudySwitches& switches, StudySwitch one) {
    if (switches.erase(one) == 0)
        switches.insert(one);
}

CameraModel imaging_camera(const CameraModel& camera, const StudySwitches& switches,
                           const SourcePlace& place) {
    CameraModel result = camera;
    if (switches.contains(StudySwitch::tone)) {
        if (!result.sensor)
            result.sensor = Sensor{.pixel_pitch_um = 1.0};
        const bool is_linear = result.sensor->transfer.kind == Transfer::Kind::linear;
        result.sensor->transfer = {is_linear ? Transfer::Kind::rec709 : Transfer::Kind::linear, {}};
    }
    if (switches.contains(StudySwitch::noise)) {
        if (!result.sensor || result.sensor->gain_e_per_dn <= 0.0)
            throw ConfigError(place, "noise cannot be switched: the camera states none");
        result.sensor->gain_e_per_dn = result.sensor->read_noise_e = 0.0;
    }
    if (switches.contains(StudySwitch::blur)) {
        if (!result.lens)
            throw ConfigError(place, "blur cannot be switched: the camera states no lens");
        result.lens.reset();
    }
    return result;
}

CameraModel estimation_camera(const CameraModel& camera, const StudySwitches& switches) {
    CameraModel result = camera;
    if (switches.contains(StudySwitch::undistortion))
        result.distortion = {};
    return result;
}

namespace {

constexpr int max_poses = 10'000'000;

// [low, high], or one number that is both.
Interval read_interval(const Value& value, Range range, double unit = 1.0) {
    if (value.is_scalar()) {
        const double fixed = value.number(range) * unit;
        return {fixed, fixed};
    }
    const auto ends = value.numbers(2, range);
    if (ends[0] > ends[1])
        value.fail(fmt::format("must be [low, high], not [{}, {}]", ends[0], ends[1]));
    return {ends[0] * unit, ends[1] * unit};
}

Interval read_angle(const Value& poses, const char* key) {
    const auto value = poses.find(key);
    return value ? read_interval(*value, {-360.0, 360.0}, rad_per_deg) : Interval{0.0, 0.0};
}

PoseVolume read_volume(const Value& poses) {
    PoseVolume volume;
    if (const auto x = poses.find("x_mm"))
        volume.x_mm = read_interval(*x, units::mm.either_sign());
    if (const auto y = poses.find("y_mm"))
        volume.y_mm = read_interval(*y, units::mm.either_sign());
    volume.z_mm = read_interval(poses.at("z_mm"), units::mm.positive());
    volume.roll = read_angle(poses, "roll_deg");
    volume.pitch = read_angle(poses, "pitch_deg");
    volume.yaw = read_angle(poses, "yaw_deg");
    if (const auto margin = poses.find("margin_px"))
        volume.margin_px = margin->number(units::px.non_negative());
    return volume;
}

SequenceKind read_sequence(const Value& poses) {
    const auto value = poses.find("sequence");
    const std::string name = value ? value->one_of({"halton", "halton-faure", "sobol"}) : "halton";
    return name == "sobol"          ? SequenceKind::sobol
           : name == "halton-faure" ? SequenceKind::halton_faure
                                    : SequenceKind::halton;
}

StudyPoses read_study_poses(const StrictFile& file, const Value& section) {
    StudyPoses poses;
    if (const auto seed = section.find("seed"))
        poses.seed = static_cast<std::uint64_t>(seed->integer(0, std::numeric_limits<int>::max()));
    if (const auto listed = section.find("file")) {
        poses.file = file.resolve(listed->text());
        poses.listed = read_poses(poses.file);
        poses.count = static_cast<int>(poses.listed.size());
        return poses;
    }
    poses.count = section.at("count").integer(1, max_poses);
    poses.volume = read_volume(section);
    poses.sequence = read_sequence(section);
    return poses;
}

ArucoOptions read_aruco_options(const Value& entry) {
    const std::map<std::string, ArucoRefinement> refinements = {
        {"none", ArucoRefinement::none},
        {"subpixel", ArucoRefinement::subpixel},
        {"contour", ArucoRefinement::contour},
        {"apriltag", ArucoRefinement::apriltag}};
    ArucoOptions options;
    if (const auto name = entry.find("refinement"))
        options.refinement =
            refinements.at(name->one_of({"none", "subpixel", "contour", "apriltag"}));
    if (const auto window = entry.find("half_window_px"))
        options.subpixel_half_window_px = window->integer(1, 30);
    return options;
}

ApriltagOptions read_apriltag_options(const Value& entry) {
    ApriltagOptions options;
    if (const auto decimate = entry.find("decimate"))
        options.quad_decimate = decimate->number({1.0, 8.0});
    if (const auto refine = entry.find("refine_edges"))
        options.refine_edges = refine->flag();
    return options;
}

void read_finder(const Value& entry, StudiedDetector& studied) {
    const Marker& marker = studied.marker;
    const std::string name = studied.detector == "photometric" ? "auto" : studied.detector;
    const auto is = [&](const char* detector, Marker::Kind found) {
        return name == detector || (name == "auto" && marker.kind == found);
    };
    if (is("aruco", Marker::Kind::aruco))
        studied.make_finder = [marker, options = read_aruco_options(entry)] {
            return make_aruco_detector(marker, "", options);
        };
    else if (is("apriltag", Marker::Kind::apriltag))
        studied.make_finder = [marker, options = read_apriltag_options(entry)] {
            return make_apriltag_detector(marker, "", options);
        };
    else
        studied.make_finder = [marker, name] { return make_detector(name, marker, ""); };
    try {
        studied.make_finder();
    } catch (const ConfigError& error) {
        entry.fail(error.what());
    }
}

void read_command(const Value& entry, StudiedDetector& studied) {
    for (const Value& word : entry.at("command").items())
        studied.command.push_back(word.text());
    if (studied.command.empty())
        entry.at("command").fail("must name a program");
    const auto time_out = entry.find("time_out_ms");
    studied.time_out = std::chrono::milliseconds(time_out ? time_out->integer(1, 3'600'000) : 5000);
}

Marker read_marker(const Value& value) {
    try {
        return parse_marker(value.text(), "");
    } catch (const ConfigError& error) {
        value.fail(error.what());
    }
}

const std::vector<std::string>& studied_detector_names() {
    static const std::vector<std::string> names = {"aruco", "apriltag", "charuco",     "chessboard",
                                                   "stag",  "topotag",  "photometric", "external"};
    return names;
}

StudiedDetector read_detector(const Value& entry) {
    StudiedDetector studied{.marker = read_marker(entry.at("marker"))};
    studied.detector = entry.at("detector").text();
    if (std::ranges::count(studied_detector_names(), studied.detector) == 0)
        entry.at("detector")
            .fail(fmt::format("there is no detector '{}': {}", studied.detector,
                              fmt::join(studied_detector_names(), ", ")));
    const auto name = entry.find("name");
    studied.name = name ? name->text() : studied.detector;
    if (studied.name.empty() || studied.name.find_first_of("/\n\r") != std::string::npos)
        entry.fail("a name must not be empty, nor hold a slash or a line break: files have it");
    if (studied.detector == "external")
        read_command(entry, studied);
    else
        read_finder(entry, studied);
    return studied;
}

std::vector<StudiedDetector> read_detectors(const Value& list) {
    std::vector<StudiedDetector> detectors;
    for (const Value& entry : list.items()) {
        detectors.push_back(read_detector(entry));
        const std::string& name = detectors.back().name;
        if (std::ranges::count(detectors, name, &StudiedDetector::name) > 1)
            entry.fail(fmt::format("there are two detectors named '{}': give one a name", name));
    }
    if (detectors.empty())
        list.fail("a study needs a detector");
    return detectors;
}

const DisturbanceAxis* disturbance_axis(const std::string& name) {
    const auto* axis = std::ranges::find(disturbance_axes, name,
                                         [](const auto& a) { return std::string(a.name); });
    return axis == disturbance_axes.end() ? nullptr : axis;
}

void read_disturbances(const Value& section, StudyFile& study) {
    for (const std::string& name : section.keys()) {
        const Value value = *section.find(name);
        if (name == "focus-mm") {
            study.focus_mm = value.numbers(0, units::mm.positive());
            if (study.focus_mm.empty() || !study.camera.lens)
                value.fail(study.camera.lens ? "must name a distance"
                                             : "the camera states no lens that could be focused");
            continue;
        }
        const DisturbanceAxis* axis = disturbance_axis(name);
        if (!axis)
            value.fail("there is no such disturbance");
        study.disturbances.push_back({axis, read_interval(value, units::one.either_sign())});
        const Interval& values = study.disturbances.back().values;
        if (!axis->is_valid(values.low) || !axis->is_valid(values.high))
            value.fail(fmt::format("must lie within {} to {}", axis->least, axis->most));
    }
}

double read_radiance(const Value& root, const char* key) {
    const auto value = root.find(key);
    return value ? value->number({0.0, 1.0}) : 1.0;
}

}  // namespace

StudyFile read_study(const std::filesystem::path& path) {
    const StrictFile file(path, "study/1");
    const Value root = file.root();
    StudyFile study;
    study.id = root.at("id").text();
    study.camera_file = file.resolve(root.at("camera").text());
    study.camera = read_any_camera(study.camera_file);
    if (study.camera.projection.kind == Projection::telecentric)
        root.at("camera").fail("is telecentric: a distance is not in its images");
    study.background = read_radiance(root, "background");
    study.white_level = read_radiance(root, "white_level");
    study.poses = read_study_poses(file, root.at("poses"));
    study.detectors = read_detectors(root.at("detectors"));
    if (const auto disturbances = root.find("disturbances"))
        read_disturbances(*disturbances, study);
    if (const auto switched = root.find("switched"))
        for (const Value& name : switched->items())
            toggle(study.switched, parse_study_switch(name.text(), name.place()));
    file.finish();
    imaging_camera(study.camera, study.switched, root.place());
    return study;
}

}  // namespace etalon
