// One photograph after another against its rendering: fits, edges, findings, pictures. What
// `etalon compare` does once it has poses.
#pragma once

#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "station/compare/comparison.h"

namespace etalon {

class PhotoComparer {
public:
    // The profiles over depth span `depth_range_mm`, low and high.
    PhotoComparer(const Marker& marker, const ComparedArea& area, const CameraModel& camera,
                  std::pair<double, double> depth_range_mm);

    // Fills in `photo`, whose pose under test is known, and returns what it adds to the profiles;
    // picture files go to `folder`, named by `number` (from 1) and the photograph. What cannot be
    // compared is the photograph's failure, not an error. Safe from every thread.
    ResidualProfiles compare(const CodeImage& image, const std::filesystem::path& folder,
                             std::size_t number, ComparedPhoto& photo) const;

    // How the marker is rendered at a pose, in one line.
    std::string rendering(const Rigid& camera_from_marker) const;

    const ResidualProfiles& empty_profiles() const { return empty_profiles_; }

private:
    void match(const CodeImage& image, const std::filesystem::path& folder, std::size_t number,
               ComparedPhoto& photo, ResidualProfiles& profiles) const;

    Marker marker_;
    ComparedArea area_;
    std::shared_ptr<const PhotometricCamera> camera_;
    ResidualProfiles empty_profiles_;
};

// Depths of the compared area at the poses under test, mm; (0, 1) where there are none.
std::pair<double, double> depth_range(const std::vector<ComparedPhoto>& photos,
                                      const ComparedArea& area);

}  // namespace etalon
