// The JSON library's classes, compiled once (two to four seconds each): part of the precompiled
// header, needed by nobody. For version 3.11; others do without.
#pragma once

#include <nlohmann/json.hpp>

#if NLOHMANN_JSON_VERSION_MAJOR == 3 && NLOHMANN_JSON_VERSION_MINOR == 11
#ifndef ETALON_INSTANTIATE
#define ETALON_INSTANTIATE extern
#endif

ETALON_INSTANTIATE template class nlohmann::basic_json<nlohmann::ordered_map>;
ETALON_INSTANTIATE template class nlohmann::basic_json<>;
ETALON_INSTANTIATE template class nlohmann::detail::serializer<nlohmann::ordered_json>;
ETALON_INSTANTIATE template class nlohmann::detail::serializer<nlohmann::json>;

#undef ETALON_INSTANTIATE
#endif
