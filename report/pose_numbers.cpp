#include "report/pose_numbers.h"

#include <fmt/format.h>

namespace etalon {

std::vector<double> pose_numbers(const Rigid& transform) {
    const Vector6d v = vector_from_rigid(transform);
    return {v.data(), v.data() + v.size()};
}

std::vector<std::vector<double>> row_numbers(const Matrix6d& matrix) {
    std::vector<std::vector<double>> rows;
    for (int i = 0; i < 6; ++i) {
        const Vector6d row = matrix.row(i);
        rows.emplace_back(row.data(), row.data() + row.size());
    }
    return rows;
}

std::string pose_columns(const Rigid& transform) {
    const Vector6d v = vector_from_rigid(transform);
    return fmt::format("{:9.5f} {:9.5f} {:9.5f} {:9.3f} {:9.3f} {:9.3f}", v[0], v[1], v[2], v[3],
                       v[4], v[5]);
}

std::string deviation_columns(const Vector6d& deviations) {
    const Vector6d& v = deviations;
    return fmt::format("{:9.1e} {:9.1e} {:9.1e} {:9.4f} {:9.4f} {:9.4f}", v[0], v[1], v[2], v[3],
                       v[4], v[5]);
}

std::string pose_heading() {
    return fmt::format("{:>9} {:>9} {:>9} {:>9} {:>9} {:>9}", "rx rad", "ry", "rz", "tx mm", "ty",
                       "tz");
}

}  // namespace etalon
