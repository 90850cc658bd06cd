// Days of the calendar as files give them: "2026-03-07" (ISO 8601). As text they sort by time.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace etalon {

// Days since 1970-01-01; nothing for what is no day, as 2026-02-30.
std::optional<long> days_of_date(std::string_view date);

// The inverse, for days of the years 0 to 9999.
std::string date_of_days(long days);

}  // namespace etalon
