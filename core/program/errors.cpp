#include "core/program/errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>

namespace etalon {
namespace {

std::string config_message(const SourcePlace& place, const std::string& message) {
    const std::string line = place.line > 0 ? fmt::format(":{}", place.line) : "";
    const std::string key = place.key.empty() ? "" : fmt::format("{}: ", place.key);
    return fmt::format("{}{}{}{}{}", place.file, line, place.file.empty() ? "" : ": ", key,
                       message);
}

}  // namespace

ConfigError::ConfigError(SourcePlace place, const std::string& message)
    : Error(config_message(place, message)), place_(std::move(place)) {}

void fail_writing(const std::filesystem::path& path, std::error_code cause) {
    const SourcePlace place{path.string()};
    const std::string message = "cannot be written: " + cause.message();
    constexpr int of_the_disk[] = {ENOSPC, EDQUOT, EFBIG, EIO, EROFS};
    if (std::ranges::find(of_the_disk, cause.value()) != std::end(of_the_disk))
        throw DiskError(place, message);
    throw ConfigError(place, message);
}

DeviceError::DeviceError(std::string device, std::string request, std::string cause)
    : Error(device + ": " + request + ": " + cause),
      device_(std::move(device)),
      request_(std::move(request)),
      cause_(std::move(cause)) {}

}  // namespace etalon
