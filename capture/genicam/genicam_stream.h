// The frames of an armed GenICam device: one acquisition, from start to stop, with its buffers.
// Every default of a GigE Vision stream was measured to fail somewhere, so all of them are set here
// on purpose. A frame is judged by its size too: the library calls truncated ones good; and by what
// its chunks say, where the device sends them.
#pragma once

#include <memory>
#include <optional>
#include <stop_token>

#include "capture/genicam/genicam_device.h"
#include "capture/genicam/genicam_settings.h"

typedef struct _ArvStream ArvStream;
typedef struct _ArvBuffer ArvBuffer;

namespace etalon {

class GenicamStream {
public:
    using Buffer = std::unique_ptr<ArvBuffer, UnrefObject>;

    // Starts the acquisition. Throws DeviceError. Both must outlive the stream.
    GenicamStream(GenicamDevice& device, const GenicamCapture& capture);
    ~GenicamStream();  // stops it; within 3 s, lost or not
    GenicamStream(const GenicamStream&) = delete;
    GenicamStream& operator=(const GenicamStream&) = delete;

    // The next buffer that the library has done with; null where there is none (before the
    // deadline).
    Buffer waiting();
    Buffer next(const Clock& clock, Instant deadline, std::stop_token stop);
    void give_back(Buffer buffer);

    // Whether the buffer's frame comes after all seen before; remembers it if so.
    bool is_newer(ArvBuffer* buffer);

    // The frame in the buffer, without its times. Throws DeviceError for codes above the full
    // scale.
    Frame judged(ArvBuffer* buffer);
    static std::uint64_t device_time_ns(ArvBuffer* buffer);

    // Packets, underruns and skipped frames of this acquisition.
    CaptureStatistics statistics() const;

    // Whether chunks came that the library cannot read.
    bool had_unreadable_chunks() const { return had_unreadable_chunks_; }

private:
    void set_properties();
    void unpack_into(Frame& frame, std::span<const std::uint8_t> image) const;
    std::string leader_fault(ArvBuffer* buffer) const;
    std::string split(ArvBuffer* buffer, PayloadParts& parts) const;
    std::string chunk_fault(ArvBuffer* buffer, const PayloadParts& parts);
    std::string stamp_fault(ArvBuffer* buffer, const ChunkValues& values) const;
    std::string frame_id_fault(std::uint64_t id, std::uint64_t chunk_id);

    GenicamDevice& device_;
    const GenicamCapture& capture_;
    std::unique_ptr<ArvStream, UnrefObject> stream_;
    std::optional<std::uint64_t> last_id_;
    struct FrameIds {
        std::uint64_t id, in_chunk;
    };
    std::optional<FrameIds> last_ids_;  // of the last frame whose chunks were read
    bool had_unreadable_chunks_ = false;
    long skipped_ = 0;
};

}  // namespace etalon
