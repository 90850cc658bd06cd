// One view as `etalon render` was asked for it: what a single image and an image set share.
#pragma once

#include "report/json_text.h"
#include "sim/marker/marker.h"
#include "sim/render/motion_blur.h"
#include "station/render/commands.h"

namespace etalon {

// An image and how it was made.
struct View {
    Radiance radiance;               // before the sensor, exposure included
    std::optional<RenderPlan> plan;  // none of the reference integrator
    int pixels_without_ray = 0;      // not told by the reference integrator
    double standard_error_gray = 0;  // of the reference integrator: the largest

    std::string describe() const;  // one line for people
};

// Those of --pose.
std::vector<Rigid> parse_poses(const std::vector<std::string>& poses);

// One per command. render() and write() are safe from every thread.
class ViewRenderer {
public:
    // Reads camera, markers and background. Throws ConfigError with the option's or file's name.
    explicit ViewRenderer(const RenderArguments& arguments);

    const CameraModel& camera() const { return camera_; }
    const std::vector<Marker>& markers() const { return markers_; }

    // The markers at these transforms, in the order of the command line. Throws NumericalError, in
    // words for people, behind the camera, from the back, or for one before another.
    Scene scene(const std::vector<Rigid>& camera_from_marker) const;

    // Throws NumericalError as Renderer::render() does.
    View render(const Scene& scene) const;

    // The image as a file: .png or .tiff of code values, or .tiff of radiance. The noise is a pure
    // function of the seed and `index`. Throws ConfigError when it cannot be written.
    void write(const std::filesystem::path& path, const View& view, std::uint32_t index) const;

private:
    void read_background(const std::string& text);
    void check_noise(const RenderArguments& arguments) const;
    View integrate(const Scene& scene) const;
    View render_closed_form(const Scene& scene) const;

    CameraModel camera_;
    std::vector<Marker> markers_;
    double background_ = 0.0;    // unless there is a
    Radiance background_image_;  // of the camera's size
    RenderOptions options_;
    double exposure_;
    std::optional<MotionDuringExposure> motion_;
    std::optional<std::uint64_t> noise_seed_;
    std::optional<SensorModel> sensor_;  // none where radiance is written
    std::optional<Renderer> renderer_;   // none for the reference integrator
};

// A render's plan, with what was left out and by which bound; lines of at most 80 columns.
std::string plan_table(const RenderPlan& plan);

// "plan" and "pixels_without_ray", or "largest_standard_error_gray" of the reference integrator.
void add_method(const View& view, Json& json);

}  // namespace etalon
