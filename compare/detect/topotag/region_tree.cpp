#include <opencv2/imgproc.hpp>

#include "compare/detect/topotag/topotag_detector.h"

namespace etalon {
namespace {

// Connected regions of one colour.
struct Labelled {
    cv::Mat labels, statistics, centroids;
    std::vector<int> region;  // by label, -1: not met yet

    Labelled(const cv::Mat& pixels, int neighbours)
        : region(static_cast<std::size_t>(cv::connectedComponentsWithStats(
                     pixels, labels, statistics, centroids, neighbours)),
                 -1) {}
};

}  // namespace

std::vector<Region> region_tree(const cv::Mat& dark) {
    cv::Mat framed;  // what is outside is white
    cv::copyMakeBorder(dark, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar(0));
    Labelled white(framed == 0, 8), black(framed, 4);
    // The outermost one is what the others leave of the image.
    const double all = static_cast<double>(dark.total());
    std::vector<Region> regions{
        {-1, false, all, 0.5 * all * Eigen::Vector2d(dark.cols - 1, dark.rows - 1)}};
    white.region[static_cast<std::size_t>(white.labels.at<int>(0, 0))] = 0;
    for (int y = 1; y <= dark.rows; ++y)
        for (int x = 1; x <= dark.cols; ++x) {
            const bool is_dark = framed.at<uchar>(y, x) != 0;
            Labelled &own = is_dark ? black : white, &other = is_dark ? white : black;
            const int label = own.labels.at<int>(y, x);
            int& region = own.region[static_cast<std::size_t>(label)];
            if (region >= 0)
                continue;
            // To the left of a region's first pixel is the region around it.
            const int parent =
                other.region[static_cast<std::size_t>(other.labels.at<int>(y, x - 1))];
            region = static_cast<int>(regions.size());
            const double area = own.statistics.at<int>(label, cv::CC_STAT_AREA);
            const Eigen::Array2d centroid(own.centroids.ptr<double>(label));
            const Eigen::Vector2d sum = (centroid * area).round() - area;  // without the frame
            regions.front().area -= area;
            regions.front().sum -= sum;
            regions[static_cast<std::size_t>(parent)].children.push_back(region);
            regions.push_back({parent, is_dark, area, sum});
        }
    return regions;
}

}  // namespace etalon
