// What measures motion: registration of a layer with a frame, robust affine fit of a flow.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Every how manieth of so many pixels to take, to get about as many as wanted.
Index every(double area, Index wanted);

// List the pixels by which `reference` is registered: those of positive weight, every `stride`-th of a row, as many
// as there is room for.
void collect(Size size, const float *reference, const float *weight, const Grid &grid, Index stride, Points *points);

// Mean of min(|I(p + a(p)) - g R(p) - b|, `ceiling`) over the listed points, each of its weight; 1e9 when less than a
// quarter of the weight is in the frame.
double residual(Size size, const float *image, const Points &points, const double *theta, double ceiling,
                const Rectangle &inside);

// Register the listed points in `image`: minimise Σ w ρ(I(p + a(p)) - g R(p) - b) over theta = (a, g, b), in place.
// ρ has the weights (1 + (e / scale)²)⁻². `stiffness` is what it costs, per unit of weight, to be more than
// translation, rotation and change of size. It ends early when there is nothing left to gain. costs[0] and costs[1]
// receive the `residual` at the start and at the end. With no steps that is all it does.
void gauss_newton(Size size, const float *image, const Points &points, const Registration &how, const Rectangle &inside,
                  double *theta, double *costs);

// How a flow is fitted. `ridge` keeps a fit close to its start, per pixel: translation, and what is along X and Y.
struct FlowFit {
    double noise;
    const double *camera;
    double ridge[3];
    bool young; // fit translation, rotation and change of size only, and weigh pixels by their contrast to the camera
    Index stride;
};

// Robust affine fit of a flow on the object {odds > 0, weight > 0}, towards that in `theta`, in place. Iteratively
// reweighted least squares, five rounds. Pixels count by their gradient (a flat pixel's flow is only its neighbours')
// and by the odds that they are the object.
void fit_affine(Size size, const float *flow, const float *gray, const float *odds, const float *weight,
                const Grid &grid, const FlowFit &how, double *theta);

} // namespace HS_LEVEL
} // namespace hs
