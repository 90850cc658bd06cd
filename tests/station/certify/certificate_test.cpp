
#include "station/certify/certificate.h"
#include "report/number_text.h"
#include "tests/paths.h"
#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

CertificateForm complete_form() {
    const PostalContact laboratory{"Optics <Lab>", "Main Road 1", "38116", "Braunschweig", "DE"};
    const PostalContact customer{"A & B Robotics", "Wall 7", "1010", "Vienna", "AT"};
    return {"2026-0042", laboratory, customer, "E. \"Ex\" Example", "Head"};
}

// One run of a true camera on a station whose references are there, for all tests.
class CertifiedRun : public testing::Test {
protected:
    static void SetUpTestSuite() {
        mocks_ = new StationOfMocks(std::string(station_text) + traced_text);
        show_a_true_camera(*mocks_);
        run_ = new QualifyResult(mocks_->run());
        run_->sessions[0].operator_name = "O. <Perator>";
    }
    static void TearDownTestSuite() {
        delete run_;
        delete mocks_;
    }
    static Certificate certificate(const QualifyResult& run) {
        return {run, complete_form(), "2026-03-09", std::string(64, 'a'), std::string(64, 'b')};
    }
    static std::vector<std::string> missing(const QualifyResult& run) {
        return missing_for_certificate(run, complete_form());
    }
    static QualifyResult copy() { return *run_; }
    static std::string page(const QualifyResult& run) { return certificate_html(certificate(run)); }
    static std::string xml(const QualifyResult& run) { return dcc_xml(certificate(run)); }

    static StationOfMocks* mocks_;
    static QualifyResult* run_;
};
StationOfMocks* CertifiedRun::mocks_ = nullptr;
QualifyResult* CertifiedRun::run_ = nullptr;

TEST_F(CertifiedRun, LacksNothing) {
    ASSERT_TRUE(run_->analysis) << run_->reason;
    EXPECT_THAT(missing(*run_), IsEmpty());
}

TEST_F(CertifiedRun, IsNotCertifiedWithAReferenceThatIsMissingOrWasOverdue) {
    QualifyResult run = copy();
    auto& references = run.station.references;
    std::erase_if(references, [](const auto& each) { return each.name == "stage scale y"; });
    for (TracedReference& each : references)
        if (each.name == "thermometer")
            each.due = days_of(run).first;  // still in force on that day
        else if (each.name == "marker flatness")
            each.due = "2026-02-04";
    run.started_utc = "2026-03-07T14:05:09Z";
    const auto found = missing(run);
    EXPECT_THAT(found,
                Contains("references.stage_scale.y in station.yaml: stage scale y is not traced"));
    EXPECT_THAT(found, Contains(HasSubstr("marker flatness: M-2 is of 2026-02-03 and was due "
                                          "2026-02-04, the run is of 2026-03-07")));
    EXPECT_EQ(found.size(), 2u);
}

TEST_F(CertifiedRun, IsNotCertifiedBeforeItsReferencesWere) {
    QualifyResult run = copy();
    run.started_utc = "2026-01-11T23:59:59Z";
    run.duration_s = 60.0;  // ends on the day of the stage's certificates
    EXPECT_THAT(missing(run), Contains(HasSubstr("stage scale x: S-1")));
    EXPECT_EQ(days_of(run).first, "2026-01-11");
    EXPECT_EQ(days_of(run).last, "2026-01-12");
}

TEST_F(CertifiedRun, IsNotCertifiedWithoutItsTemperature) {
    QualifyResult run = copy();
    run.environment.lost = "room sensor: no answer";
    EXPECT_THAT(missing(run),
                ElementsAre("the temperature during the whole run: room sensor: no answer"));
    run.environment.lost.clear();
    run.station.environment.reset();
    EXPECT_THAT(missing(run), ElementsAre(HasSubstr("environment in station.yaml")));
    run.station.environment = StationEnvironment{RoomSensor{}, {}, {}};
    EXPECT_THAT(missing(run), ElementsAre(HasSubstr("fewer than two readings")));
}

TEST_F(CertifiedRun, IsNotCertifiedWithoutWhatACertificateStates) {
    QualifyResult run = copy();
    run.camera.serial.clear();
    run.sessions.push_back(run.sessions[0]);
    run.sessions[1].operator_name.clear();
    CertificateForm form = complete_form();
    form.signer_name.clear();
    EXPECT_THAT(missing_for_certificate(run, form),
                ElementsAre(HasSubstr("serial number"), HasSubstr("the operator of the session of"),
                            "signer.name in the certificate's file"));
}

TEST_F(CertifiedRun, IsNotCertifiedWithAnUnknownInput) {
    QualifyResult run = copy();
    run.analysis->budget[3].standard_uncertainty.reset();
    EXPECT_THAT(missing(run), ElementsAre(HasSubstr(run.analysis->budget[3].source)));
}

TEST_F(CertifiedRun, IsNotCertifiedWhenItEndedEarlyOrMeasuredNothing) {
    QualifyResult run = copy();
    run.outcome = RunOutcome::aborted;
    run.reason = "interrupted";
    EXPECT_THAT(missing(run), Contains("a verdict: the run ended with ABORTED, interrupted"));
    run = copy();
    for (JudgedQuantity& each : run.analysis->quantities)
        each.measured = false;
    run.outcome = RunOutcome::inconclusive;
    EXPECT_THAT(missing(run), Contains(HasSubstr("nothing was measured")));
}

// The budget of a run that is certified has the measured temperature.
TEST_F(CertifiedRun, HasTheMeasuredTemperatureInItsBudget) {
    const auto& budget = run_->analysis->budget;
    const auto row = std::ranges::find(budget, "temperature", &BudgetRow::source);
    ASSERT_NE(row, budget.end());
    EXPECT_THAT(row->basis, HasSubstr("given by hand"));
    EXPECT_NEAR(row->standard_uncertainty.value(), std::sqrt(0.04 + 0.03 + 0.0025), 1e-12);
}

// Numbers with a decimal point in the cells of the results.
TEST_F(CertifiedRun, ShowsItsResultsWithTheDigitsOfTheirUncertainty) {
    const std::string page = this->page(*run_);
    for (const JudgedQuantity& each : run_->analysis->quantities) {
        const int decimals = decimals_of(each.expanded_uncertainty);
        const std::string cells = "<td class=\"n\">" + fixed(each.value, decimals) +
                                  "</td><td class=\"n\">" +
                                  fixed(each.expanded_uncertainty, decimals) + "</td>";
        EXPECT_THAT(page, HasSubstr(cells)) << each.name;
    }
    for (const char* text : {"S-2", "T-1", "2999-01-12", "CAM-7", "test-limits-5", "guarded",
                             "19.90 to 20.50 °C", "Certificate 2026-0042"})
        EXPECT_THAT(page, HasSubstr(text));
}

TEST_F(CertifiedRun, EscapesWhatPeopleAndDevicesSay) {
    QualifyResult run = copy();
    run.camera.vendor = "<script>\x01";
    for (const std::string& text : {page(run), xml(run)}) {
        EXPECT_THAT(text, Not(HasSubstr("<script>")));
        EXPECT_THAT(text, HasSubstr("Optics &lt;Lab&gt;"));
        EXPECT_THAT(text, HasSubstr("A &amp; B Robotics"));
        EXPECT_THAT(text, HasSubstr("O. &lt;Perator&gt;"));
        EXPECT_THAT(text, HasSubstr("Laboratory &lt;B&gt; &amp; Sons"));
    }
    EXPECT_THAT(xml(run), Not(HasSubstr("\x01")));
}

TEST_F(CertifiedRun, SaysThatItWasResumedAndWhyThereIsNoVerdict) {
    QualifyResult run = copy();
    run.sessions.push_back(run.sessions[0]);
    run.outcome = RunOutcome::inconclusive;
    run.analysis->reasons = {"the limit lies within the uncertainty"};
    const std::string page = this->page(run), xml = this->xml(run);
    EXPECT_THAT(page, HasSubstr("interrupted and resumed: 2 sessions"));
    EXPECT_THAT(page, HasSubstr("no statement of conformity"));
    EXPECT_THAT(page, HasSubstr("the limit lies within the uncertainty"));
    EXPECT_THAT(xml.substr(0, xml.find("dcc:measurementResults")),
                Not(HasSubstr("<dcc:conformity>")));
}

std::vector<std::string> contents(const std::string& xml, const std::string& element) {
    const std::regex pattern("<" + element + ">([^<]*)</" + element + ">");
    std::vector<std::string> found;
    for (std::sregex_iterator one(xml.begin(), xml.end(), pattern), end; one != end; ++one)
        found.push_back((*one)[1]);
    return found;
}

TEST_F(CertifiedRun, GivesMachinesEveryResultToTheLastBit) {
    const std::string xml = this->xml(*run_);
    const std::string results = xml.substr(xml.find("<dcc:results>"));
    const auto values = contents(results, "si:value"),
               uncertainties = contents(results, "si:uncertainty"),
               factors = contents(results, "si:coverageFactor"),
               units = contents(results, "si:unit");
    std::vector<JudgedQuantity> all = run_->analysis->quantities;
    for (const JudgedQuantity& each : run_->analysis->reported)
        if (each.measured)
            all.push_back(each);
    ASSERT_EQ(values.size(), all.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
        EXPECT_EQ(parse_number(values[i]), all[i].value);
        EXPECT_EQ(parse_number(uncertainties[i]), all[i].expanded_uncertainty);
        EXPECT_EQ(parse_number(factors[i]), all[i].coverage_factor);
    }
    EXPECT_EQ(units[0], "\\milli\\metre");
    EXPECT_EQ(contents(xml, "dcc:beginPerformanceDate")[0], days_of(*run_).first);
    EXPECT_EQ(contents(xml, "dcc:uniqueIdentifier")[0], "2026-0042");
}

// Order, number and form of its elements, by a second program.
TEST_F(CertifiedRun, GivesMachinesTheStructureOfADigitalCalibrationCertificate) {
    if (std::system("command -v xmllint >/dev/null") != 0)
        GTEST_SKIP() << "xmllint is not there (package libxml2-utils)";
    const std::string check = "xmllint --noout --relaxng " ETALON_SOURCE_DIR
                              "/tests/station/certify/dcc-3.2.rng " +
                              (mocks_->folder / "dcc.xml").string() + " 2>/dev/null";
    const auto is_valid = [&](const std::string& xml) {
        write_text(mocks_->folder / "dcc.xml", xml);
        return std::system(check.c_str()) == 0;
    };
    const std::string xml = this->xml(*run_);
    EXPECT_TRUE(is_valid(xml)) << xml;
    for (const char* element : {"dcc:customer", "dcc:coreData", "dcc:respPersons", "dcc:items",
                                "dcc:results", "si:unit", "si:coverageFactor"})
        EXPECT_FALSE(is_valid(std::regex_replace(xml, std::regex(element), "dcc:other")))
            << element;
    QualifyResult odd = copy();
    odd.camera.vendor.clear();
    odd.camera.model = " \t";
    odd.outcome = RunOutcome::inconclusive;
    EXPECT_TRUE(is_valid(this->xml(odd)));
}

// 95.45 % is two-sided of k = 2; of pixels k is 3 and nothing else.
TEST(Coverage, IsTwoSided) {
    EXPECT_NEAR(coverage_of({.coverage_factor = 2.0}), 0.9545, 1e-4);
    EXPECT_NEAR(coverage_of({.coverage_factor = 3.0}), 0.9973, 1e-4);
    EXPECT_NEAR(coverage_of({.coverage_factor = coverage_factor(5.0), .degrees_of_freedom = 5.0}),
                0.9545, 1e-4);
}

CertificateForm read(const std::string& text) {
    const TemporaryFolder folder;
    write_text(folder / "certificate.yaml", text);
    return read_certificate_form(folder / "certificate.yaml");
}

std::string form_error(const std::string& text) {
    return config_error_of([&] { read("etalon: certificate/1\n" + text); });
}

TEST(CertificateForm, GivesWhatTheExampleSays) {
    const CertificateForm form =
        read_certificate_form(ETALON_SOURCE_DIR "/examples/every-key/certificate.yaml");
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
    EXPECT_THAT(form_error("numbers: 7\n"), HasSubstr("numbers"));
    EXPECT_THAT(form_error("number: \"\"\n"), HasSubstr("number: must be a line of text"));
    EXPECT_THAT(form_error("number: \"a\\nb\"\n"), HasSubstr("must be a line of text"));
    EXPECT_THAT(form_error("customer: {country: Germany}\n"), HasSubstr("customer.country"));
}

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
