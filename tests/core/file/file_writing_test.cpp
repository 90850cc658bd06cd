#include "core/file/file_writing.h"

#include <cerrno>

#include "tests/test.h"

namespace etalon {
namespace {

TEST(AtomicFile, ReplacesTheOldFileOnlyWhenItIsCommitted) {
    const TemporaryFolder folder;
    write_text(folder / "a.txt", "old");
    { AtomicFile(folder / "a.txt").write("half"); }
    EXPECT_EQ(read_text(folder / "a.txt"), "old");
    EXPECT_FALSE(std::filesystem::exists(folder / "a.txt.part"));
    AtomicFile file(folder / "a.txt");
    file.write("new ");
    file.write("text");
    EXPECT_EQ(read_text(folder / "a.txt"), "old");
    file.commit();
    EXPECT_EQ(read_text(folder / "a.txt"), "new text");
    EXPECT_FALSE(std::filesystem::exists(folder / "a.txt.part"));
}

TEST(AtomicFile, OnAFullDiskIsADiskErrorAndLeavesTheOldFile) {
    const TemporaryFolder folder;
    write_text(folder / "a.txt", "old");
    const FileSizeLimit limit(1000);
    EXPECT_THROW(write_text(folder / "a.txt", std::string(1001, 'x')), DiskError);
    EXPECT_EQ(read_text(folder / "a.txt"), "old");
    EXPECT_FALSE(std::filesystem::exists(folder / "a.txt.part"));
    EXPECT_NO_THROW(write_text(folder / "a.txt", std::string(1000, 'x')));
}

TEST(AtomicFile, InAFolderThatIsNotThereIsNoDiskError) {
    const TemporaryFolder folder;
    try {
        AtomicFile file(folder / "none" / "a.txt");
        FAIL();
    } catch (const DiskError& error) {
        FAIL() << error.what();
    } catch (const ConfigError& error) {
        EXPECT_EQ(error.what(), (folder / "none" / "a.txt").string() +
                                    ": cannot be written: No such file or directory");
    }
}

// errno of something else must not be taken for the cause.
TEST(AppendFile, TellsTheCauseOfItsOwnFailure) {
    AppendFile full("/dev/full");
    errno = EACCES;
    EXPECT_THROW(full.write("x"), DiskError);
}

// Somebody may make room before the file is closed.
TEST(AppendFile, WritesNothingAgainOfWhatFailed) {
    const TemporaryFolder folder;
    {
        AppendFile file(folder / "a.txt");
        file.write("first\n");
        const FileSizeLimit limit(9);
        EXPECT_THROW(file.write("second\n"), DiskError);
    }
    EXPECT_EQ(read_text(folder / "a.txt"), "first\nsec");
}

}  // namespace
}  // namespace etalon
