// The vector code in single precision against the same sums from the scalar functions in double
// precision, on every instruction set that was compiled in and that this machine has.
#include "sim/tiles/tile_kernel.h"

#include <Eigen/Core>
#include <numeric>
#include <random>

#include "sim/tiles/lens_average.h"
#include "tests/image_of.h"
#include "tests/sim/every_target.h"

namespace etalon {
namespace {

TEST(TileKernel, NamesTheInstructionSetInUse) {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        // What needs no instruction set is SCALAR by one compiler and EMU128 by another.
        if (target < HWY_EMU128) {
            EXPECT_STREQ(tile_kernel_target(), hwy::TargetName(target));
        } else {
            EXPECT_THAT(tile_kernel_target(),
                        testing::AnyOf(testing::StrEq("SCALAR"), testing::StrEq("EMU128")));
        }
    }
    hwy::SetSupportedTargetsForTest(0);
}

// ---- The truth

struct Point {
    Eigen::Vector2d d;      // dx, dy
    Eigen::Matrix2d sides;  // of a part of the tile: columns by s and by t
    double blur;
    double turned = 1.0;  // the lens' part of it, by its change: how far the turn counts
};

// Powers 0 to 3 and their derivatives.
Eigen::Vector4d powers(double x) {
    return {1.0, x, x * x, x * x * x};
}
Eigen::Vector4d slopes(double x) {
    return {0.0, 1.0, 2.0 * x, 3.0 * x * x};
}

double bicubic(const std::array<float, 16>& c, const Eigen::Vector4d& s, const Eigen::Vector4d& t) {
    return s.dot(Eigen::Map<const Eigen::Matrix4f>(c.data()).cast<double>() * t);
}

Point point_of(const TileGeometry& tile, int n, int column, int row) {
    const double s = (column + 0.5) / n - 0.5, t = (row + 0.5) / n - 0.5;
    const Eigen::Vector4d ps = powers(s), pt = powers(t), ds = slopes(s), dt = slopes(t);
    Point point;
    point.d = {bicubic(tile.dx, ps, pt), bicubic(tile.dy, ps, pt)};
    point.sides << bicubic(tile.dx, ds, pt), bicubic(tile.dx, ps, dt), bicubic(tile.dy, ds, pt),
        bicubic(tile.dy, ps, dt);
    point.sides /= n;
    point.blur = tile.blur + tile.blur_slope_x * point.d.x() + tile.blur_slope_y * point.d.y();
    if (tile.disk > 0.0f) {
        const double lens = point.blur, disk = tile.disk, cosine = tile.disk_cosine;
        point.blur = std::sqrt(lens * lens + disk * disk + 2.0 * cosine * lens * disk);
        point.turned = (lens + cosine * disk) / point.blur;
    }
    return point;
}

struct SteepLine {
    double offset;          // D
    Eigen::Vector2d slope;  // w
    Eigen::Vector2d gradient;
};

SteepLine line_of(const TileGeometry& tile, const TileLine& line, const Point& point) {
    const Eigen::Vector2d gradient(line.gradient_x, line.gradient_y);
    const double offset = line.offset + gradient.dot(point.d);
    const Eigen::Vector2d turn(tile.turn_x, tile.turn_y);
    return {offset, point.blur * gradient - point.turned * turn * offset, gradient};
}

DiskChord chord_of(const SteepLine& line) {
    const double slope = line.slope.norm();
    if (std::abs(line.offset) < slope)
        return disk_chord(line.slope / slope, line.offset / slope);
    return {{1.0, 0.0}, 0.0, 0.0, 0.0, line.offset >= 0.0 ? 1.0 : 0.0};
}

double overlap(const DiskChord& a, const DiskChord& b) {
    const bool both = a.half_length > 0.0 && b.half_length > 0.0;
    return both ? disk_wedge_area(a, b) : a.area * b.area;
}

double overlap(const SquareCut& a, const SquareCut& b) {
    return square_wedge_area(a, b);
}

// Of the parts that `cut_of` says of each line.
template <class CutOf>
double sum_of_cells(const TileGeometry& tile, CutOf cut_of) {
    std::vector<std::invoke_result_t<CutOf, TileLine>> columns, rows;
    std::ranges::transform(tile.columns, std::back_inserter(columns), cut_of);
    std::ranges::transform(tile.rows, std::back_inserter(rows), cut_of);
    const auto cell = [&](std::size_t row, std::size_t column) {
        return tile.cells[row * (columns.size() + 1) + column];
    };
    double sum = cell(0, 0);
    for (std::size_t i = 0; i < columns.size(); ++i)
        sum += (cell(0, i + 1) - cell(0, i)) * columns[i].area;
    for (std::size_t j = 0; j < rows.size(); ++j) {
        sum += (cell(j + 1, 0) - cell(j, 0)) * rows[j].area;
        for (std::size_t i = 0; i < columns.size(); ++i)
            sum += (cell(j + 1, i + 1) - cell(j + 1, i) - cell(j, i + 1) + cell(j, i)) *
                   overlap(columns[i], rows[j]);
    }
    return sum;
}

double lens_average(const TileGeometry& tile, const Point& point) {
    return sum_of_cells(tile,
                        [&](const TileLine& line) { return chord_of(line_of(tile, line, point)); });
}

SquareCut box_cut(const TileGeometry& tile, const TileLine& tile_line, const Point& point,
                  const UnitLensPoint& l) {
    const Eigen::Vector2d lens(l.x, l.y), turn(tile.turn_x, tile.turn_y);
    const SteepLine line = line_of(tile, tile_line, point);
    const Eigen::Vector2d gradient =
        line.gradient * (1.0 - turn.dot(lens)) +
        Eigen::Vector2d(tile.blur_slope_x, tile.blur_slope_y) * line.gradient.dot(lens);
    return square_cut(point.sides.transpose() * gradient, line.offset + line.slope.dot(lens));
}

double area_average(const TileGeometry& tile, const Point& point, const UnitLensPoint& l) {
    return sum_of_cells(tile, [&](const TileLine& line) { return box_cut(tile, line, point, l); });
}

// How far single precision may displace a line, px: some roundings of its largest terms.
double displacement(const TileGeometry& tile, const TileLine& line, const Point& point) {
    return std::ldexp(std::abs(line.offset) + point.d.cwiseAbs().sum() + std::abs(tile.blur) +
                          std::abs(point.blur - tile.blur) + tile.disk,
                      -24);
}

// What that changes: the area beyond a line that cuts the aperture has the slope
// d area / d offset <= (2 / pi) / |w|, ...
double lens_allowance(const TileGeometry& tile, const Point& point) {
    double sum = 0.0;
    for (const auto* lines : {&tile.columns, &tile.rows})
        for (const TileLine& tile_line : *lines) {
            const double moved = displacement(tile, tile_line, point);
            const SteepLine line = line_of(tile, tile_line, point);
            const double slope = line.slope.norm();
            if (std::abs(line.offset) <= slope + moved)
                sum += std::min(1.0, 2.0 / std::numbers::pi * moved / (slope + 1e-30));
        }
    return sum;
}

// ... and of one that cuts a part of the tile d area / d offset <= 1 / its larger extent.
double area_allowance(const TileGeometry& tile, const Point& point, const UnitLensPoint& l) {
    double sum = 0.0;
    for (const auto* lines : {&tile.columns, &tile.rows})
        for (const TileLine& tile_line : *lines) {
            const double moved = 8.0 * displacement(tile, tile_line, point);
            const SquareCut cut = box_cut(tile, tile_line, point, l);
            if (std::abs(cut.offset) <= 0.5 * cut.gradient.cwiseAbs().sum() + moved)
                sum += std::min(1.0, moved / (cut.gradient.cwiseAbs().maxCoeff() + 1e-30));
        }
    return sum;
}

// ---- Random tiles

class TileMaker {
public:
    explicit TileMaker(unsigned seed) : random_(seed) {}

    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(random_);
    }
    double log_uniform(double low, double high) {
        return std::exp(uniform(std::log(low), std::log(high)));
    }
    bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
    double sign() { return chance(0.5) ? 1.0 : -1.0; }

    // About `px` wide, turned, stretched and bent.
    void map(TileGeometry& tile, double px) {
        const double angle = uniform(0.0, 2.0 * std::numbers::pi);
        tile.dx = {};
        tile.dy = {};
        for (std::size_t i = 2; i < 16; ++i) {
            tile.dx[i] = static_cast<float>(px * uniform(-2e-3, 2e-3));
            tile.dy[i] = static_cast<float>(px * uniform(-2e-3, 2e-3));
        }
        tile.dx[1] = static_cast<float>(px * std::cos(angle));
        tile.dx[4] = static_cast<float>(-px * std::sin(angle) * uniform(0.8, 1.2));
        tile.dy[1] = static_cast<float>(px * std::sin(angle));
        tile.dy[4] = static_cast<float>(px * std::cos(angle) * uniform(0.8, 1.2));
    }

    void lens(TileGeometry& tile, double blur, double slope, double turn) {
        tile.blur = static_cast<float>(blur);
        tile.blur_slope_x = static_cast<float>(uniform(-slope, slope));
        tile.blur_slope_y = static_cast<float>(uniform(-slope, slope));
        const double angle = uniform(0.0, 2.0 * std::numbers::pi);
        tile.turn_x = static_cast<float>(turn * std::cos(angle));
        tile.turn_y = static_cast<float>(turn * std::sin(angle));
    }

    TileLine line(double angle, double offset) {
        return {static_cast<float>(offset), static_cast<float>(std::cos(angle)),
                static_cast<float>(std::sin(angle))};
    }

    // Cells from 0 to 1 before the lines that are there, a third of them equal to a neighbour.
    void cells(TileGeometry& tile) {
        tile.cells.resize((tile.columns.size() + 1) * (tile.rows.size() + 1));
        for (std::size_t i = 0; i < tile.cells.size(); ++i)
            tile.cells[i] = i > 0 && chance(0.3) ? tile.cells[i - 1] : uniform(0.0, 1.0);
    }

private:
    std::mt19937 random_;
};

// Two lines with an exact sine of 0 up to some, in the same or in opposite directions, that graze
// or cross the blur disk of a tile: everything that is delicate about the wedge.
TileGeometry delicate_tile(TileMaker& make) {
    TileGeometry tile;
    const double blur = make.log_uniform(0.05, 500.0);
    make.map(tile, make.log_uniform(1e-5, 4.0));
    make.lens(tile, make.sign() * blur, make.chance(0.5) ? 0.0 : 0.02, make.log_uniform(1e-6, 0.5));
    const double angle = make.uniform(0.0, 2.0 * std::numbers::pi);
    const double between = make.chance(0.1) ? 0.0 : make.sign() * make.log_uniform(1e-8, 3.2);
    const double opposite = make.chance(0.5) ? std::numbers::pi : 0.0;
    const auto offset = [&] {
        const double gap = make.chance(0.1) ? 0.0 : make.log_uniform(1e-8, 2.0);
        return blur * make.sign() * (1.0 - gap);
    };
    const double first = offset();
    const bool same_point = make.chance(0.5);
    const double second =
        same_point ? first * (opposite > 0.0 ? -1.0 : 1.0) + blur * make.uniform(-2, 2) * between
                   : offset();
    tile.columns = {make.line(angle, first)};
    tile.rows = {make.line(angle + between + opposite, second)};
    make.cells(tile);
    return tile;
}

// A tile as a renderer makes it: up to 4 x 4 lines a few px apart, any blur, through focus or not.
TileGeometry everyday_tile(TileMaker& make) {
    TileGeometry tile;
    const double blur = make.chance(0.1) ? 0.0 : make.log_uniform(1e-3, 10.0);
    make.map(tile, 4.0);
    make.lens(tile, make.sign() * blur, make.chance(0.5) ? 1e-4 : 0.05, make.uniform(0.0, 0.02));
    const double angle = make.uniform(0.0, 6.3), other = angle + make.uniform(0.1, 3.0);
    const auto lines = [&](double direction) {
        std::vector<TileLine> result;
        double offset = make.uniform(0.0, 5.0);
        for (int count = static_cast<int>(make.uniform(0.0, 4.99)); count > 0; --count) {
            result.push_back(make.line(direction + make.uniform(-0.01, 0.01), offset));
            offset -= make.log_uniform(0.1, 5.0);
        }
        return result;
    };
    tile.columns = lines(angle);
    tile.rows = lines(other);
    make.cells(tile);
    return tile;
}

struct WorstError {
    double against_truth = 0.0, against_first = 0.0;  // as parts of what is allowed
};

// An everyday tile for averages over a disk and the lens.
TileGeometry disk_tile(TileMaker& make) {
    TileGeometry tile = everyday_tile(make);
    tile.disk = static_cast<float>(make.log_uniform(0.02, 1.0));
    tile.disk_cosine = static_cast<float>(make.uniform(-0.9, 0.9));
    return tile;
}

// At a point: the truth, and by how much single precision may miss it beyond rounding.
struct Expected {
    double value = 0.0, allowance = 0.0;
};

// Of so many samples a side in the i-th tile, what `evaluate` gives on every target.
template <class ExpectedAt, class Evaluate>
WorstError worst_error(TileGeometry (*make_tile)(TileMaker&), int tiles, unsigned seed,
                       int (*samples_of)(int), ExpectedAt expected_at, Evaluate evaluate) {
    TileMaker make(seed);
    WorstError worst;
    for (int i = 0; i < tiles; ++i) {
        const int n = samples_of(i);
        const TilePositions positions(n);
        const TileGeometry tile = make_tile(make);
        std::vector<Expected> expected;
        for (int p = 0; p < n * n; ++p)
            expected.push_back(expected_at(tile, point_of(tile, n, p % n, p / n)));
        std::vector<float> first;
        on_every_target([&] {
            std::vector<float> values(expected.size());
            evaluate(tile, positions, values.data());
            if (first.empty())
                first = values;
            for (std::size_t p = 0; p < values.size(); ++p) {
                const double allowance = expected[p].allowance;
                const double error = std::abs(values[p] - expected[p].value);
                const double difference = std::abs(values[p] - first[p]);
                // Written so that NaN counts.
                if (!(error / (2e-3 * gray + allowance) <= worst.against_truth))
                    worst.against_truth = error / (2e-3 * gray + allowance);
                if (!(difference / (1e-3 * gray + allowance) <= worst.against_first))
                    worst.against_first = difference / (1e-3 * gray + allowance);
            }
        });
    }
    return worst;
}

// Of 24 x 24 points those in blocks that no line cuts are not evaluated one by one.
WorstError worst_lens_error(TileGeometry (*make_tile)(TileMaker&), int tiles, unsigned seed) {
    return worst_error(
        make_tile, tiles, seed, [](int i) { return i % 4 == 0 ? 24 : 16; },
        [](const TileGeometry& tile, const Point& point) {
            return Expected{lens_average(tile, point), lens_allowance(tile, point)};
        },
        [](const TileGeometry& tile, const TilePositions& positions, float* values) {
            exact_lens_samples(tile, positions, values);
        });
}

WorstError worst_area_error(TileGeometry (*make_tile)(TileMaker&), int tiles, unsigned seed) {
    static const std::vector<UnitLensPoint> lens_points{
        {0.3f, -0.6f, 0.375f}, {-0.9f, 0.2f, 0.5f}, {0.0f, 0.0f, 0.125f}};
    return worst_error(
        make_tile, tiles, seed, [](int) { return 12; },
        [](const TileGeometry& tile, const Point& point) {
            Expected sum;
            for (const UnitLensPoint& l : lens_points) {
                sum.value += l.weight * area_average(tile, point, l);
                sum.allowance += l.weight * area_allowance(tile, point, l);
            }
            return sum;
        },
        [](const TileGeometry& tile, const TilePositions& positions, float* values) {
            exact_area_samples(tile, positions, lens_points, values);
        });
}

struct RandomTiles {
    const char* name;
    WorstError (*worst_error)(TileGeometry (*)(TileMaker&), int, unsigned);
    TileGeometry (*make_tile)(TileMaker&);
    int tiles;
    unsigned seed;
};

class TileKernelOf : public testing::TestWithParam<RandomTiles> {};

TEST_P(TileKernelOf, RandomTilesIsThatOfDoublePrecision) {
    const RandomTiles& of = GetParam();
    const WorstError worst = of.worst_error(of.make_tile, of.tiles, of.seed);
    EXPECT_LT(worst.against_truth, 1.0);
    EXPECT_LT(worst.against_first, 1.0);
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, TileKernelOf,
    testing::Values(RandomTiles{"LensDelicate", worst_lens_error, delicate_tile, 4000, 11},
                    RandomTiles{"LensEveryday", worst_lens_error, everyday_tile, 1000, 12},
                    RandomTiles{"LensAndDisk", worst_lens_error, disk_tile, 600, 15},
                    RandomTiles{"AreaDelicate", worst_area_error, delicate_tile, 1500, 13},
                    RandomTiles{"AreaEveryday", worst_area_error, everyday_tile, 1000, 14}),
    [](const auto& tiles) { return tiles.param.name; });

TEST(TileKernel, ManyLinesAreSummedInPatches) {
    // 70 x 45 cells of 0.1 px in a tile of 4 px: more than one patch in both directions.
    TileMaker make(15);
    TileGeometry tile;
    make.map(tile, 4.0);
    make.lens(tile, 1.5, 0.01, 0.01);
    for (int i = 0; i < 70; ++i)
        tile.columns.push_back(make.line(0.4, 3.0 - 0.1 * i));
    for (int j = 0; j < 45; ++j)
        tile.rows.push_back(make.line(1.9, 2.0 - 0.1 * j));
    make.cells(tile);
    constexpr int n = 4;
    const TilePositions positions(n);
    std::vector<float> values(n * n);
    exact_lens_samples(tile, positions, values.data());
    // Sums of 3000 terms of full scale: their rounding adds up.
    for (int i = 0; i < n * n; ++i)
        EXPECT_NEAR(values[static_cast<std::size_t>(i)],
                    lens_average(tile, point_of(tile, n, i % n, i / n)), 0.02 * gray);
}

TEST(TileKernel, WithoutLinesEveryPointHasTheBase) {
    TileGeometry tile{};
    tile.cells = {0.5};
    tile.background = 0.125;
    const TilePositions positions(8);
    std::vector<float> values(64, -1.0f);
    exact_lens_samples(tile, positions, values.data());
    EXPECT_EQ(values, std::vector<float>(64, 0.375f));
    exact_area_samples(tile, positions, std::vector<UnitLensPoint>{{0.0f, 0.0f, 1.0f}},
                       values.data());
    EXPECT_EQ(values, std::vector<float>(64, 0.375f));
}

TEST(TileKernel, AnEdgeWithoutBlurIsASharpStep) {
    TileGeometry tile{};
    tile.dx[1] = 4.0f;
    tile.dy[4] = 4.0f;
    tile.columns = {{0.0f, 1.0f, 0.0f}};
    tile.cells = {0.0, 1.0};
    const TilePositions positions(4);
    on_every_target([&] {
        std::vector<float> values(16);
        exact_lens_samples(tile, positions, values.data());
        for (std::size_t i = 0; i < 16; ++i)
            EXPECT_EQ(values[i], i % 4 < 2 ? 0.0f : 1.0f) << i;
    });
}

TEST(TileKernel, AreasOfAGridThatIsSquareToThePixelsAreExact) {
    // Lines along the parts' sides: a part's gradient along a side is exactly 0. The rectangle
    // from (1.52, 1.54) to (1.82, 1.70) px lies across the border of two parts for most n.
    TileGeometry tile{};
    tile.dx[1] = tile.dy[4] = 4.0f;
    for (const float x : {1.52f, 1.82f})
        tile.columns.push_back({-x, 1.0f, 0.0f});
    for (const float y : {1.54f, 1.70f})
        tile.rows.push_back({-y, 0.0f, 1.0f});
    tile.cells = {0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0};
    const UnitLensPoint centre{0.0f, 0.0f, 1.0f};
    on_every_target([&] {
        for (const int k : {1, 2, 3, 5}) {
            std::vector<float> values(static_cast<std::size_t>(16 * k * k));
            exact_area_samples(tile, TilePositions(4 * k), {&centre, 1}, values.data());
            const double sum = std::accumulate(values.begin(), values.end(), 0.0);
            EXPECT_NEAR(sum / (k * k), 0.30 * 0.16, 1e-6) << k;
        }
    });
}

TEST(TileKernel, RefusesTilesThatAreNotWholeBlocks) {
    EXPECT_THROW(TilePositions(0), NumericalError);
    EXPECT_THROW(TilePositions(-4), NumericalError);
    EXPECT_THROW(TilePositions(6), NumericalError);
}

}  // namespace
}  // namespace etalon
