// A page as PDF, by the program `weasyprint` where it is there.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

namespace etalon {

// Makes `pdf` of the HTML file, and returns nothing; or says why there is none: the program is
// missing, fails, or takes longer than `patience` and is killed.
std::string write_pdf(const std::filesystem::path& html, const std::filesystem::path& pdf,
                      std::chrono::seconds patience = std::chrono::seconds(60),
                      const std::string& program = "weasyprint");

}  // namespace etalon
