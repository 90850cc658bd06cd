#include "station/compare/comparison.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "compare/match/overlay.h"
#include "report/html.h"

namespace etalon {
namespace {

constexpr int embedded_quality = 85;

cv::Mat eight_bit(const cv::Mat& gray) {
    cv::Mat picture;
    gray.convertTo(picture, CV_8U);
    return picture;
}

// Where nothing is rendered it is the photograph, pale: in turn only the marker then changes.
cv::Mat rendering_picture(const PhotoFit& fit, const cv::Mat& photo) {
    cv::Mat pale = 0.4 * photo + 0.6 * 235.0;
    fit.predicted.copyTo(pale, fit.use != pixel_outside);
    return eight_bit(pale);
}

// In the report not larger than a screen: the files beside it have all pixels.
std::string element(const cv::Mat& picture, const cv::Rect& part, const std::string& alt) {
    constexpr int max_width = 1600;
    cv::Mat shown = picture(part);
    if (part.width > max_width)
        cv::resize(shown, shown, {max_width, part.height * max_width / part.width}, 0, 0,
                   cv::INTER_AREA);
    return embedded_jpeg(shown, embedded_quality, alt);
}

std::string thumbnail(const cv::Mat& picture, const std::string& alt) {
    constexpr int width = 260;
    cv::Mat small;
    const int height = std::max(1, picture.rows * width / picture.cols);
    cv::resize(picture, small, {width, height}, 0, 0, cv::INTER_AREA);
    return embedded_jpeg(small, embedded_quality, alt);
}

// The part of the image around the compared pixels, with room beside it.
cv::Rect surroundings(const cv::Mat& use) {
    constexpr int room = 24;
    cv::Rect box = cv::boundingRect(use);
    box -= cv::Point(room, room);
    box += cv::Size(2 * room, 2 * room);
    return box & cv::Rect({0, 0}, use.size());
}

}  // namespace

PhotoPictures make_pictures(ReportFolder& folder, std::size_t number,
                            const std::filesystem::path& photo, const PhotoFit& calibrated,
                            const PhotoFit& refined) {
    const cv::Mat gray = calibrated.predicted + calibrated.residual;
    const cv::Mat rendering = rendering_picture(calibrated, gray);
    const cv::Mat overlay =
        red_cyan_overlay(gray, calibrated.predicted, calibrated.use, overlay_gain);
    const cv::Mat residual =
        residual_map(calibrated.residual, calibrated.use, residual_map_scale_gray);
    const cv::Mat significance =
        residual_map(refined.significance, refined.use, significance_map_scale);

    PhotoPictures pictures;
    const std::string stem = fmt::format("{:02}-{}", number, photo.stem().string());
    const auto file = [&](const char* what, const cv::Mat& picture) {
        const std::string name = stem + "-" + what + ".png";
        write_picture(folder / name, picture);
        return name;
    };
    pictures.overlay_file = file("overlay", overlay);
    pictures.residual_file = file("residual", residual);
    pictures.significance_file = file("significance", significance);
    pictures.rendering_file = file("rendering", rendering);
    pictures.edges_file = stem + "-edges.svg";

    const std::string name = photo.filename().string();
    const cv::Rect part = surroundings(calibrated.use);
    pictures.part = part;
    pictures.photo = element(eight_bit(gray), part, "photograph " + name);
    pictures.rendering = element(rendering, part, "rendering of " + name);
    pictures.overlay = element(overlay, part, "red/cyan overlay of " + name);
    pictures.residual = element(residual, part, "residual map of " + name);
    pictures.significance = element(significance, part, "significance map of " + name);
    pictures.thumbnail = thumbnail(overlay(part), "overlay of " + name);
    pictures.refined_rendering =
        element(rendering_picture(refined, gray), part, "rendering at the refined pose of " + name);
    pictures.refined_residual =
        element(residual_map(refined.residual, refined.use, residual_map_scale_gray), part,
                "residual map at the refined pose of " + name);
    return pictures;
}

PhotoPictures pictures_of_photo(const CodeImage& image, const std::filesystem::path& photo) {
    const cv::Mat picture = eight_bit(gray_of(image));
    const std::string alt = "photograph " + photo.filename().string();
    PhotoPictures pictures;
    pictures.part = cv::Rect({0, 0}, picture.size());
    pictures.photo = element(picture, pictures.part, alt);
    pictures.thumbnail = thumbnail(picture, alt);
    return pictures;
}

}  // namespace etalon
