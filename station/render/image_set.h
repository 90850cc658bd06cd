// A folder of rendered images, one a pose, that can be continued after an interruption:
//
//   pose-000000.png ...   the images (.tiff of radiance), written aside and renamed into place
//   poses.csv             their poses
//   set.json              the settings that the images' bytes follow from
//   images.jsonl          a line a pose, as they were made: the file and its SHA-256, or why it was
//                         refused
//
// The folder of a shard (report/result_rows.h) holds every n-th image. An image is there when its
// file and its line are. Layout of the files: docs/files.md.
#pragma once

#include "core/file/file_writing.h"
#include "core/time/progress.h"
#include "station/render/commands.h"

namespace etalon {

class ImageSet {
public:
    // Makes the folder, or continues the one that was made with the same settings. `settings` and
    // `made_from` are JSON objects as text; the latter is for people and not compared. A bit of
    // each of `poses` is kept. Throws ConfigError (place --out) when the folder holds something
    // else, or a set with other settings: the first one that differs is named; and while another
    // program writes there.
    ImageSet(const std::filesystem::path& folder, const std::string& settings,
             const std::string& made_from, const std::string& extension, std::size_t poses);

    const std::filesystem::path& folder() const { return folder_; }
    std::string file_name(std::size_t index) const;  // "pose-000007.png"

    // Whether the image was there when the folder was opened, and how many were.
    std::size_t had_images() const { return had_images_; }
    bool had(std::size_t index) const { return had_.at(index); }

    // Adds the line of a pose whose image, if it has one, is in its place. The line is in the file
    // when this returns. From one thread at a time. Throws ConfigError when it cannot be written.
    void add(const std::string& line);

private:
    bool keeps(const std::string& line);

    FolderLock lock_;
    std::filesystem::path folder_;
    std::string extension_;
    std::vector<bool> had_;
    std::size_t had_images_ = 0;
    std::optional<AppendFile> manifest_;
};

struct SetResult {
    std::size_t rendered = 0, already_there = 0, refused = 0;
    std::string first_refusal;  // in words; empty if none was
    bool complete = true;       // false: stopped before the last pose
};

// Renders what the folder arguments.out does not hold yet of arguments.shard. A row of the pose
// file is camera_from_scene; arguments.poses say where each marker is in the scene (one marker
// without a pose is the scene's origin). The images' bytes depend neither on threads nor on order;
// as many are in memory as there are threads, and a bit for each pose. A stop request lets those in
// work be finished. Throws ConfigError for arguments, files and folders that cannot be used.
SetResult render_set(const RenderArguments& arguments, std::stop_token stop, Progress& progress);

struct MergedImages {
    std::size_t images = 0, refused = 0;
};

// Makes the folder of a whole set from those of all of its shards (`etalon render --shard`), in any
// order; images are linked where the disk allows it and copied elsewhere. Its bytes are those of
// the set in one piece that was not interrupted. Throws ConfigError for shards that are missing,
// doubled, not finished or of different settings, and for an image that is not what its line says.
// Reads every image once; 8 bytes a pose are in memory.
MergedImages merge_image_sets(const std::vector<std::filesystem::path>& shards,
                              const std::filesystem::path& out);

}  // namespace etalon
