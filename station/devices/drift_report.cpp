#include "station/devices/drift_report.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <cstdio>

#include "capture/camera_recovery.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/html.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "station/record/record_json.h"
#include "station/record/run_record.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

// Growth and turn, which are px at one radius, as what they are: of a frame or a jump.
template <class Moved>
double scale_ppm(const Moved& moved) {
    return 1e6 * moved.movement[2] / moved.radius_px;
}
template <class Moved>
double rotation_urad(const Moved& moved) {
    return 1e6 * moved.movement[3] / moved.radius_px;
}

double radius_of(const DriftMonitor& monitor) {
    for (auto frame = monitor.frames().rbegin(); frame != monitor.frames().rend(); ++frame)
        if (frame->seen)
            return frame->radius_px;
    return 1.0;
}

Json rate_json(const DriftRate& rate) {
    return {{"from_min", rate.from.count()},
            {"to_min", rate.to.count()},
            {"px_per_min", numbers_of(rate.per_min)},
            {"standard_uncertainty", numbers_of(rate.standard_uncertainty)},
            {"worst_px_per_min", rate.worst_px_per_min},
            {"worst_pixel", numbers_of(rate.worst_pixel)},
            {"worst_standard_uncertainty_px_per_min", rate.standard_uncertainty_px_per_min},
            {"coverage_factor", rate.coverage_factor},
            {"worst_expanded_uncertainty_px_per_min", rate.expanded_uncertainty_px_per_min},
            {"bound_px_per_min", rate.bound_px_per_min},
            {"shape_px_per_min", rate.shape_px_per_min},
            {"block_correlation", rate.block_correlation}};
}

ResultTable jump_table(const DriftMonitor& monitor) {
    const ColumnsOf<DriftJump> columns = {
        {"time_min", [](const auto& jump) { return jump.time.count(); }, "minute", "", "{:.2f}"},
        {"size_px", &DriftJump::size_px, "size px", "", "{:.3f}"},
        {"shift_px",
         [](const auto& jump) {
             return std::vector{jump.movement[0], jump.movement[1]};
         }},
        {"", [](const auto& jump) { return jump.movement[0]; }, "shift x px", "", "{:.3f}"},
        {"", [](const auto& jump) { return jump.movement[1]; }, "shift y px", "", "{:.3f}"},
        {"scale_ppm", scale_ppm<DriftJump>, "scale ppm", "", "{:.0f}"},
        {"rotation_urad", rotation_urad<DriftJump>, "rotation µrad", "", "{:.0f}"}};
    return table_of(columns, monitor.jumps());
}

long frames_without_target(const DriftMonitor& monitor) {
    return std::count_if(monitor.frames().begin(), monitor.frames().end(),
                         [](const DriftFrame& frame) { return !frame.seen; });
}

std::string in_words(const DriftRate& rate) {
    return fmt::format("{:.4f} px/min, U = {:.4f} px/min (k = {:.2f})", rate.worst_px_per_min,
                       rate.expanded_uncertainty_px_per_min, rate.coverage_factor);
}

// Why the last rate was not called stable.
std::string obstacle(const DriftResult& result) {
    const DriftMonitor& monitor = result.monitor;
    const double limit = monitor.plan().limit_px_per_min;
    if (monitor.rates().empty())
        return "too few frames showed the target for a rate";
    const DriftRate& rate = monitor.rates().back();
    if (rate.worst_px_per_min >= limit)
        return fmt::format("it drifts: {}", in_words(rate));
    if (rate.bound_px_per_min >= limit)
        return "too uncertain: " + in_words(rate) +
               "; more frames, or a target that fills more of the image, would tell";
    if (rate.shape_px_per_min >= limit)
        return fmt::format("the target's points drift against each other by {:.3f} px/min",
                           rate.shape_px_per_min);
    return "something jumped just before the end";
}

Facts facts_of(const DriftResult& result, const std::string& target) {
    const DriftMonitor& monitor = result.monitor;
    const auto px = [](const std::optional<double>& value) {
        return value ? fmt::format("{:.4f} px", *value) : "unknown";
    };
    Facts facts = {
        {"limit", fmt::format("{} px/min anywhere in the image", monitor.plan().limit_px_per_min)},
        {"camera", result.camera.uri + " " + result.camera.serial},
        {"target", target},
        {"began", result.started_utc},
        {"watched",
         fmt::format("{:.1f} min, {} frames", result.duration.count(), monitor.frames().size())},
        {"frames without target", std::to_string(frames_without_target(monitor))},
        {"noise of a point", px(monitor.point_noise_px())},
        {"shake of the target", px(monitor.shake_px())},
        {"jumps", std::to_string(monitor.jumps().size())}};
    if (monitor.rates().empty())
        return facts;
    const DriftRate& rate = monitor.rates().back();
    const double per_radius = 1e6 / radius_of(monitor);
    const auto add = [&](const char* name, int i, double factor, const char* unit) {
        facts.emplace_back(name, fmt::format("{:.3g} ± {:.2g} {}/min", factor * rate.per_min[i],
                                             2.0 * factor * rate.standard_uncertainty[i], unit));
    };
    add("shift x (U: k = 2)", 0, 1.0, "px");
    add("shift y", 1, 1.0, "px");
    add("scale", 2, per_radius, "ppm");
    add("rotation", 3, per_radius, "µrad");
    facts.emplace_back("between its points", fmt::format("{:.3g} px/min", rate.shape_px_per_min));
    return facts;
}

void add_summary(HtmlPage& page, const DriftResult& result, const std::string& target) {
    std::string sentence = result.reason.empty() ? "" : result.reason + "; ";
    sentence += result.stable
                    ? drift_sentence(result) + ": " + in_words(result.monitor.rates().back())
                    : obstacle(result);
    page.add_verdict(result.stable ? "STABLE" : "NOT STABLE", sentence);
    page.add_facts(facts_of(result, target));
}

std::string movement_plot(const DriftMonitor& monitor) {
    constexpr const char* names[] = {"shift x", "shift y", "growth", "turn"};
    constexpr Color inks[] = {Color::blue, Color::orange, Color::green, Color::red};
    SvgPlot plot("minutes", "movement, px");
    // A point per block's worth of frames is enough for the eye, and keeps the page small.
    const std::size_t step = std::max<std::size_t>(1, monitor.frames().size() / 600);
    for (int i = 0; i < 4; ++i) {
        Series movement;
        for (std::size_t n = 0; n < monitor.frames().size(); n += step)
            if (const DriftFrame& frame = monitor.frames()[n]; frame.seen)
                movement.add(frame.time.count(), frame.movement[i]);
        plot.add_points(movement, inks[i], names[i]);
    }
    return plot.svg();
}

std::string rate_plot(const DriftMonitor& monitor) {
    Series worst;
    for (const DriftRate& rate : monitor.rates())
        worst.add(rate.to.count(), rate.worst_px_per_min,
                  std::max(0.0, rate.worst_px_per_min - rate.expanded_uncertainty_px_per_min),
                  rate.bound_px_per_min);
    SvgPlot plot("minutes", "worst drift over the image, px/min");
    plot.add_band(worst, Color::blue, "with U");
    plot.add_line(worst, Color::blue, "drift");
    plot.add_level(monitor.plan().limit_px_per_min, Color::red, "limit");
    return plot.svg();
}

void add_jumps(HtmlPage& page, const DriftMonitor& monitor) {
    if (monitor.jumps().empty())
        return;
    page.add_heading("Jumps");
    page.add_paragraph(
        "The image moved from one frame to the next: the target, the camera or what they stand on "
        "was touched, or a part of the lens slipped. No drift is taken over a jump: it is judged "
        "again from there.");
    page.add_table(jump_table(monitor));
}

void add_limits_of_the_method(HtmlPage& page) {
    page.add_heading("What this cannot tell");
    page.add_notes(
        {"Whether the camera moved or the target: a static target shows the drift of one against "
         "the other. Both must stand on one rigid base, and lamps must not warm the target.",
         "What a growth is: a change of focal length, or of distance. One of 100 ppm is 50 µm at "
         "500 mm.",
         "Fluctuations that are slower than the minutes which a rate is taken over count as drift, "
         "or hide it; and what happens later, when the room or the load of the camera changes."});
}

std::string drift_csv(const DriftResult& result) {
    // Nothing of a frame without the target.
    const auto where_seen = [](auto value) {
        return [=](const DriftFrame& frame) {
            return frame.seen ? TableCell(value(frame)) : TableCell();
        };
    };
    const ColumnsOf<DriftFrame> columns = {
        {"time_min", [](const auto& frame) { return frame.time.count(); }},
        {"seen", &DriftFrame::seen},
        {"part", &DriftFrame::part},
        {"shift_x_px", where_seen([](const auto& frame) { return frame.movement[0]; })},
        {"shift_y_px", where_seen([](const auto& frame) { return frame.movement[1]; })},
        {"scale_ppm", where_seen(scale_ppm<DriftFrame>)},
        {"rotation_urad", where_seen(rotation_urad<DriftFrame>)},
        {"misfit_px", where_seen([](const auto& frame) { return frame.misfit_px; })}};
    return csv_of(table_of(columns, result.monitor.frames()));
}

std::string drift_json(const DriftResult& result, const std::string& target) {
    const DriftMonitor& monitor = result.monitor;
    Json camera = result.camera;
    camera["width"] = result.settings.width;
    camera["height"] = result.settings.height;
    camera["exposure_us"] = result.settings.exposure.count();
    camera["remarks"] = result.remarks;
    Json json = {{"etalon", "drift/1"},
                 {"stable", result.stable},
                 {"reason", result.reason},
                 {"limit_px_per_min", monitor.plan().limit_px_per_min},
                 {"target", target},
                 {"camera", camera},
                 {"started_utc", result.started_utc},
                 {"duration_min", result.duration.count()},
                 {"frames", monitor.frames().size()},
                 {"frames_without_target", frames_without_target(monitor)},
                 {"block_min", monitor.plan().block.count()},
                 {"judgements", monitor.plan().judgements},
                 {"radius_px", radius_of(monitor)},
                 {"point_noise_px", or_null(monitor.point_noise_px())},
                 {"shake_px", or_null(monitor.shake_px())},
                 {"jumps", json_rows(jump_table(monitor))},
                 {"rates", json_list(monitor.rates(), rate_json)}};
    return text_of(json) + "\n";
}

std::string drift_html(const DriftResult& result, const std::string& target) {
    HtmlPage page("Drift of a camera", result.camera.uri + ", " + target);
    add_summary(page, result, target);
    page.add_heading("Movement and rate");
    HtmlPage::Figures figures = {
        {movement_plot(result.monitor),
         "Movement of the target's image since the first frame, and after a jump since the first "
         "frame behind it. Growth and turn as what they move a point by that is as far from the "
         "target's middle as its points are on average. Look for lines that level off: then it is "
         "warm."}};
    if (!result.monitor.rates().empty())
        figures.push_back({rate_plot(result.monitor),
                           "Drift at that corner of the image where it is largest, and what it is "
                           "below: of the last 5, 10 or 20 minutes, whichever says most. It is "
                           "stable where the band stays under the limit."});
    page.add_figures(figures);
    add_jumps(page, result.monitor);
    add_limits_of_the_method(page);
    return page.finish();
}

bool is_recording(const CaptureArguments& arguments) {
    return arguments.camera.starts_with("files:");
}

DriftRequest drift_request(const CaptureArguments& arguments) {
    if (is_recording(arguments) && !arguments.interval_s)
        throw ConfigError({"--interval-s"}, "is needed: images do not say when they were taken");
    DriftRequest request;
    request.settings = capture_settings(arguments);
    request.retries = arguments.retries;
    const double interval_s = arguments.interval_s.value_or(1.0);
    const double minutes = arguments.minutes.value_or(60.0);
    constexpr double max_min = 10'000.0;  // a week
    constexpr int max_frames = 1'000'000;
    const double frames = arguments.frames > 0 ? arguments.frames : 60.0 * minutes / interval_s + 1;
    if (!(interval_s >= 1e-3) || frames * interval_s > 60.0 * max_min || frames > max_frames)
        throw ConfigError({"--interval-s"},
                          fmt::format("must be 0.001 at least and make at most {} frames in {} "
                                      "minutes",
                                      max_frames, max_min));
    request.interval = duration_of(interval_s);
    request.frames = static_cast<int>(frames);
    return request;
}

// A line for each jump; on a terminal the last state, elsewhere one whenever there is a new rate.
class DriftPrinter {
public:
    void show(const DriftMonitor& monitor) {
        for (; jumps_ < monitor.jumps().size(); ++jumps_) {
            const DriftJump& jump = monitor.jumps()[jumps_];
            print_stderr(
                "{}jump of {:.3f} px at {:.2f} min: target, camera or their base was "
                "touched; judged again\n",
                line_.is_terminal() ? "\r" : "", jump.size_px, jump.time.count());
        }
        if (line_.is_terminal() || monitor.rates().size() > rates_ || monitor.frames().size() == 1)
            line_.show(drift_line(monitor));
        rates_ = monitor.rates().size();
    }

private:
    StatusLine line_;
    std::size_t rates_ = 0, jumps_ = 0;
};

void print_result(const CaptureArguments& arguments, const DriftResult& result) {
    print_remarks(result);
    if (arguments.json) {
        fmt::print("{}", drift_json(result, arguments.marker));
        return;
    }
    for (const DriftJump& jump : result.monitor.jumps())
        fmt::print("jump {:.3f} px at {:.2f} min\n", jump.size_px, jump.time.count());
    fmt::print("{}\nreport {}\n", drift_sentence(result), (arguments.out / "report.html").string());
}

}  // namespace

DriftResult watch_drift(Camera& camera, const TargetFinder& find_target,
                        const DriftRequest& request, Clock& clock, const std::stop_token& stop,
                        const std::function<void(const DriftMonitor&)>& seen) {
    DriftResult result{{.settings = {}, .started_utc = utc_now()}, DriftMonitor({})};
    result.settings = camera.configure(request.settings);
    result.monitor =
        DriftMonitor(drift_plan({result.settings.width, result.settings.height}, request.interval,
                                request.frames * Minutes(request.interval)));
    const Instant start = clock.now();
    DriftMonitor& monitor = result.monitor;
    use_camera(camera, result, [&] {
        Instant next = clock.now();
        for (int number = 0; number < request.frames && !monitor.stable(); ++number) {
            next = std::max(start + number * request.interval, next);
            if (!clock.wait_until(next, stop))
                throw Interrupted();
            const Frame frame = frame_after_reconnecting(camera, next, request.retries, clock, stop,
                                                         [](const auto&, const auto&) {});
            const bool complete = frame.status == FrameStatus::complete;
            next = complete ? frame.exposure_start : clock.now();
            monitor.add(next - start, complete ? find_target(frame.image) : TargetPoints{});
            seen(monitor);
        }
    });
    result.stable = monitor.stable();
    result.duration = clock.now() - start;
    return result;
}

std::string drift_sentence(const DriftResult& result) {
    const DriftMonitor& monitor = result.monitor;
    if (monitor.rates().empty())
        return fmt::format("drift not measured in {:.1f} min", result.duration.count());
    return fmt::format("drift {:.3f} px/min {} {:.1f} min", monitor.rates().back().worst_px_per_min,
                       result.stable ? "stable after" : "not stable in", result.duration.count());
}

std::string drift_line(const DriftMonitor& monitor) {
    if (monitor.frames().empty())
        return "no frame yet";
    const DriftFrame& frame = monitor.frames().back();
    std::string line = fmt::format("{:6.1f} min  ", frame.time.count());
    if (!frame.seen)
        return line + "target not seen";
    if (monitor.rates().empty())
        line += "drift: not yet";
    else
        line += fmt::format("drift {:.3f} U {:.3f} px/min", monitor.rates().back().worst_px_per_min,
                            monitor.rates().back().expanded_uncertainty_px_per_min);
    line += fmt::format("  noise {:.3f} px", monitor.point_noise_px().value_or(0.0));
    if (!monitor.jumps().empty())
        line += fmt::format("  jumps {}", monitor.jumps().size());
    return line;
}

int run_capture_drift(const CaptureArguments& arguments) {
    if (arguments.out.empty())
        throw ConfigError({"--out"}, "is needed");
    const DriftRequest request = drift_request(arguments);
    const TargetFinder find_target = make_target_finder(arguments.marker, "--marker");
    require_new_folder(arguments.out);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    // A recording is watched on a clock of its own: as fast as it can be read.
    SteadyClock real;
    VirtualClock recorded;
    Clock& clock = is_recording(arguments) ? static_cast<Clock&>(recorded) : real;
    const auto camera = opened_camera(arguments, clock, stop.get_token());
    const FolderLock lock = claim_folder(arguments.out);
    require_new_folder(arguments.out);  // still
    std::optional<DriftResult> result;
    {
        DriftPrinter printer;
        result = watch_drift(*camera, find_target, request, clock, stop.get_token(),
                             [&](const DriftMonitor& monitor) { printer.show(monitor); });
    }
    write_text(arguments.out / "drift.csv", drift_csv(*result));
    write_text(arguments.out / "drift.json", drift_json(*result, arguments.marker));
    write_text(arguments.out / "report.html", drift_html(*result, arguments.marker));
    print_result(arguments, *result);
    if (!result->reason.empty())
        return result->reason == "interrupted" ? ExitCode::interrupted : ExitCode::run_error;
    return result->stable ? 0 : ExitCode::inconclusive;
}

}  // namespace etalon
