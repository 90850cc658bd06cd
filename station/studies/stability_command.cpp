// `etalon stability`: every stiff and extreme case of rendering and projection, as a table.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "bench/stability/stability_case.h"
#include "core/program/errors.h"
#include "report/json_text.h"
#include "station/shell/command.h"
#include "station/studies/commands.h"

namespace etalon {
namespace {

// Exit code 1 when a case fails.
struct StabilityArguments {
    bool json = false;
};

struct CaseRow {
    StabilityCase one;
    StabilityOutcome outcome;
    double seconds;
};

CaseRow run(const StabilityCase& one) {
    const auto start = std::chrono::steady_clock::now();
    const StabilityOutcome outcome = outcome_of(one, render_once);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    return {one, outcome, taken.count()};
}

// At most 80 columns: 33 + 23 + 9 + 9 + 6.
void print_row(const CaseRow& row) {
    const auto& [one, outcome, seconds] = row;
    const bool has_figure = outcome.bound > 0.0 || outcome.figure > 0.0;
    const std::string figure = has_figure ? fmt::format("{:.2e}", outcome.figure) : "-";
    const std::string bound = has_figure ? fmt::format("{:.2e}", outcome.bound) : "-";
    fmt::print("{:<32} {:<22} {:>8} {:>8}  {}\n", one.name, one.expectation, figure, bound,
               outcome.passed ? "ok" : "FAIL");
    if (!outcome.passed)
        fmt::print("    {}\n", outcome.words);
    std::fflush(stdout);
}

Json json_of(const CaseRow& row) {
    return {{"case", row.one.name},         {"expectation", row.one.expectation},
            {"outcome", row.outcome.words}, {"figure", row.outcome.figure},
            {"bound", row.outcome.bound},   {"ok", row.outcome.passed},
            {"seconds", row.seconds}};
}

int run_stability(const StabilityArguments& arguments) {
    std::vector<CaseRow> rows;
    std::size_t failed = 0;
    if (!arguments.json)
        fmt::print("{:<32} {:<22} {:>8} {:>8}\n", "case", "expectation", "figure", "bound");
    for (const StabilityCase& one : stability_cases()) {
        rows.push_back(run(one));
        failed += !rows.back().outcome.passed;
        if (!arguments.json)
            print_row(rows.back());
    }
    if (arguments.json)
        std::puts(Json{{"cases", json_list(rows, [](const CaseRow& row) { return json_of(row); })},
                       {"count", rows.size()},
                       {"failed", failed}}
                      .dump(1)
                      .c_str());
    else
        fmt::print("{} cases, {} failed\n", rows.size(), failed);
    return failed == 0 ? 0 : 1;
}

}  // namespace

void declare_stability(Command& program) {
    program.add(run_stability, "stability", "run every stiff and extreme rendering case",
                "Nearly edge-on markers, focus, folds, NaN, 100 megapixels ...: each must be\n"
                "right against the reference integrator, or refused. Prints a table and\n"
                "`N cases, M failed`; exit code 1 when one failed. About a minute and a half on\n"
                "two cores. Explained in docs/stability.md.\n");
}

}  // namespace etalon
