#include "station/shell/photo_files.h"

#include <fmt/format.h>
#include <glob.h>

#include <algorithm>
#include <set>

#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/image/image.h"
#include "core/image/opencv_plugin.h"

namespace etalon {
namespace {

constexpr std::string_view film = "video:";

bool is_pattern(const std::string& name) {
    std::error_code ignored;
    return name.find_first_of("*?[") != std::string::npos &&
           !std::filesystem::exists(name, ignored);
}

// "FILE?every=10".
struct FilmName {
    std::string file;
    long every = 1;
};

FilmName film_name(const std::string& name) {
    const std::string what = name.substr(film.size());
    const auto question = what.rfind('?');
    FilmName parsed{what.substr(0, question)};
    if (question == std::string::npos)
        return parsed;
    const std::string option = what.substr(question + 1);
    const auto every =
        option.starts_with("every=") ? parse_integer(option.substr(6)) : std::nullopt;
    if (!every || *every < 1)
        throw ConfigError({name}, "a film's frames are chosen by ?every=N, N at least 1");
    parsed.every = static_cast<long>(*every);
    return parsed;
}

std::filesystem::path new_folder() {
    std::string name = (std::filesystem::temp_directory_path() / "etalon-frames-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr)
        throw ConfigError({name}, "no folder can be made for a film's frames");
    return name;
}

}  // namespace

PhotoFiles::PhotoFiles(const std::vector<std::filesystem::path>& given) {
    for (const std::filesystem::path& path : given) {
        const std::string name = path.string();
        if (name.starts_with(film))
            add_film(name);
        else if (is_pattern(name))
            add_pattern(name);
        else
            paths_.push_back(path);
    }
    require_distinct(paths_);
    if (const auto rotated = std::ranges::count_if(paths_, is_marked_rotated); rotated > 0)
        fmt::print(
            stderr,
            "{} of {} photographs are marked as rotated (EXIF): their pixels are read as the "
            "sensor has them\n",
            rotated, paths_.size());
}

PhotoFiles::~PhotoFiles() {
    std::error_code ignored;
    if (!frames_.empty())
        std::filesystem::remove_all(frames_, ignored);
}

void PhotoFiles::add_pattern(const std::string& pattern) {
    glob_t found{};
    const int result = glob(pattern.c_str(), 0, nullptr, &found);
    const std::vector<std::string> names(found.gl_pathv, found.gl_pathv + found.gl_pathc);
    globfree(&found);
    if (result != 0)
        throw ConfigError({pattern}, "no file has a name like that");
    for (const std::string& name : names) {
        if (printable(name) != name)
            throw ConfigError({name}, "holds a control character: give the file another name");
        paths_.emplace_back(name);
    }
}

void PhotoFiles::add_film(const std::string& name) {
    const FilmName of = film_name(name);
    const std::string stem = std::filesystem::path(of.file).stem().string();
    const std::size_t before = paths_.size();
    const auto keep = [&](long frame, const cv::Mat& picture) {
        if (frames_.empty())
            frames_ = new_folder();
        paths_.push_back(frames_ / fmt::format("{}-{:06}.png", stem, frame));
        write_picture(paths_.back(), picture);
    };
    if (!opencv_plugin().read_film(of.file, of.every, keep))
        throw ConfigError({of.file}, "is not a film that can be read");
    note_input(of.file);
    if (paths_.size() == before)
        throw ConfigError({of.file}, "holds no frame that can be read");
}

void require_distinct(const std::vector<std::filesystem::path>& photos) {
    std::set<std::filesystem::path> seen;
    for (const std::filesystem::path& photo : photos) {
        std::error_code error;
        const std::filesystem::path file = weakly_canonical(photo, error);
        if (!seen.insert(error ? photo : file).second)
            throw ConfigError({photo.string()}, "is given twice");
    }
}

}  // namespace etalon
