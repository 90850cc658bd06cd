#include "core/time/calendar_date.h"

#include <fmt/format.h>

#include <chrono>

#include "core/file/text.h"

namespace etalon {
namespace {

// The number that digits make; nothing for a sign or a space among them.
std::optional<int> digits(std::string_view text) {
    if (text.find_first_not_of("0123456789") != std::string_view::npos)
        return std::nullopt;
    return static_cast<int>(parse_integer(text).value());
}

}  // namespace

std::optional<long> days_of_date(std::string_view date) {
    if (date.size() != 10 || date[4] != '-' || date[7] != '-')
        return std::nullopt;
    const auto year = digits(date.substr(0, 4)), month = digits(date.substr(5, 2)),
               day = digits(date.substr(8, 2));
    if (!year || !month || !day)
        return std::nullopt;
    const std::chrono::year_month_day found(std::chrono::year(*year),
                                            std::chrono::month(static_cast<unsigned>(*month)),
                                            std::chrono::day(static_cast<unsigned>(*day)));
    if (!found.ok())
        return std::nullopt;
    return std::chrono::sys_days(found).time_since_epoch().count();
}

std::string date_of_days(long days) {
    const std::chrono::year_month_day date(
        std::chrono::sys_days(std::chrono::days(static_cast<int>(days))));
    return fmt::format("{:04}-{:02}-{:02}", static_cast<int>(date.year()),
                       static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()));
}

}  // namespace etalon
