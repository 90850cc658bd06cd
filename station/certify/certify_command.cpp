#include <fmt/format.h>

#include "core/file/file_writing.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "station/certify/certificate.h"
#include "station/qualify/recorded_run.h"
#include "station/record/record_json.h"
#include "station/record/run_record.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

struct CertifyArguments {
    std::filesystem::path record, form, out;
    std::string number;
    bool json = false;
};

// From the raw frames again: what is certified follows from the record and from nothing else.
QualifyResult analysed(const std::filesystem::path& record) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    StderrProgress progress;
    const FolderLock lock(record);
    return analyse_record(read_record(record, progress, stop.get_token()), progress,
                          stop.get_token());
}

void require_nothing_missing(const QualifyResult& run, const CertificateForm& form, bool json) {
    const std::vector<std::string> missing = missing_for_certificate(run, form);
    if (missing.empty())
        return;
    if (json)
        fmt::print("{}\n", text_of({{"missing", missing}}, 2));
    else
        for (const std::string& each : missing)
            fmt::print("missing {}\n", each);
    throw ConfigError({run.folder.string(), 0, {}},
                      fmt::format("cannot be certified, {} {} missing", missing.size(),
                                  missing.size() == 1 ? "thing is" : "things are"));
}

int run_certify(const CertifyArguments& arguments) {
    CertificateForm form = read_certificate_form(arguments.form);
    if (!arguments.number.empty())
        form.number = arguments.number;
    const QualifyResult run = analysed(arguments.record);
    require_nothing_missing(run, form, arguments.json);
    const Certificate certificate{run, form, utc_now().substr(0, 10),
                                  sha256_of_file(run.folder / log_file),
                                  sha256_of_file(run.folder / "run.json")};
    const FolderLock lock = claim_folder(arguments.out);
    const auto html = arguments.out / "certificate.html", pdf = arguments.out / "certificate.pdf";
    write_text(html, certificate_html(certificate));
    write_text(arguments.out / "dcc.xml", dcc_xml(certificate));
    const std::string no_pdf = write_pdf(html, pdf);
    if (!no_pdf.empty())
        print_stderr("etalon: no PDF: {}; print {} in a browser\n", no_pdf, html.string());
    const std::filesystem::path& shown = no_pdf.empty() ? pdf : html;
    if (arguments.json)
        fmt::print("{}", text_of({{"outcome", name(run.outcome)},
                                  {"certificate", shown.string()},
                                  {"dcc", (arguments.out / "dcc.xml").string()},
                                  {"no_pdf", no_pdf}},
                                 2) +
                             "\n");
    else
        fmt::print("verdict {}\ncertificate {}\ndcc {}\n", name(run.outcome), shown.string(),
                   (arguments.out / "dcc.xml").string());
    return 0;
}

}  // namespace

void declare_certify(Command& program) {
    auto [command, asked] = program.add(
        run_certify, "certify", "a calibration certificate of a run",
        "Analyses the record of a run again and writes certificate.pdf (by weasyprint;\n"
        "without it certificate.html) and dcc.xml, a Digital Calibration Certificate.\n"
        "What the record does not know, laboratory, customer, signer and number, is in\n"
        "the file of --form. A run whose inputs are not all traced to certificates that\n"
        "were in force is refused, with a list of what is missing: `references` and\n"
        "`environment` in station.yaml (docs/certificate.md). INCONCLUSIVE runs are\n"
        "certified without a statement of conformity. Exit code 0 when it is written,\n"
        "whatever the verdict.\n");
    command.required("RECORD", asked->record, "folder of the record");
    command.required("--form", asked->form, "certificate.yaml: laboratory, customer, signer",
                     "FILE");
    command.option("--number", asked->number, "of the certificate, in place of the file's",
                   "NUMBER");
    command.required("--out", asked->out, "folder of the certificate", "DIR");
}

}  // namespace etalon
