// The corner finder of compare/detect/board/chessboard_corners.h behind the Detector interface.
#include <fmt/format.h>

#include "compare/detect/board/chessboard_corners.h"
#include "compare/detect/detector_adaptors.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

class ChessboardDetector final : public Detector {
public:
    explicit ChessboardDetector(const Marker& board)
        : Detector("chessboard"),
          columns_(board.columns),
          rows_(board.rows),
          on_its_side_(
              fmt::format("chessboard:{}x{}@{}mm", rows_, columns_, exact(board.size_mm))) {}

    Detection detect(const CodeImage& image) override {
        const auto found = find_chessboard_corners(image, columns_, rows_);
        if (!found)
            return only_one({});
        Detection detection = only_one({{0, found->pixels}});
        if (found->lies_on_its_side)
            detection.shown_as = on_its_side_;
        return detection;
    }

private:
    int columns_, rows_;
    std::string on_its_side_;
};

}  // namespace

std::unique_ptr<Detector> make_chessboard_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::chessboard)
        throw ConfigError({place}, "the chessboard detector cannot see " + marker.spec);
    return std::make_unique<ChessboardDetector>(marker);
}

}  // namespace etalon
