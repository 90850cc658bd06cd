// An image set: the same scene from every pose of a file, in parallel. The published program's main
// product. The folder is station/render/image_set.h's.
#pragma once

#include <cstddef>
#include <stop_token>
#include <string>

#include "core/time/progress.h"
#include "station/render/commands.h"

namespace etalon {

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

}  // namespace etalon
