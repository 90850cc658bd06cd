// A folder of rendered images, one a pose, that can be continued after an interruption:
//
//   pose-000000.png ...   the images (.tiff of radiance), written aside and renamed into place
//   poses.csv             their poses
//   set.json              the settings that the images' bytes follow from
//   images.jsonl          a line a pose, as they were made: the file and its SHA-256, or why it was
//                         refused
//
// An image is there when its file and its line are. Layout of the files: docs/files.md.
#pragma once

#include <filesystem>
#include <fstream>
#include <set>
#include <string>

namespace etalon {

class ImageSet {
public:
    // Makes the folder, or continues the one that was made with the same settings. `settings` and
    // `made_from` are JSON objects as text; the latter only tells people, it is not compared.
    // Throws ConfigError (place --out) when the folder holds something else, or a set with other
    // settings: the first one that differs is named.
    ImageSet(const std::filesystem::path& folder, const std::string& settings,
             const std::string& made_from, const std::string& extension);

    const std::filesystem::path& folder() const { return folder_; }
    std::string file_name(std::size_t index) const;  // "pose-000007.png"

    // Whether the image was there when the folder was opened.
    bool had(std::size_t index) const { return had_.contains(index); }

    // Adds the line of a pose whose image, if it has one, is in its place. The line is in the file
    // when this returns. From one thread at a time. Throws ConfigError when it cannot be written.
    void add(const std::string& line);

private:
    void open_settings(const std::string& settings, const std::string& made_from);
    void open_manifest();
    bool keeps(const std::string& line);

    std::filesystem::path folder_;
    std::string extension_;
    std::set<std::size_t> had_;
    std::ofstream manifest_;
};

}  // namespace etalon
