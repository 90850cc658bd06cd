#include "tests/fuzz/random_scenes.h"

#include <fmt/format.h>

#include <limits>

#include "core/program/errors.h"
#include "tests/image_of.h"

namespace etalon::test {
namespace {

struct Attempt {
    std::optional<RenderedImage> image;
    std::string refusal;
};

Attempt attempt(const Renderer& renderer, const RandomInput& input, RenderMethod method,
                const cv::Rect& region = {}) {
    const RenderOptions options{
        .method = method, .tolerance_gray = input.tolerance_gray, .region = region};
    try {
        return {renderer.render(input.scene, options), {}};
    } catch (const Error& refusal) {
        return {std::nullopt, refusal.what()};
    }
}

// All radiances that a pixel can show lie between those of the scene: no spread is negative.
std::optional<Violation> outside_hull(const RandomInput& input, const RenderedImage& image) {
    double low = input.scene.background, high = low;
    for (const PlacedMarker& marker : input.scene.markers) {
        double least, most;
        cv::minMaxLoc(marker.grid.cells, &least, &most);
        low = std::min(low, least);
        high = std::max(high, most);
    }
    const double allowed = 2.0 * input.tolerance_gray * gray;
    double least, most;
    cv::minMaxLoc(image.radiance, &least, &most);
    if (least >= low - allowed && most <= high + allowed)
        return std::nullopt;
    return Violation{"hull", fmt::format("radiance {:.6g}..{:.6g} beyond {:.6g}..{:.6g}", least,
                                         most, low, high)};
}

std::optional<Violation> not_finite(const RenderedImage& image) {
    if (cv::checkRange(image.radiance))
        return std::nullopt;
    return Violation{"finite", "a pixel is not finite"};
}

// Without distortion every pixel has a ray; a pixel without one shows the background.
std::optional<Violation> wrong_mask(const RandomInput& input, const RenderedImage& image) {
    cv::Mat wrong = (image.valid == 0) & (image.radiance != input.scene.background);
    if (cv::countNonZero(wrong) == 0 ||
        input.scene.background != static_cast<float>(input.scene.background))
        return std::nullopt;
    return Violation{"mask", "a pixel without a ray is not background"};
}

// The last third of the columns and of the rows, alone. At the distortion model's end both may be
// off by what their plans state.
void compare_region(const Renderer& renderer, const RandomInput& input, const RenderedImage& whole,
                    SceneCheck& check) {
    const cv::Size size = whole.radiance.size();
    const cv::Rect region(cv::Point(2 * size.width / 3, 2 * size.height / 3), cv::Point(size));
    const Attempt part = attempt(renderer, input, RenderMethod::automatic, region);
    const double difference =
        part.image ? cv::norm(part.image->radiance(region), whole.radiance(region), cv::NORM_INF)
                   : std::numeric_limits<double>::infinity();
    const double allowed_gray = input.tolerance_gray + 2.0 * whole.plan.border_gray;
    if (difference > allowed_gray * gray)
        check.violations.push_back(
            {"region", fmt::format("differs from the whole's part by {:.4g} gray {}",
                                   difference / gray, part.refusal)});
}

void compare_methods(const RandomInput& input, const Attempt& lens, const Attempt& area,
                     SceneCheck& check) {
    constexpr double area_up_to_px = 0.5;
    if (!lens.image || !area.image || area.image->plan.max_blur_radius_px > area_up_to_px)
        return;
    check.methods_gray = cv::norm(lens.image->radiance, area.image->radiance, cv::NORM_INF) / gray;
    if (*check.methods_gray > 2.0 * input.tolerance_gray)
        check.violations.push_back(
            {"E and C", fmt::format("differ by {:.4g} gray, tolerance {:.3g}", *check.methods_gray,
                                    input.tolerance_gray)});
}

void compare_reference(const RandomInput& input, const RenderedImage& image, int probes,
                       const ReferenceEffort& effort, SceneCheck& check) {
    const auto pixels = probe_pixels(input.camera, input.scene, probes, 5);
    const ReferenceCheck against = check_against_reference(
        image.radiance, input.camera, input.scene, pixels, input.tolerance_gray, effort);
    check.reference_gray =
        std::max(0.0, std::abs(against.difference_gray) - 4.0 * against.standard_error_gray);
    if (!against.within())
        check.violations.push_back(
            {"reference", fmt::format("pixel ({}, {}) off by {:.4g} gray, bound {:.4g}; {}",
                                      against.pixel.x, against.pixel.y, against.difference_gray,
                                      against.bound_gray, image.plan.describe())});
}

}  // namespace

const Renderer& KeptRenderer::of(const RandomInput& input) {
    if (!renderer_ || input.camera_key == 0 || input.camera_key != key_) {
        renderer_.reset();
        renderer_.emplace(input.camera);
        key_ = input.camera_key;
    }
    return *renderer_;
}

SceneCheck check_scene_of(KeptRenderer& kept, const RandomInput& input, int probes,
                          const ReferenceEffort& effort) {
    SceneCheck check;
    const Renderer* renderer = nullptr;
    try {
        renderer = &kept.of(input);
    } catch (const Error& refusal) {
        check.refusal = refusal.what();
        return check;
    }
    const Attempt automatic = attempt(*renderer, input, RenderMethod::automatic);
    const Attempt lens = attempt(*renderer, input, RenderMethod::exact_lens);
    const Attempt area = attempt(*renderer, input, RenderMethod::exact_area);
    check.refusal = automatic.refusal;
    for (const Attempt* made : {&automatic, &lens, &area}) {
        if (!made->image)
            continue;
        for (const auto& found : {not_finite(*made->image), outside_hull(input, *made->image),
                                  wrong_mask(input, *made->image)})
            if (found)
                check.violations.push_back(*found);
    }
    if (!automatic.image)
        return check;
    if (!input.poison.empty())
        check.violations.push_back(
            {"poison", fmt::format("rendered with {} not finite", input.poison)});
    compare_region(*renderer, input, *automatic.image, check);
    compare_methods(input, lens, area, check);
    if (probes > 0 && input.poison.empty())
        compare_reference(input, *automatic.image, probes, effort, check);
    return check;
}

}  // namespace etalon::test
