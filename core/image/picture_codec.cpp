#include "core/image/picture_codec.h"

#include <fmt/format.h>
#include <png.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <bit>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "core/image/opencv_plugin.h"
#include "core/program/errors.h"
#include "core/program/plugin.h"

// After <cstdio>, which it does not include.
#include <jpeglib.h>

namespace etalon {
namespace {

using Bytes = std::span<const unsigned char>;

// No compression of these formats reaches it (deflate 1032 bytes a byte, of 8 pixels each): a small
// file cannot make us take much memory.
constexpr long most_pixels_a_byte = 10000;

void check_size(long width, long height, Bytes file) {
    if (width <= 0 || height <= 0)
        throw Error(fmt::format("is {} x {} px", width, height));
    if (width > most_picture_pixels / height)
        throw Error(fmt::format("is {} x {} px; {} px are the most that are read", width, height,
                                most_picture_pixels));
    if (width * height > most_pixels_a_byte * static_cast<long>(file.size()))
        throw Error(fmt::format("says it is {} x {} px, which do not fit its {} bytes", width,
                                height, file.size()));
}

bool starts_with(Bytes file, std::string_view start) {
    return file.size() >= start.size() && std::memcmp(file.data(), start.data(), start.size()) == 0;
}

// The C libraries leave by longjmp: what they jump over has no locals with destructors.

// ---- PNG -------------------------------------------------------------------------------------

class PngReader {
public:
    explicit PngReader(Bytes file) : file_(file), rest_(file) {
        png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, &fail, &ignore);
        info_ = png_create_info_struct(png_);
        png_set_read_fn(png_, this, &deliver);
    }
    ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
    PngReader(const PngReader&) = delete;
    PngReader& operator=(const PngReader&) = delete;

    cv::Mat read() {
        step(&PngReader::read_header);
        check_size(png_get_image_width(png_, info_), png_get_image_height(png_, info_), file_);
        picture_.create(static_cast<int>(png_get_image_height(png_, info_)),
                        static_cast<int>(png_get_image_width(png_, info_)), type());
        for (int y = 0; y < picture_.rows; ++y)
            rows_.push_back(picture_.ptr(y));
        step(&PngReader::read_rows);
        return picture_;
    }

private:
    static void deliver(png_structp png, png_bytep to, std::size_t count) {
        Bytes& rest = static_cast<PngReader*>(png_get_io_ptr(png))->rest_;
        if (count > rest.size())
            png_error(png, "ends early");
        std::memcpy(to, rest.data(), count);
        rest = rest.subspan(count);
    }
    [[noreturn]] static void fail(png_structp png, png_const_charp message) {
        static_cast<PngReader*>(png_get_error_ptr(png))->failure_ = message;
        png_longjmp(png, 1);
    }
    static void ignore(png_structp, png_const_charp) {}

    void step(void (PngReader::*work)()) {
        if (setjmp(png_jmpbuf(png_)) != 0)
            throw Error("is a damaged PNG: " + failure_);
        (this->*work)();
    }

    bool has_colour() const {
        return (png_get_color_type(png_, info_) & PNG_COLOR_MASK_COLOR) != 0;
    }
    int type() const {
        return CV_MAKETYPE(png_get_bit_depth(png_, info_) == 16 ? CV_16U : CV_8U,
                           has_colour() ? 3 : 1);
    }

    void read_header() { png_read_info(png_, info_); }

    void read_rows() {
        png_set_palette_to_rgb(png_);
        png_set_expand_gray_1_2_4_to_8(png_);
        png_set_strip_alpha(png_);
        if (has_colour())
            png_set_bgr(png_);
        if constexpr (std::endian::native == std::endian::little)
            png_set_swap(png_);
        png_set_interlace_handling(png_);
        png_read_update_info(png_, info_);
        if (png_get_rowbytes(png_, info_) != picture_.step[0])
            png_error(png_, "rows of another length");
        png_read_image(png_, rows_.data());
        png_read_end(png_, nullptr);
    }

    Bytes file_, rest_;
    png_structp png_ = nullptr;
    png_infop info_ = nullptr;
    cv::Mat picture_;
    std::vector<png_bytep> rows_;
    std::string failure_;
};

class PngWriter {
public:
    PngWriter(const cv::Mat& picture, unsigned dots_per_metre)
        : picture_(picture), dots_per_metre_(dots_per_metre) {
        png_ = png_create_write_struct(PNG_LIBPNG_VER_STRING, this, &fail, &ignore);
        info_ = png_create_info_struct(png_);
        png_set_write_fn(png_, this, &take, nullptr);
    }
    ~PngWriter() { png_destroy_write_struct(&png_, &info_); }
    PngWriter(const PngWriter&) = delete;
    PngWriter& operator=(const PngWriter&) = delete;

    std::vector<unsigned char> write() {
        if (setjmp(png_jmpbuf(png_)) != 0)
            throw Error("cannot be written as PNG: " + failure_);
        write_all();
        return std::move(bytes_);
    }

private:
    static void take(png_structp png, png_bytep from, std::size_t count) {
        std::vector<unsigned char>& bytes = static_cast<PngWriter*>(png_get_io_ptr(png))->bytes_;
        bytes.insert(bytes.end(), from, from + count);
    }
    [[noreturn]] static void fail(png_structp png, png_const_charp message) {
        static_cast<PngWriter*>(png_get_error_ptr(png))->failure_ = message;
        png_longjmp(png, 1);
    }
    static void ignore(png_structp, png_const_charp) {}

    int colour_type() const {
        if (picture_.channels() == 1)
            return PNG_COLOR_TYPE_GRAY;
        return picture_.channels() == 3 ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_RGB_ALPHA;
    }

    // The difference to the left neighbour and runs of equal bytes: a tenth of the time of libpng's
    // own choice, for files a fifth larger.
    void write_all() {
        constexpr int fastest = 1, run_lengths = 3;  // Z_BEST_SPEED, Z_RLE
        png_set_filter(png_, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
        png_set_compression_level(png_, fastest);
        png_set_compression_strategy(png_, run_lengths);
        png_set_IHDR(png_, info_, static_cast<unsigned>(picture_.cols),
                     static_cast<unsigned>(picture_.rows), picture_.depth() == CV_16U ? 16 : 8,
                     colour_type(), PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                     PNG_FILTER_TYPE_DEFAULT);
        if (dots_per_metre_ > 0)
            png_set_pHYs(png_, info_, dots_per_metre_, dots_per_metre_, PNG_RESOLUTION_METER);
        png_write_info(png_, info_);
        png_set_bgr(png_);
        if constexpr (std::endian::native == std::endian::little)
            png_set_swap(png_);
        for (int y = 0; y < picture_.rows; ++y)
            png_write_row(png_, picture_.ptr(y));
        png_write_end(png_, info_);
    }

    const cv::Mat& picture_;
    unsigned dots_per_metre_;
    png_structp png_ = nullptr;
    png_infop info_ = nullptr;
    std::vector<unsigned char> bytes_;
    std::string failure_;
};

// ---- JPEG ------------------------------------------------------------------------------------

// Each more costs a pass over the whole picture; encoders write 10.
constexpr int most_jpeg_scans = 500;

struct JpegErrors : jpeg_error_mgr {
    std::jmp_buf leave;
    std::array<char, JMSG_LENGTH_MAX> message;

    JpegErrors() {
        jpeg_std_error(this);
        error_exit = [](j_common_ptr info) {
            auto& errors = *static_cast<JpegErrors*>(info->err);
            errors.format_message(info, errors.message.data());
            std::longjmp(errors.leave, 1);
        };
    }
    // Of a decompressor, as its progress monitor.
    static void limit_scans(j_common_ptr info) {
        auto& errors = *static_cast<JpegErrors*>(info->err);
        if (reinterpret_cast<j_decompress_ptr>(info)->input_scan_number <= most_jpeg_scans)
            return;
        std::snprintf(errors.message.data(), errors.message.size(), "more than %d scans",
                      most_jpeg_scans);
        std::longjmp(errors.leave, 1);
    }
    std::string cause() const { return message.data(); }
};

class JpegReader {
public:
    explicit JpegReader(Bytes file) : JpegReader() {
        jpeg_mem_src(&info_, file.data(), file.size());
        step(&JpegReader::read_header);
        check_size(info_.image_width, info_.image_height, file);
    }
    ~JpegReader() { jpeg_destroy_decompress(&info_); }
    JpegReader(const JpegReader&) = delete;
    JpegReader& operator=(const JpegReader&) = delete;

    // One of ink (CMYK), or of an unknown number of colours, is not.
    bool is_gray_or_colour() const {
        return info_.num_components == 1 || info_.num_components == 3;
    }

    cv::Mat read(bool as_gray) {
        const bool gray = as_gray || info_.num_components == 1;
        info_.out_color_space = gray ? JCS_GRAYSCALE : JCS_EXT_BGR;
        picture_.create(static_cast<int>(info_.image_height), static_cast<int>(info_.image_width),
                        gray ? CV_8UC1 : CV_8UC3);
        step(&JpegReader::read_rows);
        return picture_;
    }

private:
    JpegReader() {
        info_.err = &errors_;
        jpeg_create_decompress(&info_);
        progress_.progress_monitor = &JpegErrors::limit_scans;
        info_.progress = &progress_;
    }

    void step(void (JpegReader::*work)()) {
        if (setjmp(errors_.leave) != 0)
            throw Error("is a damaged JPEG: " + errors_.cause());
        (this->*work)();
    }

    void read_header() { jpeg_read_header(&info_, TRUE); }

    void read_rows() {
        jpeg_start_decompress(&info_);
        while (info_.output_scanline < info_.output_height) {
            JSAMPROW row = picture_.ptr(static_cast<int>(info_.output_scanline));
            jpeg_read_scanlines(&info_, &row, 1);
        }
        jpeg_finish_decompress(&info_);
    }

    JpegErrors errors_;
    jpeg_progress_mgr progress_{};
    jpeg_decompress_struct info_{};
    cv::Mat picture_;
};

class JpegWriter {
public:
    JpegWriter(const cv::Mat& picture, int quality) : picture_(picture), quality_(quality) {
        info_.err = &errors_;
        jpeg_create_compress(&info_);
    }
    ~JpegWriter() {
        jpeg_destroy_compress(&info_);
        std::free(bytes_);
    }
    JpegWriter(const JpegWriter&) = delete;
    JpegWriter& operator=(const JpegWriter&) = delete;

    std::vector<unsigned char> write() {
        if (setjmp(errors_.leave) != 0)
            throw Error("cannot be written as JPEG: " + errors_.cause());
        write_all();
        return {bytes_, bytes_ + count_};
    }

private:
    void write_all() {
        const bool gray = picture_.channels() == 1;
        jpeg_mem_dest(&info_, &bytes_, &count_);
        info_.image_width = static_cast<unsigned>(picture_.cols);
        info_.image_height = static_cast<unsigned>(picture_.rows);
        info_.input_components = gray ? 1 : 3;
        info_.in_color_space = gray ? JCS_GRAYSCALE : JCS_EXT_BGR;
        jpeg_set_defaults(&info_);
        jpeg_set_quality(&info_, quality_, TRUE);
        jpeg_start_compress(&info_, TRUE);
        while (info_.next_scanline < info_.image_height) {
            auto* row =
                const_cast<unsigned char*>(picture_.ptr(static_cast<int>(info_.next_scanline)));
            jpeg_write_scanlines(&info_, &row, 1);
        }
        jpeg_finish_compress(&info_);
    }

    const cv::Mat& picture_;
    int quality_;
    JpegErrors errors_;
    jpeg_compress_struct info_{};
    unsigned char* bytes_ = nullptr;
    unsigned long count_ = 0;
};

// ---- TIFF ------------------------------------------------------------------------------------

// A file in memory, as libtiff wants it: `given` to be read, or one that is made.
class TiffFile {
public:
    TiffFile(Bytes given, const char* mode) : given_(given) {
        std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(
            TIFFOpenOptionsAlloc(), &TIFFOpenOptionsFree);
        TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &keep_first, this);
        TIFFOpenOptionsSetWarningHandlerExtR(
            options.get(), [](TIFF*, void*, const char*, const char*, va_list) { return 1; }, this);
        tiff_ = TIFFClientOpenExt("picture", mode, this, &read, &write, &seek, &close, &size,
                                  nullptr, nullptr, options.get());
        require(tiff_ != nullptr);
    }
    ~TiffFile() {
        if (tiff_ != nullptr)
            TIFFClose(tiff_);
    }
    TiffFile(const TiffFile&) = delete;
    TiffFile& operator=(const TiffFile&) = delete;

    TIFF* get() const { return tiff_; }

    // Of one value; a missing one has its default, and -1 where the format has none.
    template <class T>
    long field(std::uint32_t tag) const {
        T value{};
        return TIFFGetFieldDefaulted(tiff_, tag, &value) == 1 ? static_cast<long>(value) : -1;
    }

    void require(bool done) const {
        if (!done)
            throw Error("is a TIFF that libtiff cannot handle: " + failure_);
    }

    std::vector<unsigned char> closed() {
        TIFFClose(std::exchange(tiff_, nullptr));
        require(failure_.empty());
        return std::move(made_);
    }

private:
    Bytes bytes() const { return given_.empty() ? Bytes(made_) : given_; }
    static TiffFile& self(thandle_t handle) { return *static_cast<TiffFile*>(handle); }
    static tmsize_t read(thandle_t handle, void* to, tmsize_t count) {
        TiffFile& file = self(handle);
        const Bytes left = file.bytes().subspan(std::min(file.at_, file.bytes().size()));
        const Bytes given = left.first(std::min(left.size(), static_cast<std::size_t>(count)));
        std::ranges::copy(given, static_cast<unsigned char*>(to));
        file.at_ += given.size();
        return std::ssize(given);
    }
    static tmsize_t write(thandle_t handle, void* from, tmsize_t count) {
        TiffFile& file = self(handle);
        const auto given = static_cast<std::size_t>(count);
        file.made_.resize(std::max(file.made_.size(), file.at_ + given));
        std::memcpy(file.made_.data() + file.at_, from, given);
        file.at_ += given;
        return count;
    }
    static toff_t seek(thandle_t handle, toff_t offset, int from) {
        TiffFile& file = self(handle);
        const std::size_t start = from == SEEK_SET   ? 0
                                  : from == SEEK_CUR ? file.at_
                                                     : file.bytes().size();
        file.at_ = start + offset;
        return file.at_;
    }
    static int close(thandle_t) { return 0; }
    static toff_t size(thandle_t handle) { return self(handle).bytes().size(); }
    static int keep_first(TIFF*, void* file, const char*, const char* format, va_list values) {
        std::array<char, 200> text{};
        std::vsnprintf(text.data(), text.size(), format, values);
        if (std::string& failure = self(file).failure_; failure.empty())
            failure = text.data();
        return 1;  // said: not to be printed
    }

    Bytes given_;
    std::vector<unsigned char> made_;
    std::size_t at_ = 0;
    std::string failure_;
    TIFF* tiff_ = nullptr;
};

// The type of a picture as we write it, or -1: one channel that counts from black, rows from the
// top left, and a compression that libtiff unpacks row by row.
int plain_tiff_type(const TiffFile& tiff) {
    constexpr std::array<long, 5> compressions{COMPRESSION_NONE, COMPRESSION_LZW,
                                               COMPRESSION_ADOBE_DEFLATE, COMPRESSION_DEFLATE,
                                               COMPRESSION_PACKBITS};
    const auto word = [&](std::uint32_t tag) { return tiff.field<std::uint16_t>(tag); };
    const bool is_plain =
        word(TIFFTAG_SAMPLESPERPIXEL) == 1 && word(TIFFTAG_PHOTOMETRIC) == PHOTOMETRIC_MINISBLACK &&
        word(TIFFTAG_ORIENTATION) == ORIENTATION_TOPLEFT &&
        std::ranges::find(compressions, word(TIFFTAG_COMPRESSION)) != compressions.end() &&
        TIFFIsTiled(tiff.get()) == 0;
    const bool is_float = word(TIFFTAG_SAMPLEFORMAT) == SAMPLEFORMAT_IEEEFP;
    const bool is_code = word(TIFFTAG_SAMPLEFORMAT) == SAMPLEFORMAT_UINT;
    const long bits = word(TIFFTAG_BITSPERSAMPLE);
    if (is_plain && is_float && bits == 32)
        return CV_32FC1;
    if (is_plain && is_code && (bits == 8 || bits == 16))
        return bits == 8 ? CV_8UC1 : CV_16UC1;
    return -1;
}

// Empty when it is of another kind than ours.
cv::Mat decode_tiff(Bytes bytes) {
    const TiffFile tiff(bytes, "rm");
    const long width = tiff.field<std::uint32_t>(TIFFTAG_IMAGEWIDTH),
               height = tiff.field<std::uint32_t>(TIFFTAG_IMAGELENGTH);
    check_size(width, height, bytes);
    const int type = plain_tiff_type(tiff);
    if (type < 0)
        return {};
    cv::Mat picture(static_cast<int>(height), static_cast<int>(width), type);
    tiff.require(TIFFScanlineSize(tiff.get()) == static_cast<tmsize_t>(picture.step[0]));
    const long strip_rows = std::clamp(tiff.field<std::uint32_t>(TIFFTAG_ROWSPERSTRIP), 1L, height);
    for (long y = 0, strip = 0; y < height; y += strip_rows, ++strip) {
        const auto size = static_cast<tmsize_t>(picture.step[0]) * std::min(strip_rows, height - y);
        tiff.require(TIFFReadEncodedStrip(tiff.get(), static_cast<std::uint32_t>(strip),
                                          picture.ptr(static_cast<int>(y)), size) == size);
    }
    return picture;
}

std::vector<unsigned char> encode_tiff(const cv::Mat& picture) {
    const bool is_float = picture.depth() == CV_32F;
    TiffFile tiff({}, "w");
    const auto set = [&](std::uint32_t tag, auto value) {
        tiff.require(TIFFSetField(tiff.get(), tag, value) == 1);
    };
    set(TIFFTAG_IMAGEWIDTH, picture.cols);
    set(TIFFTAG_IMAGELENGTH, picture.rows);
    set(TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * picture.elemSize1()));
    set(TIFFTAG_SAMPLESPERPIXEL, 1);
    set(TIFFTAG_SAMPLEFORMAT, is_float ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    set(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    set(TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    set(TIFFTAG_COMPRESSION, is_float ? COMPRESSION_NONE : COMPRESSION_LZW);
    if (!is_float)
        set(TIFFTAG_PREDICTOR, PREDICTOR_HORIZONTAL);
    set(TIFFTAG_ROWSPERSTRIP, TIFFDefaultStripSize(tiff.get(), 0));
    for (int y = 0; y < picture.rows; ++y) {
        // libtiff's predictor works in place.
        cv::Mat row = is_float ? picture.row(y) : picture.row(y).clone();
        tiff.require(TIFFWriteScanline(tiff.get(), row.ptr(), static_cast<unsigned>(y), 0) == 1);
    }
    return tiff.closed();
}

// ---- any -------------------------------------------------------------------------------------

cv::Mat decode_rare(Bytes bytes) {
    if (bytes.size() > static_cast<std::size_t>(std::numeric_limits<int>::max()))
        throw Error("is longer than 2 GB");
    const cv::Mat header(1, static_cast<int>(bytes.size()), CV_8UC1,
                         const_cast<unsigned char*>(bytes.data()));
    cv::Mat picture;
    try {
        if (!bytes.empty())
            picture = opencv_plugin().decode(header);
    } catch (const cv::Exception& error) {
        throw Error("cannot be decoded: " + error.err);
    }
    if (picture.empty())
        throw Error("is not an image that can be read");
    return picture;
}

bool is_of(const cv::Mat& picture, std::initializer_list<int> depths,
           std::initializer_list<int> channels) {
    const auto has = [](std::initializer_list<int> all, int one) {
        return std::find(all.begin(), all.end(), one) != all.end();
    };
    return !picture.empty() && has(depths, picture.depth()) && has(channels, picture.channels());
}

}  // namespace

cv::Mat decode_picture(std::span<const unsigned char> bytes) {
    if (starts_with(bytes, "\x89PNG\r\n\x1a\n"))
        return PngReader(bytes).read();
    if (starts_with(bytes, "\xff\xd8\xff")) {
        JpegReader reader(bytes);
        return reader.is_gray_or_colour() ? reader.read(/*as_gray=*/false) : decode_rare(bytes);
    }
    if (starts_with(bytes, {"II*\0", 4}) || starts_with(bytes, {"MM\0*", 4}))
        if (const cv::Mat picture = decode_tiff(bytes); !picture.empty())
            return picture;
    return decode_rare(bytes);
}

cv::Mat decode_jpeg_luma(std::span<const unsigned char> bytes) {
    JpegReader reader(bytes);
    if (!reader.is_gray_or_colour())
        throw Error("is a JPEG of inks (CMYK), not of light");
    return reader.read(/*as_gray=*/true);
}

std::vector<unsigned char> encode_png(const cv::Mat& picture, unsigned dots_per_metre) {
    if (!is_of(picture, {CV_8U, CV_16U}, {1, 3, 4}))
        throw Error("PNG holds 8 or 16 bits, of gray or colour, or of colour and opacity");
    return PngWriter(picture, dots_per_metre).write();
}

std::vector<unsigned char> encode_jpeg(const cv::Mat& picture, int quality) {
    if (!is_of(picture, {CV_8U}, {1, 3}))
        throw Error("JPEG holds 8 bits, of gray or colour");
    return JpegWriter(picture, quality).write();
}

std::vector<unsigned char> encode_picture(const std::string& extension, const cv::Mat& picture) {
    std::string kind = extension;
    std::ranges::transform(kind, kind.begin(), [](unsigned char c) { return std::tolower(c); });
    if (kind == ".png" && is_of(picture, {CV_8U, CV_16U}, {1, 3, 4}))
        return encode_png(picture);
    if ((kind == ".jpg" || kind == ".jpeg") && is_of(picture, {CV_8U}, {1, 3}))
        return encode_jpeg(picture);
    if ((kind == ".tif" || kind == ".tiff") && is_of(picture, {CV_8U, CV_16U, CV_32F}, {1}))
        return encode_tiff(picture);
    std::vector<unsigned char> bytes;
    try {
        bytes = opencv_plugin().encode(kind, picture);
    } catch (const cv::Exception&) {
        // an extension that OpenCV has no writer for
    }
    if (bytes.empty())
        throw Error("no such image format");
    return bytes;
}

const OpenCvPlugin& opencv_plugin() {
    static const OpenCvPlugin& opencv = []() -> const OpenCvPlugin& {
        // OpenCV's own limit, which it takes from there when its library is loaded.
        setenv("OPENCV_IO_MAX_IMAGE_PIXELS", fmt::format("{}", most_picture_pixels).c_str(), 0);
        return plugin<OpenCvPlugin>("opencv");
    }();
    return opencv;
}

}  // namespace etalon
