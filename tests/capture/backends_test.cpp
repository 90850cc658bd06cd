#include <gtest/gtest.h>

#include "capture/frame/camera.h"
#include "core/program/errors.h"
#include "tests/paths.h"

namespace etalon {
namespace {

TEST(OpenCamera, RefusesAUriThatNoBackendKnows) {
    VirtualClock clock;
    for (const char* uri : {"", "genicam", "genicam:", "files:", "webcam:0", ":x"})
        EXPECT_THROW(open_camera(uri, {}, clock), ConfigError) << uri;
}

TEST(OpenCamera, OpensAFolderByItsUri) {
    VirtualClock clock;
    try {
        open_camera("files:" ETALON_SOURCE_DIR "/cmake", {}, clock);
        FAIL() << "a folder without images was accepted";
    } catch (const ConfigError& error) {
        EXPECT_NE(std::string(error.what()).find("/cmake"), std::string::npos);
    }
}

}  // namespace
}  // namespace etalon
