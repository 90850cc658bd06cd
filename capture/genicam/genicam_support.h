// What the GenICam backend needs besides the camera itself: the kernel's say on the receive buffer,
// and the library's buffer status in this project's words.
#pragma once

#include "core/image/image.h"

namespace etalon {

// What the kernel grants of a UDP receive buffer of `asked` bytes; `asked` where it will not say.
int granted_receive_buffer(int asked);

// `status` is an ArvBufferStatus.
FrameStatus genicam_frame_status(int status);
const char* describe_buffer_status(int status);

}  // namespace etalon
