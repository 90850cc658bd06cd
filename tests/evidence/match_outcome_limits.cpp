// How small a fault in a photograph `etalon compare` still names: for each fault a ladder of
// strengths, 20 photographs of a tag and 20 of a board at poses of their own at each; printed is
// the smallest strength from which on at least 95 % are found by the right name. Then how many of
// 1000 photographs without a fault have a finding.
//
//     build/release/tests/evidence/match_outcome_limits [FAULT]      some minutes
// FAULT: a part of a fault's name below, or `without`.
#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "tests/compare/match/adversarial_photos.h"

namespace {

using namespace etalon;
using test::TrueScene;

using Camera = std::shared_ptr<const PhotometricCamera>;

Findings examined(const CodeImage& photo, const TrueScene& scene, const Camera& camera, int seed) {
    return test::examined(photo, scene, test::found_pose(scene, camera->model(), seed), camera);
}

using Photographer = std::function<CodeImage(const TrueScene&, double strength, int seed)>;

struct Fault {
    std::string what;
    std::string names;              // any of them will do: they cannot be told apart for sure
    std::vector<double> strengths;  // rising
    Photographer photo;
    std::function<CameraModel(double strength)> camera = {};  // empty: the right one
};

CameraModel with_k1(double more) {
    CameraModel camera = test::calibrated_camera();
    camera.distortion.k1 += more;
    return camera;
}

CameraModel with_focal_length(double percent) {
    CameraModel camera = test::calibrated_camera();
    camera.intrinsics.fx *= 1.0 + 0.01 * percent;
    camera.intrinsics.fy *= 1.0 + 0.01 * percent;
    return camera;
}

CodeImage plain(const TrueScene& scene, double, int seed) {
    return test::exposed(test::radiance_of(scene), seed);
}

Photographer cover(double reflectance) {
    return [reflectance](const TrueScene& scene, double cells, int seed) {
        return test::exposed(test::occluded(scene, cells * test::cell_px(scene), reflectance),
                             seed);
    };
}

std::vector<Fault> faults() {
    return {
        {"cover of 40 % gray, side in cells", "occluded", {0.2, 0.35, 0.5, 0.7, 1.0}, cover(0.4)},
        {"black cover, side in cells", "occluded", {0.35, 0.5, 0.7, 1.0}, cover(0.03)},
        {"saturating reflection, sigma in cells",
         "glare",
         {0.1, 0.15, 0.2, 0.3},
         [](const TrueScene& scene, double cells, int seed) {
             return test::exposed(test::with_glare(scene, cells * test::cell_px(scene), 3.0), seed);
         }},
        {"motion during the exposure, px",
         "motion_blur",
         {2.5, 3.0, 3.25, 3.5},
         [](const TrueScene& scene, double path_px, int seed) {
             return test::exposed(test::moved(scene, path_px), seed);
         }},
        {"motion while the marker's rows are read, px",
         "skewed or calibration_mismatch",
         {0.5, 1.0, 1.5, 2.0},
         [](const TrueScene& scene, double path_px, int seed) {
             return test::exposed(test::rolled(scene, path_px), seed);
         }},
        {"unsharp mask of 1.2 px, amount",
         "sharpened",
         {0.2, 0.3, 0.4, 0.5},
         [](const TrueScene& scene, double amount, int seed) {
             return test::sharpened(test::exposed(test::radiance_of(scene), seed), amount, 1.2);
         }},
        {"k1 too large by",
         "calibration_mismatch or skewed",
         {0.05, 0.1, 0.2, 0.4},
         plain,
         with_k1},
        {"focal length too large, %",
         "calibration_mismatch or skewed",
         {2.0, 4.0, 8.0, 16.0},
         plain,
         with_focal_length},
        {"JPEG, 100 - quality",
         "compressed",
         {60.0, 70.0, 80.0, 90.0},
         [](const TrueScene& scene, double lost, int seed) {
             return test::compressed(test::exposed(test::radiance_of(scene), seed),
                                     static_cast<int>(100.0 - lost));
         }},
    };
}

struct Found {
    int named = 0, matched = 0;
};

Found count(const Fault& fault, double strength, bool board, int photos) {
    const auto camera = std::make_shared<const PhotometricCamera>(
        fault.camera ? fault.camera(strength) : test::calibrated_camera());
    Found found;
    for (int n = 0; n < photos; ++n) {
        const TrueScene scene = board ? test::board_scene(1000 + n) : test::tag_scene(1000 + n);
        const Findings findings = examined(fault.photo(scene, strength, n), scene, camera, n);
        found.matched += is_matched(findings) ? 1 : 0;
        found.named += std::any_of(findings.begin(), findings.end(),
                                   [&](const Finding& one) {
                                       return fault.names.find(one.name) != std::string::npos;
                                   })
                           ? 1
                           : 0;
    }
    return found;
}

// "0.5 (0.2: 3/20, ...)", the smallest from which on all strengths are found.
std::string ladder(const Fault& fault, bool board) {
    constexpr int photos = 20;
    std::string steps, smallest = "none";
    bool all = true;
    for (auto strength = fault.strengths.rbegin(); strength != fault.strengths.rend(); ++strength) {
        const Found found = count(fault, *strength, board, photos);
        all = all && found.named >= 0.95 * photos;
        if (all)
            smallest = fmt::format("{:g}", *strength);
        steps = fmt::format("{:g}: {}/{} ({} matched) ", *strength, found.named, photos,
                            found.matched) +
                steps;
    }
    return fmt::format("{} | {}", smallest, steps);
}

void print_false_findings() {
    constexpr int photos = 1000;
    const auto camera = std::make_shared<const PhotometricCamera>(test::calibrated_camera());
    int wrong = 0;
    for (int n = 0; n < photos; ++n) {
        const TrueScene scene =
            n % 2 == 0 ? test::tag_scene(2000 + n) : test::board_scene(2000 + n);
        const Findings findings = examined(plain(scene, 0.0, n), scene, camera, n);
        wrong += is_matched(findings) ? 0 : 1;
    }
    fmt::print("without a fault: {} of {} photographs have a finding\n", wrong, photos);
}

}  // namespace

int main(int argc, char** argv) {
    const std::string only = argc > 1 ? argv[1] : "";
    for (const Fault& fault : faults())
        for (const bool board : {false, true}) {
            if (fault.what.find(only) == std::string::npos)
                continue;
            fmt::print("{} | {} | {} | {}\n", fault.what, fault.names, board ? "board" : "tag",
                       ladder(fault, board));
            std::fflush(stdout);
        }
    if (only.empty() || only == "without")
        print_false_findings();
    return 0;
}
