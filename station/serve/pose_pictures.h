// A pose's photograph beside what the calibration says it should look like, small enough to watch:
// JPEG, at most 640 px wide.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "calib/camera/projector.h"
#include "compare/expect/expected_view.h"
#include "station/serve/run_monitor.h"

namespace etalon {

struct PosePictures {
    int pose = -1;
    std::string photo, render;  // JPEG; empty: there is none
    // How far the marker's corners lie from where the calibration has them, at the best pose; only
    // where it was seen.
    std::optional<double> reprojection_rms_px;
};

// Of a picture of any bit depth, brightest as it is.
std::string small_jpeg(const cv::Mat& gray_or_bgr);
cv::Mat eight_bits(const CodeImage& image);

// Of one run. Safe from every thread; the last pair is kept, so that it is rendered once for
// however many look at it.
class PosePictureMaker {
public:
    // Reads the station from the record's copies. Throws ConfigError when they cannot be read.
    PosePictureMaker(const std::filesystem::path& record, const std::vector<InputFile>& inputs);

    // Some 30 ms of CPU time per megapixel for a pose that is new. A photograph that cannot be read
    // is left out.
    std::shared_ptr<const PosePictures> of(int index, const WatchedPose& pose);

private:
    PosePictures made(int index, const WatchedPose& pose) const;

    std::filesystem::path record_;
    StationFile station_;
    Projector projector_;
    ExpectedView view_;
    std::mutex mutex_;
    std::shared_ptr<const PosePictures> last_;
};

}  // namespace etalon
