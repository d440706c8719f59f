// The kernels of segmentation (hs_tracker_cv/segmentation), and the plain data that they take.
//
// A window is `size` pixels; its images have three floats per pixel, its planes one, its masks a byte that is 0 or 1.
// All are C-contiguous. An affine motion is theta[0..5]: q = p + (t0 + t1 X + t2 Y, t3 + t4 X + t5 Y) with
// X = (x - cx) / scale, Y alike; theta[6] is a gain in percent, theta[7] a bias in gray levels.
#pragma once

#include "../planes.hpp"

#include <cstdint>

namespace hs {

using Byte = std::uint8_t;

constexpr float KNOWN = 3.0f;    // samples from which on a background pixel is known
constexpr double FAR_OFF = 40.0; // gray levels: where two images differ by more, it counts as this much
constexpr Index CHANNELS = 3;
constexpr Index BINS = 8 * 8 * 8; // of blue, green and red
constexpr Index THETA = 8;        // numbers of a motion
constexpr Index POINT_ROWS = 5 + 3 * CHANNELS;
constexpr Index EVIDENCE_PLANES = 4;
constexpr Index LEAST_SIDE = 3; // px of a window

struct Size {
    Index height, width;
};

// Part of a window, window px; right and bottom are exclusive.
struct Rectangle {
    Index left, top, right, bottom;
};

// Coordinates relative to the object, and its area in pixels.
struct Grid {
    double cx, cy, scale, area;
};

// The background: its image, and three planes of counts: samples, mismatches, age.
struct Ground {
    const float *image, *counts;
};

// What moves with the object: the last frame, its own image, its log-odds, its slow shape.
struct Object {
    const float *previous, *image, *odds, *shape;
};

// The same where it is expected in this frame, and a mask of positive log-odds.
struct MovedObject {
    float *previous, *image, *odds, *shape;
    Byte *own;
};

// Pixels by which a layer is registered: rows of `room` floats, of which the first `count` are in use. Rows: x, y, X,
// Y, weight; for each channel the value and a quarter of the difference of its neighbours across and along.
struct Points {
    float *data;
    Index room, count;
};

// A run of pixels of a mask in a row; the head of a component holds its area and what of it is in another mask.
struct Run {
    std::int32_t row, first, end, head, area, common;
};

// What the likelihoods of the layers depend on.
struct Likelihood {
    float ground_slope, object_slope;                       // error (px²) per squared gradient
    float channel_weight;                                   // how much more three channels tell than one
    float contrast;                                         // of the motions, 0–1
    float occluded;                                         // 1 or 0
    float noise;                                            // gray levels
    float ground_low, ground_high, object_low, object_high; // gains that are believed
};

// Images of this frame as each layer explains them: `moved` and `carried` are the last frame moved by the camera and
// by the object's motion.
struct Explanations {
    const float *image, *background, *moved, *carried, *object, *odds, *counts;
};

struct Evidence {
    float *planes; // ratio of log-likelihoods; errors of the background; its gain; error of the last frame
    Byte *fresh;   // something new covers a background that was seen a moment ago
};

struct Labelling {
    const float *image;
    Ground ground;
    const float *odds, *shape; // of the object where it is expected
    const Byte *own;
    float *evidence; // the first plane is changed where something is new
    const Byte *fresh;
    const Byte *before, *hiding; // the last distractor, and where it hides the object; null if there is none
    const float *colours;
    double colour_weight, noise, least;
    Index growth;
    bool emerging, young;
    Rectangle inside;
};

struct Labels {
    std::int16_t *bins;
    float *raw, *odds;
    Byte *mask, *foreign;
};

// Pixels of the distractor; inside the frame those of the shape, of these in the mask, of the mask; its edges.
struct VisiblePart {
    Index foreign, expected, both, seen;
    double left, top, right, bottom;
};

struct Lesson {
    const float *image, *aligned;     // this frame, also on the lattice of the background
    const Byte *mask, *own, *foreign; // `foreign` is null if there is no distractor
    const float *odds, *raw;
    Object expected; // without the last frame
    const float *evidence;
    const std::int16_t *bins;
    Ground ground;
    const float *colours;
    Rectangle part, inside;
    float shape_rate;
    double colour_rate;
    bool freeze, hidden;
};

struct Memory {
    float *odds, *object, *shape, *ground, *counts, *colours;
};

// Known pixels outside the object, those of them that are unexplained, and their spread; -1 if they are too few.
struct Fit {
    Index known, strange;
    double spread;
};

// How the pixels of the object weigh: all alike, as they are visible, or by how surely they have changed.
enum class Weighing { evenly, visible, changed };

struct Prediction {
    const float *odds;
    const Byte *shown; // see Weighing
    Weighing weighing;
    Grid box; // to fall back on when there is no outline
    const float *object, *image;
    Rectangle inside;
    const double *motion; // velocity (2) and linear part (4)
    const double *camera; // velocity
    bool known;           // the motion is as it was, whatever the image says
};

struct Predicted {
    Byte *near; // the object and what is close to it
    float *weight;
    Points points;
    double *theta;
    float *flow;
    Grid grid;
    Rectangle extent; // of all that may belong to the object
    double visible;   // sum of the weights
    double cost;      // mean residual; 0 if the motion is known
};

struct Measurement {
    const float *flow, *image, *previous;
    Rectangle inside;
    const Byte *near;
    const double *camera; // of the last frame
    double noise;
    Ground ground;
    const double *offset; // of the ground in the last frame
    Index ground_steps, steps;
    const float *odds, *weight;
    Grid grid;
    Points points; // none: only the camera is measured
    const double *predicted;
    bool hidden, young;
};

struct Found {
    double score, still;
    Index dx, dy;
};

// What is minimised by `gauss_newton`.
struct Registration {
    const double *prior; // ridge towards the start, per unit of weight
    double scale, ceiling, stiffness;
    Index steps;
};

// One table for each level; comments are where the functions are written.
struct SegmentationKernels {
    // shapes.cpp
    Index (*without)(Size size, const Byte *mask, const Byte *other, Byte *out);
    Index (*invert)(Size size, const Byte *mask, Byte *out);
    void (*median)(Size size, const Byte *mask, Byte *held, Byte *out);
    void (*spread)(Size size, const Byte *allowed, Index times, Byte *held, Byte *out);
    void (*widen)(Size size, const Byte *mask, Index reach, Byte *held, Byte *out);
    void (*widen_cross)(Size size, const Byte *mask, Byte *out);
    Index (*components)(Size size, const Byte *mask, const Byte *other, Run *runs, Index *heads);
    // colour.cpp
    void (*bin_colours)(Size size, const float *image, std::int16_t *bins);
    double (*likelihood)(const float *colours, float *ratio);
    void (*blend)(const float *colours, float *tally, double rate, float *out);
    // windows.cpp
    void (*smooth)(Size size, Index channels, const float *pixels, const float *taps, float *image, float *gray);
    void (*shift)(Size from, const float *source, Index dx, Index dy, float fill, Size to, float *out);
    void (*move_ground)(Size from, const Ground &ground, Index dx, Index dy, float gain, Size to, const float *image,
                        const float *odds, float *picture, float *counts);
    void (*resample)(Size from, Index channels, const float *image, const double *inverse, bool repeat, float fill,
                     Size to, float *out);
    void (*carry)(Size size, const Object &object, const float *counts, const double *inverse, const Rectangle &part,
                  bool everywhere, const MovedObject &out);
    void (*without_object)(Size size, const float *image, const float *odds, Index dx, Index dy, float sure, float fill,
                           float *out);
    // evidence.cpp
    double (*evidence)(Size size, const Explanations &seen, const Rectangle &part, const Rectangle &inside,
                       const Likelihood &how, const Evidence &out);
    // registration.cpp
    void (*collect)(Size size, const float *reference, const float *weight, const Grid &grid, Index stride,
                    Points *points);
    double (*residual)(Size size, const float *image, const Points &points, const double *theta, double ceiling,
                       const Rectangle &inside);
    void (*gauss_newton)(Size size, const float *image, const Points &points, const Registration &how,
                         const Rectangle &inside, double *theta, double *costs);
    // motion.cpp
    void (*start_flow)(Size size, const Byte *near, const Grid &grid, const double *theta, const double *camera,
                       float *flow);
    void (*predict)(Size size, const Prediction &what, Predicted *out);
    void (*measure)(Size size, const Measurement &what, double *ground, double *theta);
    Found (*search_shift)(Size size, const float *image, const float *object, const float *shape, const Byte *different,
                          const Index *centre, Index reach, Index step, const Rectangle &inside, double noise);
    // labelling.cpp
    VisiblePart (*label)(Size size, const Labelling &what, const Labels &out);
    // memory.cpp
    Fit (*learn)(Size size, const Lesson &what, const Memory &out);
};

extern const SegmentationKernels segmentation_plain, segmentation_v2, segmentation_v3,
    segmentation_v4; // those of the processor's family

template <class T> static inline T larger(T a, T b) { return a > b ? a : b; }
template <class T> static inline T smaller(T a, T b) { return a < b ? a : b; }

} // namespace hs
