#include "station/qualify/junit.h"

#include <fmt/format.h>

#include "core/file/text.h"

namespace etalon {
namespace {

struct TestCase {
    std::string name, text;  // text: what was found, in one sentence
    std::string element;     // "failure", "error", "skipped"; empty: passed
    std::string outcome;     // "INCONCLUSIVE"
};

// XML 1.0 has no place for control characters, escaped or not; bytes that are not ASCII are
// replaced, as nothing says that they are UTF-8.
std::string xml_text(const std::string& text) {
    std::string plain = text;
    for (char& c : plain)
        if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e)
            c = c == '\n' ? ' ' : '?';
    return escape_html(plain);
}

std::string element_of(Outcome outcome) {
    switch (outcome) {
        case Outcome::pass:
            return "";
        case Outcome::fail:
            return "failure";
        case Outcome::inconclusive:
            return "error";
        case Outcome::not_observable:
        case Outcome::skipped:
            return "skipped";
    }
    return "error";
}

std::string measured_text(const JudgedQuantity& quantity) {
    if (quantity.outcome == Outcome::skipped)
        return quantity.reason;
    const std::string text =
        fmt::format("{:.4g} {} with U = {:.3g} {} (k = {:.3g}) against a limit of {:.4g} {}",
                    quantity.value, quantity.unit, quantity.expanded_uncertainty, quantity.unit,
                    quantity.coverage_factor, quantity.limit, quantity.unit);
    return quantity.reason.empty() ? text : text + ": " + quantity.reason;
}

TestCase verdict_case(const QualifyResult& result) {
    TestCase verdict{"verdict", result.reason, "error", name(result.outcome)};
    if (result.outcome == RunOutcome::pass)
        verdict.element = "";
    if (result.outcome == RunOutcome::fail)
        verdict.element = "failure";
    if (verdict.text.empty() && result.analysis)
        verdict.text = fmt::format("{}", fmt::join(result.analysis->reasons, " "));
    return verdict;
}

std::vector<TestCase> cases_of(const QualifyResult& result) {
    std::vector<TestCase> cases;
    if (result.analysis)
        for (const JudgedQuantity& quantity : result.analysis->quantities)
            cases.push_back({quantity.name, measured_text(quantity), element_of(quantity.outcome),
                             name(quantity.outcome)});
    cases.push_back(verdict_case(result));
    return cases;
}

std::string xml_of(const TestCase& test, const std::string& class_name) {
    std::string xml = fmt::format("    <testcase classname=\"{}\" name=\"{}\" time=\"0\">",
                                  xml_text(class_name), xml_text(test.name));
    if (test.element == "skipped")
        xml += fmt::format("<skipped message=\"{}: {}\"/>", test.outcome, xml_text(test.text));
    else if (!test.element.empty())
        xml += fmt::format("<{0} type=\"{1}\" message=\"{2}\">{2}</{0}>", test.element,
                           test.outcome, xml_text(test.text));
    else
        xml += fmt::format("<system-out>{}</system-out>", xml_text(test.text));
    return xml + "</testcase>\n";
}

}  // namespace

std::string junit_xml(const QualifyResult& result) {
    const std::vector<TestCase> cases = cases_of(result);
    const auto count = [&](const char* element) {
        return std::count_if(cases.begin(), cases.end(),
                             [&](const TestCase& test) { return test.element == element; });
    };
    const std::string counts = fmt::format(
        "tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\" time=\"{:.3f}\"", cases.size(),
        count("failure"), count("error"), count("skipped"), result.duration_s);
    const std::string camera =
        result.camera.serial.empty() ? result.camera.uri : result.camera.serial;
    std::string xml = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    xml += fmt::format("<testsuites {}>\n  <testsuite name=\"{}\" {} timestamp=\"{}\">\n", counts,
                       xml_text("camera " + camera), counts, xml_text(result.started_utc));
    for (const TestCase& test : cases)
        xml += xml_of(test, "etalon." + result.station.id);
    return xml + "  </testsuite>\n</testsuites>\n";
}

}  // namespace etalon
