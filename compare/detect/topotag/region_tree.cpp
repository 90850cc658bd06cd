// Runs of equal pixels row by row, joined to those of the row above by union and find. The smaller
// label survives: it was met first, so that what lies left of its first run is the region around.
#include <cstring>

#include "compare/detect/topotag/topotag_detector.h"

namespace etalon {
namespace {

struct Run {
    int begin, end;  // columns, `end` is one behind
    int label;
    bool is_dark;
};

// Where the run that begins at `x` ends: eight pixels at a time.
int end_of_run(const uchar* row, int x, int columns) {
    const std::uint64_t same = row[x] ? ~std::uint64_t{0} : 0;
    std::uint64_t eight = same;
    int end = x;
    while (end + 8 <= columns) {
        std::memcpy(&eight, row + end, 8);
        if (eight != same)
            break;
        end += 8;
    }
    while (end < columns && row[end] == row[x])
        ++end;
    return end;
}

class Labels {
public:
    int make(int parent, bool is_dark) {
        const int label = static_cast<int>(joined_.size());
        joined_.push_back(label);
        regions_.push_back({parent, is_dark});
        return label;
    }

    int find(int label) {
        while (joined_[label] != label) {
            joined_[label] = joined_[joined_[label]];
            label = joined_[label];
        }
        return label;
    }

    int join(int a, int b) {
        a = find(a);
        b = find(b);
        joined_[std::max(a, b)] = std::min(a, b);
        return std::min(a, b);
    }

    void add(const Run& run, int y) {
        const double count = run.end - run.begin;
        Region& region = regions_[run.label];
        region.area += count;
        region.sum += Eigen::Vector2d((run.begin + run.end - 1) * count / 2.0, y * count);
    }

    // Only what survived, with the sums of what was joined to it.
    std::vector<Region> survivors() {
        std::vector<int> index(joined_.size());
        std::vector<Region> result;
        for (int label = 0; label < static_cast<int>(joined_.size()); ++label) {
            const Region& part = regions_[label];
            const int root = find(label);
            if (root == label) {
                index[label] = static_cast<int>(result.size());
                result.push_back(part);
                if (part.parent >= 0)
                    result.back().parent = index[find(part.parent)];
            } else {
                result[index[root]].area += part.area;
                result[index[root]].sum += part.sum;
            }
        }
        return result;
    }

private:
    std::vector<int> joined_;
    std::vector<Region> regions_;
};

void take_runs(const uchar* row, int columns, std::vector<Run>& runs) {
    runs.clear();
    for (int x = 0; x < columns;) {
        const int end = end_of_run(row, x, columns);
        runs.push_back({x, end, -1, row[x] != 0});
        x = end;
    }
}

// Labels the runs of a row from those above it.
void join_rows(const std::vector<Run>& above, std::vector<Run>& runs, Labels& labels) {
    std::size_t first = 0;
    int left = 0;  // label of what is to the left; outside the image the outermost region
    for (Run& run : runs) {
        const int reach = run.is_dark ? 0 : 1;
        while (first < above.size() && above[first].end + 1 <= run.begin)
            ++first;
        for (std::size_t i = first; i < above.size() && above[i].begin < run.end + reach; ++i)
            if (above[i].is_dark == run.is_dark && above[i].end + reach > run.begin)
                run.label = run.label < 0 ? labels.find(above[i].label)
                                          : labels.join(run.label, above[i].label);
        if (run.label < 0)
            run.label = labels.make(left, run.is_dark);
        left = run.label;
    }
}

}  // namespace

std::vector<Region> region_tree(const cv::Mat& dark) {
    Labels labels;
    const int outermost = labels.make(-1, false);
    std::vector<Run> above = {{-1, dark.cols + 1, outermost, false}}, runs;
    for (int y = 0; y < dark.rows; ++y) {
        take_runs(dark.ptr<uchar>(y), dark.cols, runs);
        join_rows(above, runs, labels);
        for (Run* end : {&runs.front(), &runs.back()})
            if (!end->is_dark)
                end->label = labels.join(end->label, outermost);
        for (const Run& run : runs)
            labels.add(run, y);
        std::swap(above, runs);
    }
    for (const Run& run : above)
        if (!run.is_dark)
            labels.join(run.label, outermost);
    std::vector<Region> regions = labels.survivors();
    for (std::size_t i = 1; i < regions.size(); ++i)
        regions[static_cast<std::size_t>(regions[i].parent)].children.push_back(
            static_cast<int>(i));
    return regions;
}

}  // namespace etalon
