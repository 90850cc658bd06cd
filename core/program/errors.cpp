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

// Bytes of the control character in UTF-8 that the text begins with; 0 if it begins with none:
// U+0000 to 001F, 007F to 009F, and of U+200E to 202E and 2066 to 2069 (Unicode 15, 23.2) those
// that part lines or turn the direction.
std::size_t control_bytes(std::string_view text) {
    const auto byte = [&](std::size_t i) {
        return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u;
    };
    const auto is_in = [](unsigned value, unsigned low, unsigned high) {
        return value >= low && value <= high;
    };
    if (byte(0) < 0x20 || byte(0) == 0x7f)
        return 1;
    if (byte(0) == 0xc2 && is_in(byte(1), 0x80, 0x9f))
        return 2;
    const bool turns =
        byte(0) == 0xe2 &&
        ((byte(1) == 0x80 && (is_in(byte(2), 0x8e, 0x8f) || is_in(byte(2), 0xa8, 0xae))) ||
         (byte(1) == 0x81 && is_in(byte(2), 0xa6, 0xa9)));
    return turns ? 3 : 0;
}

}  // namespace

std::string printable(std::string_view text, std::string_view kept) {
    std::string shown;
    while (!text.empty()) {
        const std::size_t control = kept.find(text.front()) == std::string_view::npos
                                        ? control_bytes(text)
                                        : std::size_t{0};
        if (control == 0)
            shown += text.front();
        for (const char c : text.substr(0, control))
            shown += c == '\n'   ? "\\n"
                     : c == '\t' ? "\\t"
                                 : fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
        text.remove_prefix(std::max<std::size_t>(control, 1));
    }
    return shown;
}

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
