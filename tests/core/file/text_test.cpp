#include "core/file/text.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>

#include "core/file/file_writing.h"
#include "core/file/sha256.h"
#include "tests/test.h"

namespace etalon {
namespace {

TEST(Text, ParsesWholeFiniteNumbersOnly) {
    EXPECT_EQ(parse_number(" -7.5e2 "), -750.0);
    EXPECT_EQ(parse_number("+3"), 3.0);
    EXPECT_FALSE(parse_number("+-3"));
    for (const char* wrong : {"", "nan", "inf", "1.5x", "1,5", "0x10", "1e999", "--1"})
        EXPECT_FALSE(parse_number(wrong)) << wrong;
}

TEST(Text, ADecimalCommaGetsAHint) {
    EXPECT_EQ(number_hint("1,5"), "; a decimal point is a dot: 1.5");
    for (const char* other : {"1.5", "1,5,7", "a,b", ""})
        EXPECT_EQ(number_hint(other), "") << other;
}

TEST(Text, ListOfNumbersMustHaveTheAskedLength) {
    EXPECT_EQ(parse_numbers("7,-5,0.25", 3, "--pose"), (std::vector<double>{7, -5, 0.25}));
    EXPECT_THROW(parse_numbers("7,-5", 3, "--pose"), ConfigError);
    EXPECT_THROW(parse_numbers("7,,5", 3, "--pose"), ConfigError);
}

// Table 3-7 of the Unicode standard: the first and the last character of each length, and what lies
// beside them.
TEST(Text, Utf8IsWhatTheStandardSays) {
    const auto error = [](std::string_view text) {
        return config_error_of([&] { require_utf8(text, {"t", 3}); });
    };
    for (const char* good : {"\x01\x7f", "\xc2\x80\xdf\xbf", "\xe0\xa0\x80\xed\x9f\xbf\xef\xbf\xbf",
                             "\xf0\x90\x80\x80\xf4\x8f\xbf\xbf"})
        EXPECT_EQ(error(good), "no error");
    for (const char* bad :
         {"\x80", "\xc1\xbf", "\xe0\x9f\xbf", "\xed\xa0\x80", "\xf0\x8f\xbf\xbf",
          "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff", "\xc2", "\xe2\x82", "\xf0\x9f\x98x"})
        EXPECT_NE(error(bad), "no error") << bad;
    EXPECT_EQ(error("ab\n\n\xe9t\xe9"), "t:5: is not UTF-8: a byte 0xe9");
    EXPECT_EQ(error(std::string_view("a\n\0", 3)), "t:4: is not UTF-8: a byte 0x00");
}

TEST(Text, FilesLoseTheirByteOrderMarkAndMustBeUtf8) {
    const TemporaryFolder folder;
    write_text(folder / "t", "\xef\xbb\xbfx\n\xef\xbb\xbf");
    EXPECT_EQ(read_text(folder / "t"), "x\n\xef\xbb\xbf");
    write_text(folder / "t", "\xff\xfex\0");
    EXPECT_THROW(read_text(folder / "t"), ConfigError);
}

TEST(Text, SaysWhatStandsInPlaceOfAFile) {
    const TemporaryFolder folder;
    ASSERT_EQ(mkfifo((folder / "fifo").c_str(), 0600), 0);
    std::filesystem::create_symlink("loop", folder / "loop");
    write_text(folder / "file", "");
    std::filesystem::create_symlink("file", folder / "link");
    const std::pair<std::filesystem::path, std::string> all[] = {
        {folder / "none", "no such file"},
        {folder / "", "is a folder, not a file"},
        {folder / "fifo", "is a FIFO, not a file"},
        {"/dev/null", "is a device, not a file"},
        {folder / "loop", "cannot be read: Too many levels of symbolic links"}};
    for (const auto& one : all) {
        const std::string wanted = one.first.string() + ": " + one.second;
        EXPECT_EQ(config_error_of([&] { read_text(one.first); }), wanted);
        EXPECT_EQ(config_error_of([&] { sha256_of_file(one.first); }), wanted);
    }
    EXPECT_EQ(read_text(folder / "link"), "");
}

TEST(Text, ExactNumbersReadBackAsTheSameDouble) {
    for (const double value : {0.1, 1.0 / 3.0, 538.55, -1e-300, 12345678901234567.0})
        EXPECT_EQ(parse_number(exact(value)), value);
}

TEST(Text, NearestWordFindsTheMisspelling) {
    EXPECT_EQ(nearest_word("focus_distanc_mm", {"f_number", "focus_distance_mm"}),
              "focus_distance_mm");
    EXPECT_EQ(nearest_word("stat", {"stop", "start", "status"}), "status") << "which it begins";
    EXPECT_EQ(nearest_word("zzzzzz", {"f_number", "psf"}), "");
}

TEST(Text, IsWrappedBelowItsHead) {
    EXPECT_EQ(wrapped_text("ab: ", "cd efg hi", 10), "ab: cd efg\n    hi\n");
    EXPECT_EQ(wrapped_text("", "longer-than-that x", 10), "longer-than-that\nx\n");
    EXPECT_EQ(wrapped_words("ab: ", {"cd", "efg", "hi"}, ", ", 2, 10), "ab: cd,\n  efg, hi\n");
}

TEST(Text, IsPrintableOnOneLine) {
    EXPECT_EQ(printable("a\nb\tc\x1b[2J\x7f"), "a\\nb\\tc\\x1b[2J\\x7f");
    EXPECT_EQ(printable("\xc2\x85 \u2028 \u202e \u2066 \u200f"),
              "\\xc2\\x85 \\xe2\\x80\\xa8 \\xe2\\x80\\xae \\xe2\\x81\\xa6 \\xe2\\x80\\x8f");
    for (const char* plain : {"", "a \\ b", "\u00a0\u00b5\u2010\u202f\u206a\u96ea", "\xff\xe9"})
        EXPECT_EQ(printable(plain), plain);
    EXPECT_EQ(printable("a\nb\r", "\n"), "a\nb\\x0d");
    EXPECT_STREQ(ConfigError({"a\nb", 3}, "x\ny").what(), "a\\nb:3: x\\ny");
}

TEST(Text, EscapesWhatHtmlWouldRead) {
    EXPECT_EQ(escape_html("a\x1b\n"), "a\\x1b\n");
    EXPECT_EQ(escape_html("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
}

// ---- file writing

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

TEST(AppendFile, HasOneWriter) {
    const TemporaryFolder folder;
    std::optional<AppendFile> first(folder / "a.txt");
    EXPECT_THAT(config_error_of([&] { AppendFile(folder / "a.txt"); }),
                EndsWith("a.txt: is in use: another etalon is writing to it"));
    first.reset();
    AppendFile(folder / "a.txt").write("x");
    EXPECT_EQ(read_text(folder / "a.txt"), "x");
}

TEST(AtomicFile, OfOnePathIsWrittenByOneAtATime) {
    const TemporaryFolder folder;
    AtomicFile first(folder / "a.txt");
    first.write("first");
    EXPECT_THAT(config_error_of([&] { write_text(folder / "a.txt", "second"); }),
                EndsWith("a.txt: is being written by another program"));
    first.commit();
    EXPECT_EQ(read_text(folder / "a.txt"), "first");
    write_text(folder / "a.txt", "third");  // the first still has its file
    EXPECT_EQ(read_text(folder / "a.txt"), "third");
}

TEST(AtomicFile, ReplacesWhatALinkLeadsToAndNotTheLink) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "there");
    std::filesystem::create_symlink("there/a.txt", folder / "link");
    std::filesystem::create_symlink(folder / "link", folder / "there/link of the link");
    for (const char* text : {"made", "replaced"}) {
        write_text(folder / "there/link of the link", text);
        EXPECT_EQ(read_text(folder / "there/a.txt"), text);
        EXPECT_TRUE(std::filesystem::is_regular_file(
            std::filesystem::symlink_status(folder / "there/a.txt")));
        for (const char* link : {"link", "there/link of the link"})
            EXPECT_TRUE(std::filesystem::is_symlink(folder / link)) << text;
    }
    std::filesystem::create_symlink("round", folder / "round");
    EXPECT_THAT(config_error_of([&] { write_text(folder / "round", "x"); }),
                HasSubstr("Too many levels of symbolic links"));
}

TEST(AtomicFile, KeepsTheModeOfTheFile) {
    using std::filesystem::perms;
    const TemporaryFolder folder;
    write_text(folder / "a.txt", "old");
    const perms mode = perms::owner_read | perms::owner_write | perms::group_exec;
    std::filesystem::permissions(folder / "a.txt", mode);
    write_text(folder / "a.txt", "new");
    EXPECT_EQ(std::filesystem::status(folder / "a.txt").permissions(), mode);
}

// POSIX: an open FIFO keeps what is written to it, at least 512 bytes, until it is read.
TEST(AtomicFile, WritesToAPipeOrADeviceAndReplacesNeither) {
    const TemporaryFolder folder;
    const std::filesystem::path pipe = folder / "pipe";
    ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    const FileDescriptor reader(::open(pipe.c_str(), O_RDWR | O_NONBLOCK));
    write_text(pipe, "seven");
    std::array<char, 9> bytes{};
    EXPECT_EQ(read(reader.get(), bytes.data(), bytes.size()), 5);
    EXPECT_STREQ(bytes.data(), "seven");
    EXPECT_TRUE(std::filesystem::is_fifo(pipe));
    std::filesystem::create_symlink("/dev/full", folder / "full");
    EXPECT_THROW(write_text(folder / "full", "x"), DiskError);
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "full"));
    EXPECT_TRUE(std::filesystem::is_character_file("/dev/full"));
    EXPECT_THAT(config_error_of([&] { write_text(folder / ".", "x"); }),
                EndsWith("cannot be written: Is a directory"));
}

TEST(AtomicFile, RefusesTheFileThatStdoutGoesTo) {
    const TemporaryFolder folder;
    testing::internal::CaptureStdout();
    const auto error = config_error_of([&] { write_text("/dev/stdout", "x"); });
    EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
    EXPECT_THAT(error, HasSubstr("/dev/stdout: is where stdout or stderr goes"));
}

// ---- inputs

TEST(InputGuard, KeepsWhatWasReadByWhateverNameItIsWritten) {
    const TemporaryFolder folder;
    write_text(folder / "a.txt", "input");
    std::filesystem::create_symlink("a.txt", folder / "link");
    std::filesystem::create_hard_link(folder / "a.txt", folder / "second name");
    {
        const InputGuard guard;
        write_text(folder / "a.txt", "input");  // not read yet
        std::filesystem::remove(folder / "second name");
        std::filesystem::create_hard_link(folder / "a.txt", folder / "second name");
        read_text(folder / "link");
        for (const char* name : {"a.txt", "link", "second name"}) {
            EXPECT_THAT(config_error_of([&] { write_text(folder / name, "x"); }),
                        EndsWith("is an input of this command and stays: name another file to "
                                 "write"));
            EXPECT_THROW(AppendFile(folder / name), ConfigError);
        }
        write_text(folder / "b.txt", "output");
        EXPECT_EQ(read_text(folder / "a.txt"), "input");
    }
    read_text(folder / "a.txt");  // of a library's user
    write_text(folder / "a.txt", "changed");
    EXPECT_EQ(read_text(folder / "a.txt"), "changed");
}

// ---- folders

TEST(FolderLock, IsHeldByOne) {
    const TemporaryFolder folder;
    {
        const FolderLock first = claim_folder(folder / "new/deep");
        EXPECT_EQ(config_error_of([&] { claim_folder(folder / "new/deep"); }),
                  (folder / "new/deep").string() +
                      ": is in use: another etalon is writing to this folder");
        EXPECT_NO_THROW(FolderLock(folder / "new"));
        EXPECT_TRUE(std::filesystem::is_empty(folder / "new/deep"));
    }
    EXPECT_NO_THROW(FolderLock(folder / "new/deep"));
    EXPECT_THAT(config_error_of([&] { FolderLock(folder / "none"); }),
                EndsWith("none: no such folder"));
}

// The names of the files in it that do not begin with a point.
std::set<std::string> seen_in(const std::filesystem::path& folder) {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (const std::string name = entry.path().filename(); name[0] != '.')
            names.insert(name);
    return names;
}

TEST(ReportFolder, LosesTheEarlierReportsFilesAndNoOthers) {
    const TemporaryFolder folder;
    const auto report = [&](const char* kind, std::initializer_list<const char*> names) {
        ReportFolder files(folder.path(), kind);
        EXPECT_THROW(ReportFolder(folder.path(), kind), ConfigError) << "at once";
        for (const char* name : names)
            write_text(files / name, kind);
        files.finish();
    };
    write_text(folder / "thesis.tex", "x");
    report("compare", {"1.png", "2.png", "report.html"});
    report("history", {"chart.svg"});
    {
        ReportFolder killed(folder.path(), "compare");
        write_text(killed / "3.png", "x");
    }
    using Names = std::set<std::string>;
    EXPECT_EQ(seen_in(folder.path()),
              (Names{"thesis.tex", "1.png", "2.png", "3.png", "report.html", "chart.svg"}));
    report("compare", {"1.png", "report.html"});
    EXPECT_EQ(seen_in(folder.path()), (Names{"thesis.tex", "1.png", "report.html", "chart.svg"}));
}

// ---- sha256

// The examples of FIPS 180-4's companion (NIST, "SHA-256 examples") and the NIST test vectors.
TEST(Sha256, AgreesWithThePublishedVectors) {
    EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    EXPECT_EQ(sha256(std::string(1'000'000, 'a')),
              "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

// One byte of 0xbd and 55, 56, 57, 64 zero bytes: the lengths around the padding's border.
TEST(Sha256, PadsEveryLengthAroundABlock) {
    EXPECT_EQ(sha256("\xbd"), "68325720aabd7c82f30f554b313d0570c95accbb7dc4b5aae11204c08ffe732b");
    EXPECT_EQ(sha256(std::string(55, '\0')),
              "02779466cdec163811d078815c633f21901413081449002f24aa3e80f0b88ef7");
    EXPECT_EQ(sha256(std::string(56, '\0')),
              "d4817aa5497628e7c77e6b606107042bbba3130888c5f47a375e6179be789fbb");
    EXPECT_EQ(sha256(std::string(57, '\0')),
              "65a16cb7861335d5ace3c60718b5052e44660726da4cd13bb745381b235a1785");
    EXPECT_EQ(sha256(std::string(64, '\0')),
              "f5a5fd42d16a20302798ef6ed309979b43003d2320d9f0e8ea9831a92759fb4b");
}

TEST(Sha256, OfAFileIsThatOfItsBytes) {
    const TemporaryFolder folder;
    const auto path = folder / "bytes.bin";
    for (const std::size_t size : {0, 63, 65536, 65537, 200003}) {
        std::string bytes(size, 'x');
        for (std::size_t i = 0; i < size; ++i)
            bytes[i] = static_cast<char>(i * 7 + i / 251);
        write_text(path, bytes);
        EXPECT_EQ(sha256_of_file(path), sha256(bytes)) << size;
    }
}

TEST(Sha256, RefusesAFileThatIsNotThere) {
    EXPECT_THROW(sha256_of_file("/nowhere/at/all"), ConfigError);
}

}  // namespace
}  // namespace etalon
