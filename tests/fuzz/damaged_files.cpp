#include "tests/fuzz/damaged_files.h"

#include <array>

namespace etalon::test {
namespace {

constexpr const char* camera_file =
    "etalon: camera/1\n"
    "serial: \"U3V-1234\"\n"
    "image: {width: 640, height: 480}\n"
    "intrinsics: {fx: 538.6, fy: 538.6, cx: 319.5, cy: 239.5}\n"
    "distortion: {k1: -0.286, k2: 0.057, p1: 0, p2: 0, k3: 0.112}\n"
    "covariance: {order: [fx, k1], lower: [0.04, 1e-5, 2e-6]}\n"
    "lens: {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650, psf: ideal}\n"
    "sensor: {pixel_pitch_um: 8.3, bits: 8, transfer: linear, black: 8,\n"
    "         gain_e_per_dn: 60, read_noise_e: 10, illumination: {cos4: false}}\n";
constexpr const char* csv_file = "rx,ry,rz,tx,ty,tz\n0,0,0.5,10,-7,500\n0.1,-0.2,0,0,0,1e3\n";
constexpr const char* json_file =
    "[{\"rx\": 0, \"ry\": 0.1, \"rz\": 0.5, \"tx\": 10, \"ty\": -7, \"tz\": 500}]\n";

constexpr std::array words = {
    "nan",  "inf",  "-",     "1e999", "{",           "}",    "[[",
    "]",    "\"",   ": ",    "\n",    "\t",          "\r\n", "&a *a",
    "!!",   "- ",   "#",     "0x1p9", "1e-320",      ",",    "18446744073709551616",
    "null", "true", "\\u00", "\xff",  "\xef\xbb\xbf"};

void damage(std::string& text, RandomStream& random) {
    const auto below = [&](std::size_t n) {
        return std::min(n - 1, static_cast<std::size_t>(random.uniform() * static_cast<double>(n)));
    };
    if (text.empty())
        return;
    const std::size_t at = below(text.size());
    switch (below(6)) {
        case 0:
            text[at] = static_cast<char>(random.bits() & 0xff);
            break;
        case 1:
            text.erase(at, 1 + below(8));
            break;
        case 2:
            text.insert(at, text.substr(below(text.size()), 1 + below(40)));
            break;
        case 3:
            text.replace(at, below(6), words[below(words.size())]);
            break;
        case 4:
            text.insert(at, words[below(words.size())]);
            break;
        default:
            if (random.uniform() < 0.1)
                text.resize(at);
            else
                text[at] = static_cast<char>(text[at] ^ (1 << below(8)));
    }
}

}  // namespace

std::vector<DamagedFile> damaged_files(std::uint64_t seed) {
    RandomStream random(seed, 9);
    std::vector<DamagedFile> files = {
        {"camera.yml", camera_file}, {"poses.csv", csv_file}, {"poses.json", json_file}};
    for (DamagedFile& file : files)
        file.content = damaged(std::move(file.content), random);
    return files;
}

std::string damaged(std::string text, RandomStream& random) {
    for (int times = static_cast<int>(4.0 * random.uniform()); times > 0; --times)
        damage(text, random);
    return text;
}

}  // namespace etalon::test
