// A station with photographs of its marker at known positions of the stage, as renders.
#pragma once

#include <opencv2/imgcodecs.hpp>

#include "compare/expect/expected_view.h"
#include "sim/scene/pose_sampling.h"
#include "stage/axes/kinematics.h"
#include "station/setup/station_file.h"
#include "tests/station/stations.h"

namespace etalon {

// Mounted as drawn, so that the freedom along rz is held at the truth.
inline const Rigid true_x{rotation_from_vector({0.02, -0.03, 0.01}), {4.0, -3.0, 330.0}};

class PhotographedStation {
public:
    PhotographedStation() { write_station(folder_); }

    StationFile station() const { return read_station(folder_ / "station.yaml"); }

    // The axes go to `share` (0 to 1) of their travel from its middle; without, they stay there.
    std::filesystem::path photographs(int count, const std::vector<double>& share) {
        const StationFile station = this->station();
        const ExpectedView view(expected_scene(station));
        const HaltonSequence sequence(4, 3);
        std::string csv = "rz_deg,photo,x_mm,y_mm,z_mm\n";
        for (int i = 0; i < count; ++i) {
            const auto u = sequence.point(static_cast<std::uint64_t>(i + 1));
            const double x = 30.0 * share[0] * (2 * u[0] - 1), y = 25.0 * share[1] * (2 * u[1] - 1);
            const double z = 70.0 * share[2] * (2 * u[2] - 1), rz = 3.0 * share[3] * (2 * u[3] - 1);
            const std::vector<double> q = {x, y, z, rz};
            const std::string name = fmt::format("{}.png", i);
            cv::imwrite((folder_ / name).string(),
                        view.at(true_x * base_from_carriage(station.stage.axes, q) *
                                station.carriage_from_marker_nominal)
                            .pixels);
            csv += fmt::format("{},{},{},{},{}\n", exact(rz * 180.0 / std::numbers::pi), name,
                               exact(x), exact(y), exact(z));
        }
        write_text(folder_ / "positions.csv", csv);
        return folder_ / "positions.csv";
    }

    const TemporaryFolder& folder() const { return folder_; }

private:
    TemporaryFolder folder_;
};

}  // namespace etalon
