// The corner finder of compare/detect/chessboard_corners.h behind the Detector interface.
#include "compare/detect/chessboard_corners.h"
#include "compare/detect/detector_adaptors.h"
#include "core/errors.h"

namespace etalon {
namespace {

class ChessboardDetector final : public Detector {
public:
    explicit ChessboardDetector(const Marker& board)
        : Detector("chessboard"), columns_(board.columns), rows_(board.rows) {}

    Detection detect(const CodeImage& image) override {
        const auto found = find_chessboard_corners(image, columns_, rows_);
        return found ? only_one({{0, found->pixels}}) : only_one({});
    }

private:
    int columns_, rows_;
};

}  // namespace

std::unique_ptr<Detector> make_chessboard_detector(const Marker& marker, const std::string& place) {
    if (marker.kind != Marker::Kind::chessboard)
        throw ConfigError({place}, "the chessboard detector cannot see " + marker.spec);
    return std::make_unique<ChessboardDetector>(marker);
}

}  // namespace etalon
