#include "station/certify/pdf_file.h"

#include <fmt/format.h>

#include <csignal>
#include <system_error>

#include "core/process/subprocess.h"

namespace etalon {

std::string write_pdf(const std::filesystem::path& html, const std::filesystem::path& pdf,
                      std::chrono::seconds patience, const std::string& program) try {
    std::error_code ignored;
    std::filesystem::remove(pdf, ignored);  // one from before would be taken for this one's
    Subprocess process({program, html.string(), pdf.string()});
    if (!process.wait_for(patience)) {
        process.send(SIGKILL);
        return fmt::format("{} took longer than {} s", program, patience.count());
    }
    if (process.result().exit_code != 0 || !std::filesystem::exists(pdf, ignored))
        return fmt::format("{} failed; `{} {} {}` says why", program, program, html.string(),
                           pdf.string());
    return "";
} catch (const std::system_error&) {
    return fmt::format("{} is not installed", program);
}

}  // namespace etalon
