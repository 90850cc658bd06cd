// etalon.Station: a station.yaml, its devices, the main job, records; etalon.run_study.
#include "core/file/file_writing.h"
#include "python/arrays.h"
#include "python/devices.h"
#include "report/number_text.h"
#include "stage/axes/kinematics.h"
#include "station/qualify/runner.h"
#include "station/register/stage_registration.h"
#include "station/setup/station_lock.h"
#include "study/study_report.h"
#include "study/study_run.h"

namespace etalon {
namespace {

// What the record says, in Python's types.
py::object read_back(const std::filesystem::path& folder) {
    return py::module_::import("etalon.records").attr("read_record")(folder);
}

py::object qualify_station(const StationFile& station, const std::filesystem::path& out, bool homed,
                           bool progress) {
    interruptible([&](std::stop_token stop) {
        const StationLock held(station.stage, stage_holder("a qualification", ""));
        RunProgress shown(progress);
        return run_qualification(
            station, out, station_devices(station, homed, shown.clock(), shown.progress(), stop),
            shown.clock(), shown.progress(), stop);
    });
    return read_back(out);
}

py::object resume(const std::filesystem::path& record, bool homed, bool progress) {
    interruptible([&](std::stop_token stop) {
        const FolderLock lock(record);
        RunProgress shown(progress);
        const RecordedRun recorded = read_record(record, shown.progress(), stop);
        const StationLock held(recorded.result.station.stage, stage_holder("a qualification", ""));
        return resume_qualification(
            recorded,
            station_devices(recorded.result.station, homed, shown.clock(), shown.progress(), stop),
            shown.clock(), shown.progress(), stop);
    });
    return read_back(record);
}

py::object analyse(const std::filesystem::path& record, bool progress) {
    interruptible([&](std::stop_token stop) {
        const FolderLock lock(record);
        RunProgress shown(progress);
        return analyse_record(read_record(record, shown.progress(), stop), shown.progress(), stop);
    });
    return read_back(record);
}

StageRegistration registered(const StationFile& station, const std::vector<StagePhoto>& photos,
                             const std::string& detector, const std::stop_token& stop) {
    return register_photos(station, photos, detector.empty() ? station.detector : detector, stop);
}

StageRegistration register_positions(const StationFile& station, const std::filesystem::path& csv,
                                     const std::string& detector) {
    return interruptible([&](std::stop_token stop) {
        return registered(station, read_stage_photos(csv, station.stage.axes), detector, stop);
    });
}

StageRegistration register_record(const std::filesystem::path& record,
                                  const std::string& detector) {
    return interruptible([&](std::stop_token stop) {
        const StationFile station = read_station(station_of_record(record));
        return registered(station, read_record_photos(record, station.stage.axes), detector, stop);
    });
}

py::list badly_determined(const StageRegistration& result) {
    py::list all;
    for (const PoorlyConstrainedDirection& weak : result.registration.weak)
        all.append(py::dict("name"_a = weak.name, "deviation"_a = result.scale * weak.deviation,
                            "unit"_a = weak.is_shift() ? "mm" : "rad"));
    return all;
}

py::list photos(const StageRegistration& result) {
    py::list all;
    for (const RegisteredPhoto& photo : result.photos)
        all.append(
            py::dict("photo"_a = photo.photo.string(), "failure"_a = photo.failure,
                     "difference_mm"_a = array_of(numbers_of(photo.residual.translation_mm)),
                     "difference_rad"_a = array_of(numbers_of(photo.residual.rotation_rad))));
    return all;
}

NumberArray registration_covariance(const StageRegistration& result) {
    return array_of(Eigen::MatrixXd(result.scale * result.scale * result.registration.covariance));
}

void bind_registration(Module& module) {
    Bound<StageRegistration>(module, "StageRegistration",
                             "Where a stage stands before the camera, and the marker on it.")
        .get("camera_from_base", "(4, 4), mm.",
             [](const StageRegistration& r) { return array_of(r.registration.camera_from_base); })
        .get("carriage_from_marker", "(4, 4), mm.",
             [](const StageRegistration& r) {
                 return array_of(r.registration.carriage_from_marker);
             })
        .get("deviations",
             "(12,): standard deviations of the two, each rotation (rad), then translation (mm).",
             [](const StageRegistration& r) { return array_of(numbers_of(r.deviations)); })
        .get("covariance", "(12, 12), in the same order.", &registration_covariance)
        .get("freedoms", "Directions that no motion of the stage can tell, by name.",
             [](const StageRegistration& r) {
                 std::vector<std::string> names;
                 for (const GaugeFreedom& freedom : r.registration.freedoms)
                     names.push_back(freedom.name);
                 return names;
             })
        .get("badly_determined", "Directions that the poses hardly tell: name, deviation, unit.",
             &badly_determined)
        .get("photos", "Of each: photo, failure, difference_mm (3,), difference_rad (3,).", &photos)
        .get("used", "Number of photographs that took part.", &StageRegistration::used)
        .get("detector", "apriltag, photometric, ...", &StageRegistration::detector)
        .get("residual_rms_px", "Over the coordinates of the corners; 0 of photometric poses.",
             [](const StageRegistration& r) { return r.registration.residual_rms_px; });
    module.def("register_record", &register_record, "record"_a, "detector"_a = "",
               R"(A StageRegistration from the photographs and positions of a run's record.

detector: "" takes the station's; "photometric" weighs each pose by its covariance. Raises
ConfigError, and NumericalError for poses that do not tell.)");
}

py::dict plan(const StationFile& station) {
    const Plan plan = without_gil([&] { return plan_of(station); });
    const auto axes = static_cast<py::ssize_t>(station.stage.axes.size());
    NumberArray targets({static_cast<py::ssize_t>(plan.poses.size()), axes});
    py::array_t<bool> hold_out(static_cast<py::ssize_t>(plan.poses.size()));
    double* target = targets.mutable_data();
    bool* held = hold_out.mutable_data();
    for (const PlannedPose& pose : plan.poses) {
        target = std::copy(pose.target.begin(), pose.target.end(), target);
        *held++ = pose.hold_out;
    }
    return py::dict(
        "targets"_a = targets, "hold_out"_a = hold_out,
        "expected_duration_s"_a = std::chrono::duration<double>(plan.expected_duration).count());
}

std::unique_ptr<SharedCamera> open_station_camera(const StationFile& station) {
    auto camera = std::make_unique<SharedCamera>(station.camera.uri, station.camera.link);
    configured(*camera, station.camera.settings);
    return camera;
}

NumberArray carriage_at(const StationFile& station, const py::object& positions) {
    return array_of(base_from_carriage(station.stage.axes, number_list(positions, "positions")));
}

StationFile read_file(const std::filesystem::path& path) {
    return without_gil([&] { return read_station(path); });
}

py::object study_to(const std::filesystem::path& file, const std::filesystem::path& out,
                    const std::vector<std::string>& ablate, bool progress) {
    run_interruptibly([&](std::stop_token stop) {
        const StudyFile study = read_study(file);
        const Shard all;
        const StudyOptics optics(study, study_variants(study, ablate));
        StudyRecord record(out, describe(study, file, optics.variants(), all));
        RunProgress shown(progress);
        if (!run_study(optics, all, record, stop, shown.progress()).complete)
            throw Interrupted();
        const StudyResults results = read_results(out);
        write_study_report(results, summarise(results), out);
    });
    return py::module_::import("etalon.records").attr("read_results")(out);
}

}  // namespace

void bind_station(Module& module) {
    bind_registration(module);
    Bound<StationFile>(module, "Station",
                       "A camera, a stage and what they are to be told: station.yaml.")
        .init(&read_file, "path"_a,
              "Reads station.yaml; touches no device. Raises ConfigError with file, line and key.")
        .get("id", "Names the station in records.", &StationFile::id)
        .get("marker", "The Marker on the stage.", &StationFile::marker)
        .get("camera", "The calibration under test, a Camera.",
             [](const StationFile& station) { return Projector(station.camera.model); })
        .get("axes", "Dicts of name, kind, unit, low, high, speed; mm or rad.",
             [](const StationFile& station) { return axes_list(station.stage.axes); })
        .def("plan", &plan,
             "Where a run goes: targets (P, A), hold_out (P,) bool, expected_duration_s.")
        .def("base_from_carriage", &carriage_at, "positions"_a,
             "(4, 4), mm, at positions (A,), mm or rad.")
        .def("open_camera", &open_station_camera,
             "The CameraDevice with the station's settings, ready. Raises DeviceError.")
        .def(
            "open_stage",
            [](const StationFile& station, bool homed) {
                return std::make_unique<SharedStage>(station.stage, homed);
            },
            "homed"_a = false,
            R"(The Stage, with all rules of the file. Nothing moves yet.

homed: true confirms that the axes stand at their zero, for controllers that do not tell. Raises
DeviceError.)")
        .def("qualify", &qualify_station, "out"_a, py::kw_only(), "homed"_a = false,
             "progress"_a = false,
             R"(The whole job: plan, motion, capture, detection, comparison, verdict.

out: new folder for the record. Returns what read_record() does: outcome is PASS, FAIL, INCONCLUSIVE
or, with its reason, ERROR. progress: to stderr. Raises ConfigError and DeviceError before anything
moved. Ctrl-C stops the axes, and what was measured is kept.)")
        .def("register_photos", &register_positions, "positions"_a, "detector"_a = "",
             R"(A StageRegistration from photographs at known positions.

positions: CSV with `photo` and a column for each axis, x_mm, rz_deg, ... Raises ConfigError and
NumericalError.)")
        .def("__repr__",
             [](const StationFile& station) { return "<etalon.Station " + station.id + ">"; });
    module.def("analyse_record", &analyse, "record"_a, py::kw_only(), "progress"_a = false,
               R"(Analyses a run's record again and replaces its results; as read_record() after it.

Raises ConfigError for a record that is not what a run wrote.)");
    module.def("resume_record", &resume, "record"_a, py::kw_only(), "homed"_a = false,
               "progress"_a = false, R"(Resumes an unfinished run; as Station.qualify().)");
}

void bind_study(Module& module) {
    module.def(
        "run_study", &study_to, "study"_a, "out"_a, py::kw_only(),
        "ablate"_a = std::vector<std::string>(), "progress"_a = false,
        R"(Compares detectors on rendered poses: study.yaml in, results and report in the folder out.

ablate: also with each of these switched: tone, half-pixel, noise, blur, undistortion. Returns what
read_results() does. Ctrl-C keeps what is done; the same call goes on. Raises ConfigError.)");
}

}  // namespace etalon
