#include "station/record/image_writer.h"

#include "core/program/errors.h"

namespace etalon {

ImageWriter::ImageWriter(std::size_t capacity)
    : capacity_(std::max<std::size_t>(capacity, 1)), thread_([this] { work(); }) {}

ImageWriter::~ImageWriter() {
    {
        const std::scoped_lock lock(mutex_);
        ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

void ImageWriter::write(const std::filesystem::path& path, const CodeImage& image) {
    {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return jobs_.size() < capacity_; });
        rethrow_failure();
        jobs_.push_back({path, image});
    }
    changed_.notify_all();
}

void ImageWriter::flush() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return jobs_.empty(); });
    rethrow_failure();
}

void ImageWriter::rethrow_failure() {
    if (failure_)
        std::rethrow_exception(std::exchange(failure_, nullptr));
}

void ImageWriter::work() {
    std::unique_lock lock(mutex_);
    while (true) {
        changed_.wait(lock, [&] { return ending_ || !jobs_.empty(); });
        if (jobs_.empty())
            return;
        const Job job = jobs_.front();
        lock.unlock();
        std::exception_ptr failure;
        try {
            write_image(job.path, job.image);
        } catch (const std::exception&) {
            failure = std::current_exception();
        }
        lock.lock();
        if (failure && !failure_)
            failure_ = failure;
        jobs_.pop_front();
        changed_.notify_all();
    }
}

}  // namespace etalon
