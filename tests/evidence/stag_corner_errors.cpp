// Prints the STag detector's corner errors and detection rates on exact renders with defocus and
// sensor noise: the tables of docs/stag.md. Argument: POSES of each line, default 1000; some
// five minutes of CPU time.
#include <fmt/format.h>

#include <cstdlib>

#include "tests/compare/detect/stag/stag_study.h"

namespace etalon::test {
namespace {

void line(const char* name, const CameraModel& camera, const char* marker, const PoseRange& range,
          std::size_t poses) {
    const CornerErrors errors =
        corner_errors(camera, parse_marker(marker, "evidence"), range, poses);
    const auto figures = [](const std::vector<double>& all) {
        if (all.empty())
            return std::string("none");
        return fmt::format("{:.3f} / {:.3f} / {:.3f}", quantile(all, 0.5), quantile(all, 0.9),
                           quantile(all, 0.99));
    };
    fmt::print("| {} | {} | {:.2f} % | {} | {} | {:+.3f} |\n", name, errors.poses,
               100.0 * errors.detected / errors.poses, figures(errors.errors_px),
               figures(errors.small_errors_px), errors.inward_px);
    std::fflush(stdout);
}

}  // namespace
}  // namespace etalon::test

int main(int count, char** arguments) {
    using namespace etalon::test;
    const std::size_t poses = count > 1 ? std::strtoull(arguments[1], nullptr, 10) : 1000;
    fmt::print(
        "| poses | n | detected | error px, sides from 60 px: 50 / 90 / 99 % | smaller | "
        "inward px |\n|---|---|---|---|---|---|\n");
    const char* published = "stag:HD21:3@50mm";
    line("published comparison", noisy_webcam(1000.0), published, study_range, poses);
    line("the same, 50 mm with the border", noisy_webcam(1000.0), "stag:HD21:3@40mm", study_range,
         poses);
    line("the same, tone curve", with_tone_curve(noisy_webcam(1000.0)), published, study_range,
         poses);
    line("near, tilts to 60 degrees", noisy_webcam(400.0), published, near_range, poses);
    line("the same, R16", noisy_webcam(400.0), "stag:R16:77@50mm", near_range, poses);
    line("the same, tone curve", with_tone_curve(noisy_webcam(400.0)), published, near_range,
         poses);
    line("near, barrel distortion", barrel_webcam(), published, {200.0, 440.0, 1.0, false}, poses);
}
