#include "capture/frame/camera.h"
#include "tests/paths.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(OpenCamera, RefusesAUriThatNoBackendKnows) {
    VirtualClock clock;
    for (const char* uri : {"", "genicam", "genicam:", "files:", "webcam:0", ":x"})
        EXPECT_THROW(open_camera(uri, {}, clock), ConfigError) << uri;
}

TEST(OpenCamera, OpensAFolderByItsUri) {
    VirtualClock clock;
    EXPECT_TRUE(
        has(config_error_of([&] { open_camera("files:" ETALON_SOURCE_DIR "/cmake", {}, clock); }),
            "/cmake"));
}

}  // namespace
}  // namespace etalon
