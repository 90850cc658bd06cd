// What a renderer (sim/render/renderer.h) makes and a sensor (sim/sensor/sensor_model.h) sees, and
// what was done and left out for it, with bounds.
#pragma once

#include <vector>

#include "core/image/image.h"

namespace etalon {

enum class RenderMethod {
    automatic,
    exact_lens,   // E
    exact_area,   // C
    edge_table,   // of tiles that see one edge, by a table
    wedge_table,  // of sharp images, by a table of edges and corners
    reference,
    wave,  // of a camera with the wave-optical point spread, and of no other
};

// What a scene may not need. Turning one off (RenderOptions::keep) changes the image by less than
// the tolerance.
enum class NeglectedEffect {
    lens,           // the blur is too small to matter: the lens centre stands for the aperture
    diffraction,    // the point spread is too narrow to matter: pixels are box averages
    tail,           // diffraction beyond some radius
    distortion,     // the calibration has none
    uniform_tiles,  // a tile all of whose rays meet one radiance is one number
};

const char* name_of(NeglectedEffect omission);

struct NeglectedBound {
    NeglectedEffect what;
    std::string why;  // the bound in words, with its number
    double gray;      // no pixel is off by more for it
};

// How the tiles that were not uniform were sampled.
struct TileUse {
    RenderMethod method;  // not automatic, reference or wave
    int points_per_pixel_side;
    int lens_points;  // of exact_area
    long tiles;
};

struct RenderPlan {
    RenderMethod method = RenderMethod::automatic;  // of most tiles: never automatic
    double tolerance_gray = 0.0;
    int points_per_pixel_side = 1;  // k: samples to the filter
    double sampling_gray = 0.0;     // bound for a straight edge, from k samples or a table
    // More than that, where the border of the valid region cuts the marker beside a pixel.
    double border_gray = 0.0;
    double min_blur_radius_px = 0.0;  // over the marker; 0 where it is in focus
    double max_blur_radius_px = 0.0;
    double tail_reach_px = 0.0;  // of diffraction; 0: none
    std::vector<NeglectedBound> left_out;
    std::vector<TileUse> used;  // most tiles first
    long uniform_tiles = 0;     // one number each, most of them found many at a time
    std::string instructions;   // the vector instructions used

    std::string describe() const;  // one line for people
};

struct RenderedImage {
    Radiance radiance;  // CV_32FC1, the camera's size
    // CV_8UC1: 255 where the pixel's ray exists, 0 outside the valid region (background's
    // radiance). Shared by all images of a renderer: do not write.
    cv::Mat valid;
    RenderPlan plan;
};

// A rendering without what sees nothing but the background: all that there is to a small marker in
// a large image.
struct RenderedPart {
    cv::Rect region;          // within the image; empty when all of it is background
    Radiance radiance;        // CV_32FC1, the region's size
    double background = 0.0;  // the radiance of all other pixels
    RenderPlan plan;

    // CV_32FC1 of the size of `other`, a rectangle of the image: part and background.
    Radiance within(const cv::Rect& other) const;
};

}  // namespace etalon
