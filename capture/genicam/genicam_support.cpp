#include "capture/genicam/genicam_support.h"

#include <arv.h>
#include <sys/socket.h>
#include <unistd.h>

#include "capture/genicam/genicam_camera.h"

namespace etalon {
namespace {}  // namespace

// The kernel counts its own bookkeeping in, so it reports twice what it was asked (socket(7)).
int granted_receive_buffer(int asked) {
    const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (socket < 0)
        return asked;  // no answer is no finding
    int size = asked;
    socklen_t length = sizeof size;
    const bool known = setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &size, length) == 0 &&
                       getsockopt(socket, SOL_SOCKET, SO_RCVBUF, &size, &length) == 0;
    close(socket);
    return known ? size / 2 : asked;
}

FrameStatus genicam_frame_status(int status) {
    switch (status) {
        case ARV_BUFFER_STATUS_SUCCESS:
            return FrameStatus::complete;
        case ARV_BUFFER_STATUS_SIZE_MISMATCH:
            return FrameStatus::short_frame;
        case ARV_BUFFER_STATUS_MISSING_PACKETS:
        case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
        case ARV_BUFFER_STATUS_TIMEOUT:
            return FrameStatus::corrupt;
        default:
            return FrameStatus::lost;
    }
}

const char* describe_buffer_status(int status) {
    switch (status) {
        case ARV_BUFFER_STATUS_SUCCESS:
            return "success";
        case ARV_BUFFER_STATUS_CLEARED:
            return "buffer cleared";
        case ARV_BUFFER_STATUS_TIMEOUT:
            return "packets timed out";
        case ARV_BUFFER_STATUS_MISSING_PACKETS:
            return "missing packets";
        case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
            return "wrong packet id";
        case ARV_BUFFER_STATUS_SIZE_MISMATCH:
            return "size mismatch";
        case ARV_BUFFER_STATUS_FILLING:
            return "still filling";
        case ARV_BUFFER_STATUS_ABORTED:
            return "aborted";
        default:
            return "unknown status";
    }
}

std::vector<CameraIdentity> list_genicam_cameras() {
    arv_update_device_list();
    std::vector<CameraIdentity> found;
    for (unsigned i = 0; i < arv_get_n_devices(); ++i)
        found.push_back({"genicam:" + text_or_empty(arv_get_device_id(i)),
                         text_or_empty(arv_get_device_vendor(i)),
                         text_or_empty(arv_get_device_model(i)),
                         text_or_empty(arv_get_device_serial_nbr(i))});
    return found;
}

}  // namespace etalon
