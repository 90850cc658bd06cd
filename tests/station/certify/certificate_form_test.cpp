#include "station/certify/certificate.h"

#include <gmock/gmock.h>

#include "core/file/text.h"
#include "tests/paths.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::filesystem::path example =
    std::filesystem::path(ETALON_SOURCE_DIR) / "examples/every-key/certificate.yaml";

CertificateForm read(const std::string& text) {
    const TemporaryFolder folder;
    write_text(folder / "certificate.yaml", text);
    return read_certificate_form(folder / "certificate.yaml");
}

std::string refusal(const std::string& text) {
    try {
        read("etalon: certificate/1\n" + text);
    } catch (const ConfigError& error) {
        return error.what();
    }
    return "";
}

TEST(CertificateForm, GivesWhatTheExampleSays) {
    const CertificateForm form = read_certificate_form(example);
    EXPECT_EQ(form.number, "2026-0042");
    EXPECT_EQ(form.customer.name, "A & B Robotics");
    EXPECT_EQ(address_of(form.laboratory), "Main Road 1, 38116 Braunschweig, DE");
    EXPECT_EQ(form.signer_role, "Head of the laboratory");
    EXPECT_THAT(missing_keys(form), IsEmpty());
}

TEST(CertificateForm, ListsEveryKeyThatIsMissing) {
    const CertificateForm form = read(
        "etalon: certificate/1\nlaboratory: {name: A, street: B, city: C, country: DE}\n"
        "customer: {name: A, street: B, postcode: C, city: D, country: AT}\n");
    EXPECT_THAT(missing_keys(form),
                ElementsAre("number", "laboratory.postcode", "signer.name", "signer.role"));
}

TEST(CertificateForm, RefusesWhatCannotBePrinted) {
    EXPECT_THAT(refusal("numbers: 7\n"), HasSubstr("numbers"));
    EXPECT_THAT(refusal("number: \"\"\n"), HasSubstr("number: must be a line of text"));
    EXPECT_THAT(refusal("number: \"a\\nb\"\n"), HasSubstr("must be a line of text"));
    EXPECT_THAT(refusal("customer: {country: Germany}\n"), HasSubstr("customer.country"));
}

}  // namespace
}  // namespace etalon
