// Writes images on a thread of its own, so that a device is not kept waiting for a disk.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <mutex>
#include <thread>

#include "core/image/image.h"

namespace etalon {

// The queue is bounded: write() waits when the disk cannot follow. Used from one thread.
class ImageWriter {
public:
    explicit ImageWriter(std::size_t capacity = 8);
    ~ImageWriter();  // writes what is queued
    ImageWriter(const ImageWriter&) = delete;
    ImageWriter& operator=(const ImageWriter&) = delete;

    // Queues the image; its pixels must not change afterwards. Throws what writing an earlier one
    // threw.
    void write(const std::filesystem::path& path, const CodeImage& image);

    // Returns when everything queued is written. Throws what writing threw.
    void flush();

private:
    struct Job {
        std::filesystem::path path;
        CodeImage image;
    };
    void work();
    void rethrow_failure();

    const std::size_t capacity_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Job> jobs_;  // the first one stays while it is being written
    bool ending_ = false;
    std::exception_ptr failure_;
    std::thread thread_;
};

}  // namespace etalon
