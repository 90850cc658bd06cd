#include "station/serve/live_camera.h"

#include <opencv2/imgproc.hpp>

#include "compare/make_detector.h"
#include "station/serve/run_monitor.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr Duration period = 100ms, detection_period = 1s, lonely_time = 10s;
constexpr int shown_columns = 640;

// The marker where it was seen last, on a picture made small before it gets colours.
class MarkerOutline {
public:
    explicit MarkerOutline(const StationFile& station)
        : detector_(make_detector(station.detector, station.marker, station.detector)) {}

    void look_at(const CodeImage& image, Instant now) {
        if (now < next_)
            return;
        next_ = now + detection_period;
        detection_ = detector_->detect(image);
    }
    bool is_seen() const { return detection_.corners.has_value(); }
    const std::string& reason() const { return detection_.reason; }

    std::string drawn_on(const cv::Mat& codes) const {
        const double scale = std::min(1.0, static_cast<double>(shown_columns) / codes.cols);
        cv::Mat small, picture;
        cv::resize(codes, small, {}, scale, scale, cv::INTER_AREA);
        if (!is_seen())
            return small_jpeg(small);
        cv::cvtColor(small, picture, cv::COLOR_GRAY2BGR);
        std::vector<cv::Point2f> corners;
        for (const Eigen::Vector2d& pixel : detection_.corners->pixels)
            corners.emplace_back(static_cast<float>(scale * pixel.x()),
                                 static_cast<float>(scale * pixel.y()));
        std::vector<cv::Point2f> hull;
        cv::convexHull(corners, hull);
        const std::vector<cv::Point> line(hull.begin(), hull.end());
        cv::polylines(picture, line, true, {40, 140, 255}, 2, cv::LINE_AA);
        return small_jpeg(picture);
    }

private:
    std::unique_ptr<Detector> detector_;
    Detection detection_;
    Instant next_{};
};

}  // namespace

LiveCamera::LiveCamera(const StationFile& station)
    : station_(station),
      looked_at_(SteadyClock().now()),
      thread_([this](const std::stop_token& stop) { watch(stop); }) {}

void LiveCamera::release() {
    const std::lock_guard lock(release_mutex_);
    thread_.request_stop();
    if (thread_.joinable())
        thread_.join();
}

void LiveCamera::set(double exposure_us, double gain_db) {
    const std::lock_guard lock(mutex_);
    adjustment_ = {exposure_us, gain_db};
}

void LiveCamera::look() {
    looked_at_ = SteadyClock().now();
}

void LiveCamera::watch(const std::stop_token& stop) {
    SteadyClock clock;
    try {
        const auto camera = open_camera(station_.camera.uri, station_.camera.link, clock);
        const CaptureSettings settings = camera->configure(station_.camera.settings);
        camera->arm();
        take_pictures(*camera, settings, clock, stop);
        camera->disarm();
    } catch (const Interrupted&) {
    } catch (const std::exception& error) {
        LivePicture last;
        last.fault = error.what();
        pictures_.put(std::move(last));
    }
    ended_ = true;
}

void LiveCamera::take_pictures(Camera& camera, CaptureSettings settings, Clock& clock,
                               const std::stop_token& stop) {
    LiveView view;
    MarkerOutline outline(station_);
    for (Instant next = clock.now(); next - looked_at_.load() < lonely_time;
         next = std::max(next, clock.now())) {
        std::unique_lock lock(mutex_);
        const auto adjustment = std::exchange(adjustment_, std::nullopt);
        lock.unlock();
        if (adjustment) {
            CaptureSettings wanted = station_.camera.settings;
            wanted.exposure = std::chrono::microseconds(std::llround(adjustment->exposure_us));
            wanted.gain_db = adjustment->gain_db;
            camera.disarm();
            settings = camera.configure(wanted);
            camera.arm();
        }
        const Frame frame = camera.frame_after(clock.now(), 0, stop);
        view.add(frame);
        LivePicture picture;
        if (frame.status == FrameStatus::complete) {
            outline.look_at(frame.image, clock.now());
            picture.jpeg = outline.drawn_on(eight_bits(frame.image));
        }
        picture.figures = view.figures();
        picture.exposure_us = static_cast<double>(settings.exposure.count());
        picture.gain_db = settings.gain_db;
        picture.marker_seen = outline.is_seen();
        picture.marker_detail = outline.reason();
        pictures_.put(std::move(picture));
        next += period;
        clock.wait_until(next, stop);
        throw_if_stopped(stop);
    }
}

}  // namespace etalon
