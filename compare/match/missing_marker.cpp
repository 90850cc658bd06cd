// Why a detector found nothing: by trying. The rest of compare/match/photo_findings.h is in
// match_outcome.cpp.
#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "compare/characterise/code_statistics.h"
#include "compare/match/photo_findings.h"

namespace etalon {
namespace {

constexpr double min_range_gray = 20.0;  // as of the contrast in match_outcome.cpp
constexpr double max_saturated = 0.5;    // of the image: a white wall beside the marker is well

// Between the darkest and the lightest per cent of the pixels.
double range_gray(const CodeImage& photo) {
    cv::Mat pixels = photo.pixels.reshape(1, 1).clone();
    cv::sort(pixels, pixels, cv::SORT_EVERY_ROW | cv::SORT_ASCENDING);
    const int n = pixels.cols;
    const auto at = [&](int i) {
        return pixels.depth() == CV_8U ? static_cast<double>(pixels.at<uchar>(0, i))
                                       : static_cast<double>(pixels.at<ushort>(0, i));
    };
    return (at(n - 1 - n / 100) - at(n / 100)) * 255.0 / photo.full_scale();
}

Finding tried(const std::string& name, const std::string& sentence) {
    return {name, 0.0, 0.0, "", sentence, true};
}

CodeImage negative_of(const CodeImage& photo) {
    return {cv::Mat(photo.full_scale() - photo.pixels), photo.bits};
}

CodeImage mirror_image_of(const CodeImage& photo) {
    CodeImage result{{}, photo.bits};
    cv::flip(photo.pixels, result.pixels, 1);
    return result;
}

CodeImage reduced(const CodeImage& photo, int factor) {
    CodeImage result{{}, photo.bits};
    cv::resize(photo.pixels, result.pixels, {}, 1.0 / factor, 1.0 / factor, cv::INTER_AREA);
    return result;
}

}  // namespace

Findings examine_missing_marker(const CodeImage& photo, Detector& detector) {
    if (photo.pixels.empty())
        return {};
    const double range = range_gray(photo);
    if (range < min_range_gray)
        return {{"low_contrast", range, min_range_gray, "gray",
                 fmt::format("the whole photograph spans {:.0f} gray values: empty, dark or "
                             "without contrast",
                             range),
                 true}};
    const double clipped = share_at_saturation(photo, photo.full_scale());
    if (clipped > max_saturated)
        return {{"saturated", 100.0 * clipped, 100.0 * max_saturated, "%",
                 fmt::format("{:.0f} % of the photograph is at the end of the scale: expose less",
                             100.0 * clipped),
                 true}};
    if (detector.detect(negative_of(photo)).corners)
        return {tried("negative",
                      "in the negative the marker is found: light and dark are "
                      "exchanged")};
    if (detector.detect(mirror_image_of(photo)).corners)
        return {tried("mirrored",
                      "in the mirrored photograph the marker is found: it is printed "
                      "or read out mirrored")};
    for (const int factor : {2, 4})
        if (std::min(photo.pixels.rows, photo.pixels.cols) / factor > 40 &&
            detector.detect(reduced(photo, factor)).corners)
            return {tried("out_of_focus",
                          fmt::format("in the photograph reduced to 1/{} the marker is found: out "
                                      "of focus, moved or noisy",
                                      factor))};
    return {};
}

}  // namespace etalon
