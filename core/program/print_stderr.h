// Words for whoever watches, on stderr. Where it is full, closed or read by nobody these words are
// lost, and nothing ends: fmt::print() would throw.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace etalon {

template <class... Parts>
void print_stderr(fmt::format_string<Parts...> format, Parts&&... parts) {
    const std::string text = fmt::format(format, std::forward<Parts>(parts)...);
    std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace etalon
