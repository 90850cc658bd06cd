// `etalon plan`: what this plan will see, before anything moves.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "station/planning/simulated_run.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

struct PlanArguments {
    std::filesystem::path station;
    bool json = false;
};

constexpr int noisy_frames = 8;
constexpr int simulated_runs = 20;

struct ExpectedQuantity {
    std::string name, unit;
    double limit = 0.0, uncertainty = 0.0;  // U, mean over the simulated runs
    // What each input of the budget gives to u, mean over the runs; the order is the budget's.
    std::vector<std::pair<std::string, double>> contributions;
};

struct Forecast {
    std::vector<ExpectedQuantity> quantities;
    Qualification first;  // of which all have the signatures
    int runs = 0;
};

void add(const Qualification& run, Forecast& forecast) {
    ++forecast.runs;
    for (std::size_t k = 0; k < run.quantities.size(); ++k) {
        const JudgedQuantity& quantity = run.quantities[k];
        if (forecast.quantities.size() <= k)
            forecast.quantities.push_back({quantity.name, quantity.unit, quantity.limit, 0.0, {}});
        ExpectedQuantity& expected = forecast.quantities[k];
        expected.uncertainty += quantity.expanded_uncertainty / simulated_runs;
        for (std::size_t i = 0; i < run.budget.size(); ++i) {
            const BudgetRow& row = run.budget[i];
            if (expected.contributions.size() <= i)
                expected.contributions.emplace_back(row.source, 0.0);
            if (row.counted)
                expected.contributions[i].second +=
                    row.contribution(quantity.name) / simulated_runs;
        }
    }
}

// Runs of the station as it is told: nothing is wrong in them but what it declares.
Forecast forecast_of(const RunSimulator& simulator) {
    Forecast forecast;
    for (int i = 0; i < simulated_runs; ++i) {
        QualificationInput input =
            simulator.draw(simulator.as_told(), 1, static_cast<std::uint64_t>(i));
        if (!forecast.first.signatures.empty())
            input.options.known_run = &forecast.first;
        const Qualification run = qualify(input);
        if (!run.position_field)
            throw NumericalError(
                fmt::format("this plan cannot be judged: {}", fmt::join(run.reasons, "; ")));
        if (forecast.first.signatures.empty())
            forecast.first = run;
        add(run, forecast);
    }
    return forecast;
}

void print_plan(const RunSimulator& simulator) {
    const auto hold_out = std::ranges::count(simulator.plan().poses, true, &PlannedPose::hold_out);
    fmt::print("plan of {}: {} poses, {} to register and {} to judge, {} frames each\n",
               simulator.station().id, simulator.plan().poses.size(),
               std::ssize(simulator.plan().poses) - hold_out, hold_out,
               simulator.station().plan.frames);
    fmt::print("about {} of motion and photographs, then the analysis\n{}",
               duration_text(simulator.plan().expected_duration), detector_text(simulator.study()));
}

// "b3_position_field_rms_mm: image noise 0.051, registration 0.022": the largest first.
std::string composition(const ExpectedQuantity& quantity) {
    constexpr std::size_t most = 5;
    constexpr double worth_a_word = 0.1;  // of U
    auto rows = quantity.contributions;
    std::ranges::stable_sort(rows, std::ranges::greater{}, &std::pair<std::string, double>::second);
    std::string text = "  " + quantity.name;
    for (std::size_t i = 0; i < std::min(most, rows.size()); ++i)
        if (2.0 * rows[i].second > worth_a_word * quantity.uncertainty)
            text += fmt::format("\n    {:<28} {:.4f} {}", rows[i].first, 2.0 * rows[i].second,
                                quantity.unit);
    return text;
}

void print_quantities(const Forecast& forecast) {
    fmt::print("\n{:<30} {:>10} {:>12} {:>10}\n", "judged quantity", "limit", "expected U",
               "U / limit");
    for (const ExpectedQuantity& one : forecast.quantities)
        fmt::print("{:<30} {:>10} {:>12} {:>10.3f}\n", one.name,
                   fmt::format("{:.4g} {}", one.limit, one.unit),
                   fmt::format("{:.4f} {}", one.uncertainty, one.unit),
                   one.uncertainty / one.limit);
    fmt::print("\nwhat these U are made of (2 u):\n");
    for (const ExpectedQuantity& one : forecast.quantities)
        fmt::print("{}\n", composition(one));
}

void print_errors(const std::vector<ErrorSignature>& signatures) {
    fmt::print("\n{:<28} {:>12} {:>14}   alike\n", "error", "detectable", "leaves mm RMS");
    for (const ErrorSignature& one : signatures)
        if (one.observable) {
            const std::size_t others = one.confounded_with.size();
            const std::string alike =
                others == 0   ? ""
                : others == 1 ? one.confounded_with[0]
                              : fmt::format("{} and {} more", one.confounded_with[0], others - 1);
            // What the smallest size that is detected leaves.
            const double left_mm = one.after_rms_mm * one.detectable_size / std::abs(one.size);
            fmt::print("{:<28} {:>12} {:>14.4f}   {:.19}\n", one.name,
                       size_text(one.detectable_size, one.unit), left_mm, alike);
        }
    fmt::print("\nNOT_OBSERVABLE: no run of this plan says anything of\n");
    for (const ErrorSignature& one : signatures)
        if (!one.observable)
            fmt::print("  {}: {}\n", one.name, one.reason);
    fmt::print("detectable: found in 95 % of runs; alike: cannot be told apart (all: --json)\n");
}

Json json_of(const ErrorSignature& one) {
    return {{"name", one.name},
            {"unit", one.unit},
            {"outcome", one.observable ? "OBSERVABLE" : "NOT_OBSERVABLE"},
            {"reason", one.reason},
            {"size", one.size},
            {"before_rms_mm", one.before_rms_mm},
            {"before_max_mm", one.before_max_mm},
            {"after_rms_mm", one.after_rms_mm},
            {"after_max_mm", one.after_max_mm},
            {"detectable_size", one.detectable_size},
            {"alike", one.confounded_with}};
}

Json json_of(const RunSimulator& simulator, const Forecast& forecast) {
    const DetectorFigures detector = simulator.study();
    const auto hold_out = std::ranges::count(simulator.plan().poses, true, &PlannedPose::hold_out);
    Json quantities = Json::array();
    for (const ExpectedQuantity& one : forecast.quantities) {
        Json budget = Json::object();
        for (const auto& [source, contribution] : one.contributions)
            budget[source] = contribution;
        quantities.push_back({{"name", one.name},
                              {"unit", one.unit},
                              {"limit", one.limit},
                              {"expected_uncertainty", one.uncertainty},
                              {"uncertainty_over_limit", one.uncertainty / one.limit},
                              {"standard_uncertainty_of_inputs", budget}});
    }
    return {
        {"etalon", "plan-forecast/1"},
        {"station", simulator.station().id},
        {"poses", simulator.plan().poses.size()},
        {"hold_out", hold_out},
        {"duration_s", std::chrono::duration<double>(simulator.plan().expected_duration).count()},
        {"detected_poses", detector.seen},
        {"noise_px", detector.noise_px},
        {"bias_px", detector.bias_px},
        {"simulated_runs", forecast.runs},
        {"quantities", quantities},
        {"errors", json_list(forecast.first.signatures,
                             [](const ErrorSignature& one) { return json_of(one); })}};
}

int run_plan(const PlanArguments& arguments) {
    const auto simulator = study_plan(arguments.station, noisy_frames);
    const auto forecast = attempted([&] { return forecast_of(*simulator); });
    if (!forecast)
        throw NumericalError(fmt::format("{}: a run as it declares ends with: {}",
                                         arguments.station.string(), forecast.cause));
    if (const std::string exact = exact_knowledge(simulator->station()); !exact.empty())
        print_stderr("{}\n", exact);
    if (arguments.json) {
        fmt::print("{}\n", json_of(*simulator, *forecast.value).dump(1));
        return 0;
    }
    print_plan(*simulator);
    print_quantities(*forecast.value);
    print_errors(forecast.value->first.signatures);
    return 0;
}

}  // namespace

void declare_plan(Command& program) {
    auto [command, asked] = program.add(
        run_plan, "plan", "what a station's plan will see, before anything moves",
        "Renders and detects every pose of the plan, with noise, and simulates 20 runs:\n"
        "run time, the expected U of each judged quantity, the smallest size of each\n"
        "error that is detected, which errors cannot be told apart and which cannot be\n"
        "seen at all. The station file needs camera_mount, the calibration a sensor.\n"
        "Some ten seconds. Explained in docs/operating-characteristic.md.\n");
    command.required("STATION", asked->station, "station.yaml");
}

}  // namespace etalon
