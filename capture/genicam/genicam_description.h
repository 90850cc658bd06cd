// Checks a camera's GenICam description before the library follows it. Aravis takes references and
// lengths as they come (0.8.26): it would run out of stack, of time or of memory.
#pragma once

#include <string>

namespace etalon {

// `xml`: the description as the camera sends it. Refuses what is not well-formed; a value that
// refers to itself, or to more than 64 others one after another; a value that takes more than
// 100 000 others; and a register of more than 1 GiB. Throws Error, with the line and the name.
// Lengths that the camera says only when asked (pLength) are not seen. Linear in the text.
void require_sound_description(const std::string& xml);

}  // namespace etalon
