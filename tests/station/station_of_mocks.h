// A whole station in process: the devices are mocks, the clock is virtual. The devices belong to
// the run, which destroys them: what they saw is copied out by the hooks.
#pragma once

#include <nlohmann/json.hpp>

#include "compare/expect/expected_view.h"
#include "stage/axes/kinematics.h"
#include "station/qualify/runner.h"
#include "tests/fakes/fake_camera.h"
#include "tests/fakes/fake_stage.h"
#include "tests/station/stations.h"

namespace etalon {

class StationOfMocks {
public:
    explicit StationOfMocks(const std::string& text = station_text)
        : station(read_station(write_station(folder, text))),
          null_(std::fopen("/dev/null", "w")),
          progress(null_, false, clock) {
        // The marker at the first pose alone: enough to go on, too little to analyse.
        picture = [this](const CaptureSettings&) {
            return carriage == first_target ? marked() : gray();
        };
    }
    ~StationOfMocks() { std::fclose(null_); }

    QualifyResult run() {
        return run_qualification(station, record(), openers(), clock, progress, stop.get_token());
    }
    RecordedRun read() { return read_record(record(), progress, stop.get_token()); }
    QualifyResult resume() {
        return resume_qualification(read(), openers(), clock, progress, stop.get_token());
    }
    std::filesystem::path record() const { return folder / "record"; }
    void stop_before(std::size_t move) {
        before_move = [this, move](std::size_t next) {
            if (next == move)
                stop.request_stop();
        };
    }

    static CodeImage gray() { return {cv::Mat(240, 320, CV_8UC1, cv::Scalar(130)), 8}; }
    // The station's marker in mid picture.
    CodeImage marked() const { return pictured(station); }
    static CodeImage pictured(const StationFile& station) {
        const ExpectedView view(expected_scene(station));
        return view.at({rotation_from_vector({0.3, 0.1, 0.2}), {5.0, -3.0, 330.0}});
    }

    std::vector<nlohmann::json> events(const std::string& kind) const {
        std::vector<nlohmann::json> found;
        for (const std::string& line : split(read_text(folder / "record/events.jsonl"), '\n'))
            if (!line.empty() && nlohmann::json::parse(line)["event"] == kind)
                found.push_back(nlohmann::json::parse(line));
        return found;
    }
    nlohmann::json run_file() const {
        return nlohmann::json::parse(read_text(folder / "record/run.json"));
    }

    TemporaryFolder folder;
    StationFile station;
    VirtualClock clock;
    std::stop_source stop;
    std::function<void(FakeCamera&)> on_camera = [](FakeCamera&) {};
    std::function<void(FakeStage&)> on_stage = [](FakeStage&) {};
    FakeCamera::Picture picture;
    std::function<void(std::vector<AxisStatus>&)> on_status = [](auto&) {};
    std::function<void(std::size_t move)> before_move = [](std::size_t) {};
    bool homed = false;  // the operator's word
    std::function<ClimateReading()> climate;
    int opened = 0, moves = 0, stops = 0, closings = 0;  // closing a stage stops it, too
    bool stage_is_silent = false;
    std::vector<double> carriage, first_target;

private:
    // Tells what it went through when the run lets it go.
    class ObservedStage final : public FakeStage {
    public:
        explicit ObservedStage(StationOfMocks& owner)
            : FakeStage(owner.station.stage.axes), owner_(owner) {}
        ~ObservedStage() override { ++owner_.closings; }
        ObservedStage(const ObservedStage&) = delete;
        ObservedStage& operator=(const ObservedStage&) = delete;
        void move(std::span<const double> target, std::stop_token token) override {
            owner_.before_move(moves.size());
            FakeStage::move(target, token);
            owner_.moves = static_cast<int>(moves.size());
            owner_.carriage.assign(target.begin(), target.end());
            if (owner_.first_target.empty())
                owner_.first_target = owner_.carriage;
        }
        std::vector<double> position() override {
            require_answer("position");
            return FakeStage::position();
        }
        std::vector<AxisStatus> status() override {
            require_answer("status");
            return FakeStage::status();
        }
        std::string trace() const override { return "-3 ms read registers 0..13\n"; }
        bool stop() noexcept override {
            ++owner_.stops;
            return FakeStage::stop();
        }

    private:
        void require_answer(const char* request) const {
            if (owner_.stage_is_silent)
                throw DeviceError("stage fake", request, "no answer");
        }
        StationOfMocks& owner_;
    };

    DeviceOpeners openers() {
        return {[this] { return opened_camera(); },
                [this] { return opened_stage(); },
                homed,
                {},
                climate};
    }
    std::unique_ptr<Camera> opened_camera() {
        ++opened;
        auto camera = std::make_unique<FakeCamera>(
            [this](const CaptureSettings& settings) { return picture(settings); }, clock);
        camera->identity_.serial = "CAM-7";
        on_camera(*camera);
        return camera;
    }
    std::unique_ptr<Stage> opened_stage() {
        ++opened;
        auto stage = std::make_unique<ObservedStage>(*this);
        stage->on_status = on_status;
        on_stage(*stage);
        return stage;
    }

    std::FILE* null_;

public:
    Progress progress;
};

// The picture is what the calibrated camera sees at the carriage's position, with mountings that
// the station is not told.
inline void show_a_true_camera(StationOfMocks& mocks) {
    const auto view = std::make_shared<ExpectedView>(expected_scene(mocks.station));
    const Rigid camera_from_base =
        rigid_from_vector((Vector6d() << 0.03, -0.02, 0.01, 4, -6, 330).finished());
    const Rigid carriage_from_marker =
        left_perturbed(mocks.station.carriage_from_marker_nominal,
                       (Vector6d() << 0.01, -0.007, 0.013, 0.3, -0.2, 0.5).finished());
    mocks.picture = [&mocks, view, camera_from_base, carriage_from_marker](const CaptureSettings&) {
        return view->at(camera_from_base *
                        base_from_carriage(mocks.station.stage.axes, mocks.carriage) *
                        carriage_from_marker);
    };
}

}  // namespace etalon
