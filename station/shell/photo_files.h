// Photographs as a command line names them: files, patterns ("photos/*.jpg") and films
// ("video:FILE?every=10"), whose frames are files for as long as this lives.
#pragma once

#include <filesystem>
#include <vector>

namespace etalon {

class PhotoFiles {
public:
    // In the order given, a pattern's by name, a film's by time; `every` takes each so many-th
    // frame, from the first. Names of single files are not looked up. A line on stderr tells how
    // many are marked as rotated. Throws ConfigError for a pattern that nothing matches, a name
    // with a control character, a film that cannot be read, and as require_distinct().
    explicit PhotoFiles(const std::vector<std::filesystem::path>& given);
    ~PhotoFiles();
    PhotoFiles(const PhotoFiles&) = delete;
    PhotoFiles& operator=(const PhotoFiles&) = delete;

    const std::vector<std::filesystem::path>& paths() const { return paths_; }

private:
    void add_pattern(const std::string& pattern);
    void add_film(const std::string& name);

    std::vector<std::filesystem::path> paths_;
    std::filesystem::path frames_;  // folder of the films' frames; empty without
};

// Throws ConfigError for a photograph that is given twice, by whatever name: it would count as two
// that agree.
void require_distinct(const std::vector<std::filesystem::path>& photos);

}  // namespace etalon
