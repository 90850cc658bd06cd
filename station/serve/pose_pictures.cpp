#include "station/serve/pose_pictures.h"

#include <opencv2/imgproc.hpp>

#include "compare/detect/detector.h"
#include "core/image/picture_codec.h"
#include "core/program/errors.h"
#include "station/setup/station_inputs.h"

namespace etalon {
namespace {

constexpr int most_columns = 640, jpeg_quality = 80;

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

}  // namespace etalon
