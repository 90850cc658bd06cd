#include "calib/camera/camera_hash.h"

#include <fmt/format.h>

#include "core/file/sha256.h"
#include "core/file/text.h"

namespace etalon {

std::string camera_sha256(const std::filesystem::path& file, const CameraModel& camera) {
    std::string text = read_text(file);
    const auto add = [&](const std::vector<std::pair<double, double>>& table) {
        for (const auto& [a, b] : table)
            text += fmt::format("\n{},{}", a, b);
    };
    if (camera.lens)
        add(camera.lens->psf.profile);
    if (camera.sensor)
        add(camera.sensor->transfer.table);
    return sha256(text);
}

}  // namespace etalon
