// compare CAMERA MARKER PHOTO: how far the photograph is from its rendering, and whether they
// match.
#include <etalon/compare.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    if (argc != 4)
        return std::puts("usage: compare CAMERA MARKER PHOTO"), 3;
    const auto camera =
        std::make_shared<const etalon::PhotometricCamera>(etalon::read_camera(argv[1]));
    const etalon::Marker marker = etalon::parse_marker(argv[2], "MARKER");
    const etalon::ComparedArea area = etalon::compared_area(marker, {}, "MARKER");
    const etalon::CodeImage photo = etalon::read_photo(argv[3], camera->model(), argv[1]);

    const auto detector = etalon::make_detector("auto", marker, "MARKER");
    const auto found = etalon::find_marker(argv[3], photo, *detector, camera->projector(), marker);
    if (!found.estimate)
        return std::printf("%s\n", found.failure.c_str()), 1;

    const etalon::PhotoMatch match =
        etalon::match_photo(photo, marker.grid, area, camera, found.estimate->camera_from_marker);
    std::printf("photograph minus rendering: %.2f gray RMS, %.2f at the refined pose\n",
                match.calibrated.scored.rms_gray, match.refined.scored.rms_gray);
    const etalon::Findings findings = etalon::examine_match(photo, marker, area, *camera, match);
    for (const etalon::Finding& finding : findings)
        std::printf("%s\n", finding.sentence.c_str());
    return etalon::is_matched(findings) ? 0 : 1;
} catch (const std::exception& error) {
    std::fprintf(stderr, "compare: %s\n", error.what());
    return 3;
}
