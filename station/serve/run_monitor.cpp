#include "station/serve/run_monitor.h"

#include <opencv2/imgproc.hpp>

#include <fstream>

#include "core/image/picture_codec.h"
#include "station/record/qualify_result.h"

namespace etalon {
namespace {

constexpr int most_columns = 640, jpeg_quality = 80;

constexpr int trusted_poses = 3;  // after so many, measured time replaces the expected one

std::vector<Eigen::Vector2d> corners_of(const JsonEntry& list) {
    std::vector<Eigen::Vector2d> corners;
    for (const JsonEntry& item : list.items()) {
        const std::vector<double> xy = item.numbers(2);
        corners.emplace_back(xy[0], xy[1]);
    }
    return corners;
}

}  // namespace

cv::Mat eight_bits(const CodeImage& image) {
    if (image.bits == 8)
        return image.pixels;
    cv::Mat codes;
    image.pixels.convertTo(codes, CV_8U, 255.0 / image.full_scale());
    return codes;
}

std::string small_jpeg(const cv::Mat& picture) {
    cv::Mat small = picture;
    if (picture.cols > most_columns) {
        const double scale = static_cast<double>(most_columns) / picture.cols;
        cv::resize(picture, small, {}, scale, scale, cv::INTER_AREA);
    }
    const std::vector<unsigned char> bytes = encode_jpeg(small, jpeg_quality);
    return {bytes.begin(), bytes.end()};
}

PosePictureMaker::PosePictureMaker(const std::filesystem::path& record,
                                   const std::vector<InputFile>& inputs)
    : record_(record),
      station_(read_recorded_station(record, inputs)),
      projector_(station_.camera.model),
      view_(expected_scene(station_)) {}

std::shared_ptr<const PosePictures> PosePictureMaker::of(int index, const WatchedPose& pose) {
    const std::lock_guard lock(mutex_);
    if (!last_ || last_->pose != index)
        last_ = std::make_shared<const PosePictures>(made(index, pose));
    return last_;
}

PosePictures PosePictureMaker::made(int index, const WatchedPose& pose) const {
    PosePictures pictures{index, "", "", {}};
    try {
        // A file of a record is named by its log: only frames/ is looked into.
        if (pose.photo.starts_with("frames/") && pose.photo.find("..") == std::string::npos)
            pictures.photo = small_jpeg(eight_bits(read_image(record_ / pose.photo)));
        const auto estimate = estimate_pose(projector_, station_.marker.points_mm, pose.corners);
        if (!estimate)
            return pictures;
        pictures.reprojection_rms_px = estimate->reprojection_rms_px;
        pictures.render = small_jpeg(eight_bits(view_.at(estimate->camera_from_marker)));
    } catch (const Error&) {  // what is there is shown
    }
    return pictures;
}

const char* name(RunPhase phase) {
    constexpr const char* names[] = {"preparing", "measuring", "analysing", "ended"};
    return names[static_cast<int>(phase)];
}

bool RunMonitor::look() {
    std::ifstream log(record_ / log_file, std::ios::binary);
    if (!log.seekg(static_cast<std::streamoff>(read_bytes_)))
        return false;
    bool any = false;
    for (std::string line; std::getline(log, line) && !log.eof();) {  // whole lines only
        read_bytes_ += line.size() + 1;
        take(JsonEntry(line, {(record_ / log_file).string(), ++line_, ""}));
        any = true;
    }
    return any;
}

void RunMonitor::take(const JsonEntry& line) {
    const std::string event = line.at("event").text();
    const double time_s = line.at("t").number();
    latest_s_ = time_s;
    if (event == "run") {
        take_plan(line);
    } else if (event == "session") {
        state_.phase = RunPhase::preparing;
        state_.outcome.clear();
        state_.reason.clear();
        visited_in_session_ = 0;
        frame_corners_.clear();  // of a pose that the one before did not finish
        first_photo_.clear();
        state_.camera_serial = line.at("camera").at("serial").text();
    } else if (event == "stage homed") {
        state_.phase = RunPhase::measuring;
        measuring_since_s_ = time_s;
    } else if (event == "frame") {
        take_frame(line);
    } else if (event == "pose") {
        take_pose(line, time_s);
    } else if (event == "analysis") {
        state_.phase = RunPhase::analysing;
    } else if (event == "remark") {
        state_.remarks.push_back(line.at("detail").text());
    } else if (run_outcome_named(event)) {
        state_.phase = RunPhase::ended;
        state_.outcome = event;
        state_.reason = line.at("detail").text();
    }
}

void RunMonitor::take_plan(const JsonEntry& line) {
    for (const JsonEntry& item : line.at("inputs").items())
        state_.inputs.push_back({item.at("role").text(), item.at("path").text(),
                                 item.at("sha256").text(), item.at("copy").text()});
    expected_s_ = line.at("plan").at("expected_duration_s").number();
    for (const JsonEntry& item : line.at("plan").at("poses").items()) {
        WatchedPose pose;
        for (const JsonEntry& position : item.at("target").items())
            pose.target.push_back(position.number());
        pose.hold_out = item.at("hold_out").flag();
        state_.poses.push_back(std::move(pose));
    }
}

void RunMonitor::take_frame(const JsonEntry& line) {
    const std::string file = line.at("file").text();
    if (first_photo_.empty())
        first_photo_ = file;
    if (auto corners = corners_of(line.at("corners")); !corners.empty())
        frame_corners_.push_back(std::move(corners));
}

void RunMonitor::take_pose(const JsonEntry& line, double time_s) {
    const auto last = static_cast<long long>(state_.poses.size()) - 1;
    state_.latest_pose = static_cast<int>(line.at("pose").integer(0, last));
    WatchedPose& pose = state_.poses[static_cast<std::size_t>(state_.latest_pose)];
    pose.visited = true;
    pose.corners = corners_of(line.at("corners"));
    pose.seen = !pose.corners.empty();
    pose.photo = std::exchange(first_photo_, {});
    pool_corner_noise(pose.corners);
    ++state_.visited;
    state_.seen += pose.seen ? 1 : 0;
    ++visited_in_session_;
    state_.rejected_frames =
        static_cast<long>(line.at("camera").at("frames_rejected").integer(0, 1LL << 62));
    latest_s_ = time_s;
}

void RunMonitor::pool_corner_noise(const std::vector<Eigen::Vector2d>& means) {
    for (const auto& corners : frame_corners_)
        if (corners.size() == means.size() && frame_corners_.size() > 1)
            for (std::size_t i = 0; i < means.size(); ++i)
                square_sum_px2_ += (corners[i] - means[i]).squaredNorm();
    if (frame_corners_.size() > 1)
        freedoms_ += 2 * static_cast<long>((frame_corners_.size() - 1) * means.size());
    if (freedoms_ > 0)
        state_.corner_noise_px = std::sqrt(square_sum_px2_ / static_cast<double>(freedoms_));
    frame_corners_.clear();
}

std::optional<double> RunMonitor::seconds_left() const {
    if (state_.poses.empty())
        return std::nullopt;
    const double left = static_cast<double>(state_.poses.size()) - state_.visited;
    if (visited_in_session_ < trusted_poses)
        return expected_s_ * left / static_cast<double>(state_.poses.size());
    return (latest_s_ - measuring_since_s_) * left / visited_in_session_;
}

}  // namespace etalon
