#include "mocks/stage/serial_pair.h"
#include "tests/test.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

TEST(SerialLink, IsThereAsLongAsTheLine) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    {
        const SerialLink link(path);
        EXPECT_EQ(fs::read_symlink(path), link.pair().device());
    }
    EXPECT_FALSE(fs::exists(fs::symlink_status(path)));
}

TEST(SerialLink, ReplacesOneThatIsLeftAndLeavesALaterOneAlone) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    fs::create_symlink("/dev/pts/gone", path);
    {
        const SerialLink link(path);
        EXPECT_EQ(fs::read_symlink(path), link.pair().device());
        fs::remove(path);
        fs::create_symlink("/dev/pts/other", path);
    }
    EXPECT_EQ(fs::read_symlink(path), "/dev/pts/other");
}

TEST(SerialLink, ReplacesNothingElse) {
    const TemporaryFolder folder;
    const fs::path path = folder / "stage";
    write_text(path, "notes");
    EXPECT_THROW(SerialLink{path}, DeviceError);
    EXPECT_EQ(read_text(path), "notes");
    EXPECT_THROW(SerialLink{folder / "missing/stage"}, DeviceError);
}

}  // namespace
}  // namespace etalon
