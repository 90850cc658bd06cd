// Fits a blur that many edges share, and of each edge its levels and its place: the least-squares
// engine behind point spread and defocus.
//
//     radiance = dark + (step + g_n d + g_t t) E(d - shift - turn t)
//
// d and t are a pixel's distance and its place along the edge, E the profile of pixel box and lens.
// The light side's illumination may vary linearly (g); the dark side's variation is neglected, as
// there is hardly any light. Six parameters an edge are eliminated, edge by edge, from the normal
// equations (Schur complement); what is left is as small as the shared blur.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>
#include <vector>

#include "compare/edges/edge_spread.h"

namespace etalon {

// A family of lens blurs (without the pixel box) by a few parameters.
struct BlurModel {
    Eigen::VectorXd start, lower;  // of the parameters: where to begin, and their least values
    // The parameters are parts of one whole: their sum is 1, which the edges' steps leave open.
    bool are_parts = false;
    // Transfer along the edge's normal at these frequencies, cycles per px, and its derivatives,
    // one column a parameter.
    struct Transfer {
        Eigen::ArrayXd value;
        Eigen::MatrixXd derivative;
    };
    std::function<Transfer(const StraightEdge& edge, const Eigen::VectorXd& parameters,
                           const Eigen::ArrayXd& cycles_per_px)>
        transfer;
};

// One edge's own part of the fit.
struct FittedEdge {
    double dark = 0.0, step = 0.0, gradient_across = 0.0, gradient_along = 0.0;
    double shift_px = 0.0, turn = 0.0;
    double reduced_chi_square = 0.0;
    bool is_outlier = false;        // not used: its chi-square is far above the others'
    std::vector<double> residuals;  // radiance, by pixel
};

struct EdgeFit {
    Eigen::VectorXd parameters;
    // The formal covariance (noise times the residuals' excess over it), made larger where, with
    // 8 edges or more, the scatter of the edges' scores asks for it (sandwich with the factor
    // n / (n - parameters), on average over the parameters). Bounds are not counted as knowledge.
    Eigen::MatrixXd covariance;
    std::vector<bool> is_at_bound;
    std::vector<FittedEdge> edges;
    double chi_square = 0.0, reduced_chi_square = 0.0;
    double residual_rms = 0.0;  // in parts of each edge's step
    int degrees_of_freedom = 0, pixels = 0, used_edges = 0, outlying_edges = 0;
};

// An edge's pixels less its own six parameters.
int own_freedom(const StraightEdge& edge);

// Gauss-Newton with bounds; edges whose reduced chi-square is over 4 times the median are left out
// and the rest fitted again. Throws NumericalError when it does not converge, there are fewer
// pixels than parameters, or the edges do not determine the blur.
EdgeFit fit_edges(std::span<const StraightEdge> edges, const BlurModel& model);

}  // namespace etalon
