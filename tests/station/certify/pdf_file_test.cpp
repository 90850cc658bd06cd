#include "station/certify/certificate.h"

#include <gmock/gmock.h>

#include "core/file/text.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

// In weasyprint's place other programs that are called with two files.
class PdfFile : public testing::Test {
protected:
    PdfFile() {
        write_text(folder_ / "page.html", "<p>7</p>");
        write_text(folder_ / "page.pdf", "of before");
    }
    std::string written_by(const std::string& program, std::chrono::seconds patience = 60s) const {
        return write_pdf(folder_ / "page.html", folder_ / "page.pdf", patience, program);
    }
    bool is_there() const { return std::filesystem::exists(folder_ / "page.pdf"); }

    TemporaryFolder folder_;
};

TEST_F(PdfFile, IsWhatTheProgramMakes) {
    EXPECT_EQ(written_by("cp"), "");
    EXPECT_EQ(read_text(folder_ / "page.pdf"), "<p>7</p>");
}

TEST_F(PdfFile, IsNotThereWithoutTheProgram) {
    EXPECT_EQ(written_by("no-such-weasyprint"), "no-such-weasyprint is not installed");
    EXPECT_FALSE(is_there());
}

TEST_F(PdfFile, IsNotTheOneOfBeforeWhenTheProgramFails) {
    EXPECT_THAT(written_by("false"), HasSubstr("false failed"));
    EXPECT_THAT(written_by("true"), HasSubstr("true failed"));  // it makes none
    EXPECT_FALSE(is_there());
}

// A pipe that nobody writes to is read for ever.
TEST_F(PdfFile, IsNotWaitedForForEver) {
    std::filesystem::remove(folder_ / "page.html");
    ASSERT_EQ(std::system(("mkfifo " + (folder_ / "page.html").string()).c_str()), 0);
    EXPECT_EQ(written_by("cp", 0s), "cp took longer than 0 s");
}

}  // namespace
}  // namespace etalon
