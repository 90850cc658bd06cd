#include "core/config/csv_file.h"

#include "tests/test.h"

namespace etalon {
namespace {

class CsvFileTest : public testing::Test {
protected:
    CsvFile read(const std::string& text, std::initializer_list<std::string_view> headers = {}) {
        std::ofstream(path_, std::ios::binary) << text;
        return read_csv(path_, headers);
    }

    // Behind the file's name.
    template <class Read>
    std::string error_of(Read read) {
        return config_error_of(read).substr(path_.string().size());
    }

    TemporaryFolder folder_;
    std::filesystem::path path_ = folder_ / "t.csv";
};

TEST_F(CsvFileTest, IsTheSameWithAByteOrderMarkCarriageReturnsAndEmptyLines) {
    const std::string plain = "b,a\n7,-5.5\n11,name\n";
    for (const std::string& text : {plain, "\xef\xbb\xbf" + plain,
                                    std::string("\xef\xbb\xbf"
                                                "b,a\r\n7,-5.5\r\n11,name\r\n"),
                                    std::string("b, a\n7,-5.5 \n11 ,name"),
                                    std::string("b,a\r\n7,-5.5\r\n\r\n11,name\r\n\r\n")}) {
        const CsvFile file = read(text, {"x", "b,a"});
        ASSERT_EQ(file.rows.size(), 2u);
        EXPECT_EQ(file.rows[0].numbers(), (std::vector<double>{7, -5.5}));
        EXPECT_EQ(file.rows[1].number(file.column("b")), 11.0);
        EXPECT_EQ(file.rows[1].cells[1], "name");
    }
    EXPECT_EQ(read("a\r\n\r\n\r\n3\r\n").rows[0].place.line, 4);
}

TEST_F(CsvFileTest, NamesTheLineOfWhatIsWrong) {
    EXPECT_EQ(error_of([&] { read("", {"a,b", "c"}); }), ":1: the first line must be 'a,b' or 'c'");
    EXPECT_EQ(error_of([&] { read("a,b\n1,2\n\n1,2,3\n"); }),
              ":4: has 3 cells, not the header's 2");
    EXPECT_EQ(error_of([&] { read("a\n3\n").column("b"); }), ":1: the header lacks the column 'b'");
    EXPECT_EQ(error_of([&] { read("a\n3\nnan\n").rows[1].number(0); }),
              ":3: 'nan' is not a finite number");
    EXPECT_EQ(error_of([&] {
                  read("a\n-7\n").rows[0].number(0, {0.0, 5.0});
              }),
              ":2: -7 must be between 0 and 5");
}

TEST_F(CsvFileTest, RefusesWhatIsNoFileOrTooLarge) {
    EXPECT_EQ(error_of([&] { read_csv(path_); }), ": no such file");
    EXPECT_EQ(read("").header, std::vector<std::string>{""});
    std::filesystem::resize_file(path_, max_text_bytes + 1);
    EXPECT_EQ(error_of([&] { read_csv(path_); }), ": is larger than 64 MiB");
}

TEST(CsvReader, RefusesALineThatNeverEnds) {
    const TemporaryFolder folder;
    write_text(folder / "long.csv", "a,b\n1,2\n" + std::string(70'000, '7') + "\n");
    CsvReader reader(folder / "long.csv", {"a,b"});
    EXPECT_EQ(reader.next()->number(1), 2.0);
    EXPECT_THAT(config_error_of([&] { reader.next(); }),
                HasSubstr("long.csv:3: is longer than 64 KiB"));
}

}  // namespace
}  // namespace etalon
