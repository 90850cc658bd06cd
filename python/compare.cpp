// etalon.compare: a photograph against its rendering.
#include "compare/make_detector.h"
#include "compare/match/photo_findings.h"
#include "compare/photo_pose.h"
#include "core/program/errors.h"
#include "python/arrays.h"
#include "python/interruptible.h"

namespace etalon {
namespace {

struct ComparedOnce {
    std::string failure;  // why there is no match
    Findings findings;
    std::optional<PhotoMatch> match;

    bool is_matched() const { return match && etalon::is_matched(findings); }
};

// The pose under test: the one that was given, or that of the marker's own detector.
PhotoPose pose_under_test(const CodeImage& photo, const Marker& marker, const Projector& projector,
                          const std::optional<Rigid>& given) {
    if (given)
        return {"photo", {}, {}, PoseEstimate{.camera_from_marker = *given}};
    const auto detector = make_detector("auto", marker, "marker");
    return find_as_drawn("photo", photo, *detector, projector, marker);
}

ComparedOnce compared(const CodeImage& photo, const Marker& marker, const CameraModel& model,
                      const std::optional<Rigid>& given, double background) {
    const auto camera = std::make_shared<const PhotometricCamera>(model);
    const PhotoPose under_test = pose_under_test(photo, marker, camera->projector(), given);
    if (!under_test.estimate)
        return {under_test.failure, {}, {}};
    const ComparedArea area = compared_area(marker, {}, "marker");
    const Rigid& pose = under_test.estimate->camera_from_marker;
    Findings refusals = examine_marker(photo, marker, area, camera->projector(), pose);
    if (is_refused(refusals))
        return {refusals.front().sentence, std::move(refusals), {}};
    PhotoMatch match = match_photo(photo, marker.grid, area, camera, pose, background);
    Findings findings = examine_match(photo, marker, area, *camera, match);
    return {{}, std::move(findings), std::move(match)};
}

ComparedOnce compare(const py::array& photo, const Marker& marker, const Projector& camera,
                     const py::object& camera_from_marker, double background) {
    const CodeImage image = photo_of(photo, camera.camera(), "photo");
    std::optional<Rigid> given;
    if (!camera_from_marker.is_none())
        given = rigid_of(camera_from_marker, "camera_from_marker");
    return without_gil([&] { return compared(image, marker, camera.camera(), given, background); });
}

py::list model_parameters(const PhotoFit& fit) {
    py::list all;
    for (const MatchParameter& parameter : fit.parameters)
        all.append(py::dict("name"_a = parameter.name, "value"_a = parameter.value,
                            "deviation"_a = parameter.deviation, "unit"_a = parameter.unit,
                            "source"_a = parameter.source));
    return all;
}

void bind_findings(Module& module) {
    Bound<Finding>(module, "Finding", "What speaks against a match.")
        .get("name", "occluded, glare, blur_differs, ...", &Finding::name)
        .get("sentence", "For a technician.", &Finding::sentence)
        .get("value", "Measured, in unit.", &Finding::value)
        .get("limit", "That it is beyond.", &Finding::limit)
        .get("unit", "px, %, gray; empty for a ratio.", &Finding::unit)
        .get("is_refusal", "The figures of this photograph mean nothing.",
             &Finding::is_not_assessable)
        .def("__repr__", [](const Finding& finding) {
            return "<etalon.Finding " + finding.name + ": " + finding.sentence + ">";
        });
}

void bind_fit(Module& module) {
    const auto image = [](cv::Mat PhotoFit::*which) {
        return [which](const PhotoFit& fit) { return shared_array(fit.*which); };
    };
    const auto figure = [](double ResidualStatistics::*which) {
        return [which](const PhotoFit& fit) { return fit.scored.*which; };
    };
    Bound<PhotoFit>(module, "PhotoFit", R"(A photograph against its rendering at one pose.

Gray: code value / full scale * 255. Fitted on one half of the marker's cells, scored on the
other.)")
        .get("camera_from_marker", "(4, 4), mm.",
             [](const PhotoFit& fit) { return array_of(fit.state.camera_from_marker); })
        .get("rms_gray", "Of the scored pixels.", figure(&ResidualStatistics::rms_gray))
        .get("mean_gray", "Signed.", figure(&ResidualStatistics::mean_gray))
        .get("p99_gray", "99 % of the absolute residuals are at most this.",
             figure(&ResidualStatistics::p99_gray))
        .get("noise_gray", "Standard deviation of the noise, RMS.",
             [](const PhotoFit& fit) { return fit.noise_gray; })
        .get("predicted", "(height, width) float32, gray: what the photograph should have been.",
             image(&PhotoFit::predicted))
        .get("residual", "(height, width) float32, gray: photograph minus predicted.",
             image(&PhotoFit::residual))
        .get("significance", "(height, width) float32: residual / standard deviation of the noise.",
             image(&PhotoFit::significance))
        .get("use", "(height, width) uint8: 0 outside, 1 fitted, 2 scored.", image(&PhotoFit::use))
        .get("parameters",
             "Of the photometric model: dicts of name, value, deviation, unit, source.",
             &model_parameters);
}

}  // namespace

void bind_compare(Module& module) {
    bind_findings(module);
    bind_fit(module);
    const auto fit = [](PhotoFit PhotoMatch::*which) {
        return [which](const ComparedOnce& result) {
            return result.match ? std::optional((*result.match).*which) : std::nullopt;
        };
    };
    Bound<ComparedOnce>(module, "Comparison", "A photograph against its rendering.")
        .get("is_matched", "Compared, and nothing speaks against a match.",
             &ComparedOnce::is_matched)
        .get("findings", "What speaks against a match.", &ComparedOnce::findings)
        .get("failure", "Why it could not be compared; else empty.", &ComparedOnce::failure)
        .get("calibrated", "PhotoFit at the pose under test, or None.",
             fit(&PhotoMatch::calibrated))
        .get("refined", "PhotoFit at the photometric pose, or None.", fit(&PhotoMatch::refined))
        .get("pose", "PhotometricPose, or None.", [](const ComparedOnce& result) {
            return result.match ? std::optional(result.match->pose) : std::nullopt;
        });
    module.def("compare", &compare, "photo"_a, "marker"_a, "camera"_a,
               "camera_from_marker"_a = py::none(), py::kw_only(), "background"_a = 1.0,
               R"(A photograph of a marker against its rendering: a Comparison.

photo: (height, width) uint8 or uint16, shared. camera_from_marker: (4, 4), mm, the pose under test;
None takes that of the marker's own detector. background: radiance beside the marker, whose white is
1. A marker that is not found is no error: failure says why. Raises ConfigError for a photograph of
another size than the camera's, NumericalError where the pixels do not determine the fit.)");
}

}  // namespace etalon
