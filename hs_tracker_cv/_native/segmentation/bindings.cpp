#include "bindings.hpp"

#include "../levels.hpp"
#include "../views.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <tuple>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

using Handle = nb::handle;
using Unlocked = nb::gil_scoped_release;
using Image = Array<const float, 3>;
using Plane2 = Array<const float, 2>;
using Mask = Array<const Byte, 2>;
using Numbers = Array<const double, 1>;
using ImageOut = Array<float, 3>;
using PlaneOut = Array<float, 2>;
using MaskOut = Array<Byte, 2>;
using NumbersOut = Array<double, 1>;
using Pair2 = std::array<double, 2>;

const SegmentationKernels &kernels() { return level().segmentation; }

[[noreturn]] void refuse(const std::string &message) { throw nb::value_error(message.c_str()); }

// The size of a window, by one of its arrays.
Size checked_size(const Buffer &array, const char *name, int first = 0) {
    const Size size{array.size(first), array.size(first + 1)};
    if (size.height < LEAST_SIDE || size.width < LEAST_SIDE)
        refuse(std::string("expected ") + name + " to have at least 3 x 3 pixels, got " + std::to_string(size.height) +
               " x " + std::to_string(size.width));
    // Indices of pixels must fit into 32 bits.
    if (size.height > (Index(1) << 28) / size.width)
        refuse(std::string("expected ") + name + " to have at most 2^28 pixels");
    return size;
}

// (x0, y0, x1, y1) of a part of a window; nothing if x1 < x0 or y1 < y0.
Rectangle checked_part(Handle object, const char *name, Size size) {
    const Array<const std::int64_t, 1> numbers(object, name, {4});
    const std::int64_t *n = numbers.data();
    for (int i = 0; i < 4; ++i)
        if (n[i] < 0 || n[i] > (i % 2 ? size.height : size.width))
            refuse(std::string("expected ") + name + " (x0, y0, x1, y1) to lie in the window, got " +
                   std::to_string(n[0]) + ", " + std::to_string(n[1]) + ", " + std::to_string(n[2]) + ", " +
                   std::to_string(n[3]));
    return {static_cast<Index>(n[0]), static_cast<Index>(n[1]), static_cast<Index>(larger(n[0], n[2])),
            static_cast<Index>(larger(n[1], n[3]))};
}

Index checked_count(Index value, const char *name, Index least, Index most) {
    if (value < least || value > most)
        refuse(std::string("expected ") + name + " between " + std::to_string(least) + " and " + std::to_string(most) +
               ", got " + std::to_string(value));
    return value;
}

constexpr Index MOST_REACH = 1 << 16; // px

Grid checked_grid(const std::array<double, 4> &grid) {
    if (!(grid[2] > 0.0))
        refuse("expected a grid (cx, cy, scale, area) with scale > 0, got " + std::to_string(grid[2]));
    if (!(grid[3] >= 0.0 && grid[3] < 1e12)) refuse("expected an area from 0 to 1e12, got " + std::to_string(grid[3]));
    return {grid[0], grid[1], grid[2], grid[3]};
}

// An optional mask of a window's size.
class OptionalMask {
  public:
    OptionalMask(Handle object, const char *name, Size size) {
        if (!object.is_none()) mask_.emplace(object, name, std::initializer_list<Py_ssize_t>{size.height, size.width});
    }
    const Byte *data() const { return mask_ ? mask_->data() : nullptr; }

  private:
    std::optional<Mask> mask_;
};

// Listed points, see `collect`.
template <class T> class PointList {
  public:
    PointList(Handle object, Index count) : points_(object, "points", {POINT_ROWS, -1}) {
        count_ = checked_count(count, "count", 0, points_.size(1));
    }
    Points points() const { return {const_cast<float *>(points_.data()), points_.size(1), count_}; }

  private:
    Array<T, 2> points_;
    Index count_;
};

Likelihood checked_likelihood(Handle object) {
    const Array<const float, 1> numbers(object, "likelihood", {10});
    const float *n = numbers.data();
    return {n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9]};
}

// ---- shapes ----

Index without(Handle mask, Handle other, Handle out) {
    const Mask first(mask, "mask");
    const Size size = checked_size(first, "mask");
    const Mask second(other, "other", {size.height, size.width});
    const MaskOut result(out, "out", {size.height, size.width});
    Unlocked unlocked;
    return kernels().without(size, first.data(), second.data(), result.data());
}

Index invert(Handle mask, Handle out) {
    const Mask in(mask, "mask");
    const Size size = checked_size(in, "mask");
    const MaskOut result(out, "out", {size.height, size.width});
    Unlocked unlocked;
    return kernels().invert(size, in.data(), result.data());
}

void median(Handle mask, Handle out) {
    const Mask in(mask, "mask");
    const Size size = checked_size(in, "mask");
    const MaskOut result(out, "out", {size.height, size.width});
    Unlocked unlocked;
    const std::unique_ptr<Byte[]> held(new Byte[size.height * size.width]);
    kernels().median(size, in.data(), held.get(), result.data());
}

void spread(Handle allowed, Index times, Handle out) {
    const Mask in(allowed, "allowed");
    const Size size = checked_size(in, "allowed");
    const MaskOut result(out, "out", {size.height, size.width});
    checked_count(times, "times", 0, MOST_REACH);
    Unlocked unlocked;
    const std::unique_ptr<Byte[]> held(new Byte[size.height * size.width]);
    kernels().spread(size, in.data(), times, held.get(), result.data());
}

void widen(Handle mask, Index reach, Handle out) {
    const Mask in(mask, "mask");
    const Size size = checked_size(in, "mask");
    const MaskOut result(out, "out", {size.height, size.width});
    checked_count(reach, "reach", 0, MOST_REACH);
    Unlocked unlocked;
    const std::unique_ptr<Byte[]> held(new Byte[size.height * size.width]);
    kernels().widen(size, in.data(), reach, held.get(), result.data());
}

void widen_cross(Handle mask, Handle out) {
    const Mask in(mask, "mask");
    const Size size = checked_size(in, "mask");
    const MaskOut result(out, "out", {size.height, size.width});
    Unlocked unlocked;
    kernels().widen_cross(size, in.data(), result.data());
}

std::pair<Index, Index> components(Handle mask, Handle other, Handle runs) {
    const Mask in(mask, "mask");
    const Size size = checked_size(in, "mask");
    const Mask second(other, "other", {size.height, size.width});
    const Array<std::int32_t, 2> list(runs, "runs", {size.height * ((size.width + 1) / 2), 6});
    Unlocked unlocked;
    Index heads = 0;
    const Index count =
        kernels().components(size, in.data(), second.data(), reinterpret_cast<Run *>(list.data()), &heads);
    return {count, heads};
}

void bind_shapes(nb::module_ &module) {
    module.def("without", &without, "mask"_a.none(), "other"_a.none(), "out"_a.none());
    module.def("invert", &invert, "mask"_a.none(), "out"_a.none());
    module.def("median", &median, "mask"_a.none(), "out"_a.none());
    module.def("spread", &spread, "allowed"_a.none(), "times"_a, "out"_a.none());
    module.def("widen", &widen, "mask"_a.none(), "reach"_a, "out"_a.none());
    module.def("widen_cross", &widen_cross, "mask"_a.none(), "out"_a.none());
    module.def("components", &components, "mask"_a.none(), "other"_a.none(), "runs"_a.none());
}

// ---- colours ----

void bin_colours(Handle image, Handle bins) {
    const Image in(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "image");
    const Array<std::int16_t, 2> out(bins, "bins", {size.height, size.width});
    Unlocked unlocked;
    kernels().bin_colours(size, in.data(), out.data());
}

double likelihood(Handle colours, Handle ratio) {
    const Plane2 in(colours, "colours", {2, BINS});
    const Array<float, 1> out(ratio, "ratio", {BINS});
    Unlocked unlocked;
    return kernels().likelihood(in.data(), out.data());
}

void blend(Handle colours, Handle tally, double rate, Handle out) {
    const Plane2 before(colours, "colours", {2, BINS});
    const PlaneOut counts(tally, "tally", {2, BINS}), result(out, "out", {2, BINS});
    Unlocked unlocked;
    kernels().blend(before.data(), counts.data(), rate, result.data());
}

void bind_colours(nb::module_ &module) {
    module.def("bin_colours", &bin_colours, "image"_a.none(), "bins"_a.none());
    module.def("likelihood", &likelihood, "colours"_a.none(), "ratio"_a.none());
    module.def("blend", &blend, "colours"_a.none(), "tally"_a.none(), "rate"_a, "out"_a.none());
}

// ---- windows ----

void smooth(Handle pixels, Handle taps, Handle image, Handle gray) {
    const Image in(pixels, "pixels");
    const PlaneOut mean(gray, "gray");
    const Size size = checked_size(mean, "gray");
    const ImageOut out(image, "image", {size.height, size.width, CHANNELS});
    const Index channels = in.size(2) == 1 ? 1 : CHANNELS;
    in.expect({size.height + 4, size.width + 4, channels});
    const Array<const float, 1> weights(taps, "taps", {3});
    Unlocked unlocked;
    kernels().smooth(size, channels, in.data(), weights.data(), out.data(), mean.data());
}

Index checked_shift(Index value, const char *name) { return checked_count(value, name, -(1 << 28), 1 << 28); }

void shift(Handle source, Index dx, Index dy, float fill, Handle out) {
    const Plane2 in(source, "source");
    const PlaneOut result(out, "out");
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    const Size from{in.size(0), in.size(1)}, to{result.size(0), result.size(1)};
    Unlocked unlocked;
    kernels().shift(from, in.data(), dx, dy, fill, to, result.data());
}

void move_object(Index dx, Index dy, Handle odds, Handle shape, Handle object, Handle odds_out, Handle shape_out,
                 Handle object_out) {
    const Plane2 own(odds, "odds"), slow(shape, "shape", {own.size(0), own.size(1)});
    const Image layer(object, "obj", {own.size(0), own.size(1), CHANNELS});
    const PlaneOut to(odds_out, "odds_out"), slow_out(shape_out, "shape_out", {to.size(0), to.size(1)});
    const ImageOut layer_out(object_out, "obj_out", {to.size(0), to.size(1), CHANNELS});
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    const Size from{own.size(0), own.size(1)}, size{to.size(0), to.size(1)};
    Unlocked unlocked;
    kernels().shift(from, own.data(), dx, dy, -3.0f, size, to.data());
    kernels().shift(from, slow.data(), dx, dy, 0.0f, size, slow_out.data());
    kernels().shift({from.height, CHANNELS * from.width}, layer.data(), CHANNELS * dx, dy, 0.0f,
                    {size.height, CHANNELS * size.width}, layer_out.data());
}

void move_ground(Index dx, Index dy, float gain, Handle picture, Handle counts, Handle image, Handle odds,
                 Handle picture_out, Handle counts_out) {
    const Image before(picture, "picture", {-1, -1, CHANNELS});
    const Image counted(counts, "counts", {3, before.size(0), before.size(1)});
    const Plane2 object(odds, "odds");
    const Size from{before.size(0), before.size(1)}, to{object.size(0), object.size(1)};
    const Image now(image, "image", {to.height, to.width, CHANNELS});
    const ImageOut after(picture_out, "picture_out", {to.height, to.width, CHANNELS});
    const ImageOut counted_out(counts_out, "counts_out", {3, to.height, to.width});
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    Unlocked unlocked;
    kernels().move_ground(from, {before.data(), counted.data()}, dx, dy, gain, to, now.data(), object.data(),
                          after.data(), counted_out.data());
}

void resample(Handle image, Handle inverse, bool repeat, float fill, Handle out) {
    const Image in(image, "image");
    const Size from = checked_size(in, "image");
    const Numbers matrix(inverse, "inverse", {6});
    const ImageOut result(out, "out", {-1, -1, in.size(2)});
    const Size to{result.size(0), result.size(1)};
    Unlocked unlocked;
    kernels().resample(from, in.size(2), in.data(), matrix.data(), repeat, fill, to, result.data());
}

void bind_windows(nb::module_ &module) {
    module.def("smooth", &smooth, "pixels"_a.none(), "taps"_a.none(), "image"_a.none(), "gray"_a.none());
    module.def("shift", &shift, "source"_a.none(), "dx"_a, "dy"_a, "fill"_a, "out"_a.none());
    module.def("move_object", &move_object, "dx"_a, "dy"_a, "odds"_a.none(), "shape"_a.none(), "obj"_a.none(),
               "odds_out"_a.none(), "shape_out"_a.none(), "obj_out"_a.none());
    module.def("move_ground", &move_ground, "dx"_a, "dy"_a, "gain"_a, "picture"_a.none(), "counts"_a.none(),
               "image"_a.none(), "odds"_a.none(), "picture_out"_a.none(), "counts_out"_a.none());
    module.def("resample", &resample, "image"_a.none(), "inverse"_a.none(), "repeat"_a, "fill"_a, "out"_a.none());
}

// ---- evidence ----

// What is known of the object, and where it goes.
class Warp {
  public:
    Warp(Size size, Handle previous, Handle object, Handle odds, Handle shape, Handle inverse)
        : previous_(previous, "previous", {size.height, size.width, CHANNELS}),
          object_(object, "obj", {size.height, size.width, CHANNELS}), odds_(odds, "odds", {size.height, size.width}),
          shape_(shape, "shape", {size.height, size.width}), inverse_(inverse, "inverse", {6}) {}
    Object object() const { return {previous_.data(), object_.data(), odds_.data(), shape_.data()}; }
    const double *inverse() const { return inverse_.data(); }

  private:
    Image previous_, object_;
    Plane2 odds_, shape_;
    Numbers inverse_;
};

class Warped {
  public:
    Warped(Size size, Handle previous, Handle object, Handle odds, Handle shape, Handle own)
        : previous_(previous, "previous_out", {size.height, size.width, CHANNELS}),
          object_(object, "obj_out", {size.height, size.width, CHANNELS}),
          odds_(odds, "odds_out", {size.height, size.width}), shape_(shape, "shape_out", {size.height, size.width}),
          own_(own, "own_out", {size.height, size.width}) {}
    MovedObject object() const { return {previous_.data(), object_.data(), odds_.data(), shape_.data(), own_.data()}; }

  private:
    ImageOut previous_, object_;
    PlaneOut odds_, shape_;
    MaskOut own_;
};

// This frame and the background that explains it.
class Scene {
  public:
    Scene(Handle image, Handle background, Handle moved, Handle counts)
        : image_(image, "image", {-1, -1, CHANNELS}), size_(checked_size(image_, "image")),
          background_(background, "background", {size_.height, size_.width, CHANNELS}),
          moved_(moved, "moved", {size_.height, size_.width, CHANNELS}),
          counts_(counts, "counts", {3, size_.height, size_.width}) {}
    Size size() const { return size_; }
    const float *counts() const { return counts_.data(); }
    Explanations with(const float *carried, const float *object, const float *odds) const {
        return {image_.data(), background_.data(), moved_.data(), carried, object, odds, counts_.data()};
    }

  private:
    Image image_;
    Size size_;
    Image background_, moved_, counts_;
};

void carry(Handle previous, Handle object, Handle odds, Handle shape, Handle counts, Handle inverse, Handle part,
           bool everywhere, Handle previous_out, Handle object_out, Handle odds_out, Handle shape_out, Handle own_out) {
    const Image counted(counts, "counts", {3, -1, -1});
    const Size size = checked_size(counted, "counts", 1);
    const Warp from(size, previous, object, odds, shape, inverse);
    const Warped to(size, previous_out, object_out, odds_out, shape_out, own_out);
    const Rectangle where = checked_part(part, "part", size);
    Unlocked unlocked;
    kernels().carry(size, from.object(), counted.data(), from.inverse(), where, everywhere, to.object());
}

double evidence(Handle image, Handle background, Handle moved, Handle carried, Handle object, Handle odds,
                Handle counts, Handle part, Handle inside, Handle likelihood, Handle out, Handle fresh) {
    const Scene scene(image, background, moved, counts);
    const Size size = scene.size();
    const Image last(carried, "carried", {size.height, size.width, CHANNELS});
    const Image layer(object, "obj", {size.height, size.width, CHANNELS});
    const Plane2 own(odds, "odds", {size.height, size.width});
    const ImageOut planes(out, "out", {EVIDENCE_PLANES, size.height, size.width});
    const MaskOut changed(fresh, "fresh", {size.height, size.width});
    const Rectangle where = checked_part(part, "part", size), frame = checked_part(inside, "inside", size);
    const Likelihood how = checked_likelihood(likelihood);
    Unlocked unlocked;
    return kernels().evidence(size, scene.with(last.data(), layer.data(), own.data()), where, frame, how,
                              {planes.data(), changed.data()});
}

double warp_and_score(Handle previous, Handle object, Handle odds, Handle shape, Handle inverse, bool everywhere,
                      Handle image, Handle background, Handle moved, Handle counts, Handle part, Handle inside,
                      Handle likelihood, Handle previous_out, Handle object_out, Handle odds_out, Handle shape_out,
                      Handle own_out, Handle out, Handle fresh) {
    const Scene scene(image, background, moved, counts);
    const Size size = scene.size();
    const Warp from(size, previous, object, odds, shape, inverse);
    const Warped to(size, previous_out, object_out, odds_out, shape_out, own_out);
    const ImageOut planes(out, "out", {EVIDENCE_PLANES, size.height, size.width});
    const MaskOut changed(fresh, "fresh", {size.height, size.width});
    const Rectangle where = checked_part(part, "part", size), frame = checked_part(inside, "inside", size);
    const Likelihood how = checked_likelihood(likelihood);
    const MovedObject result = to.object();
    Unlocked unlocked;
    kernels().carry(size, from.object(), scene.counts(), from.inverse(), where, everywhere, result);
    return kernels().evidence(size, scene.with(result.previous, result.image, result.odds), where, frame, how,
                              {planes.data(), changed.data()});
}

void bind_evidence(nb::module_ &module) {
    module.def("carry", &carry, "previous"_a.none(), "obj"_a.none(), "odds"_a.none(), "shape"_a.none(),
               "counts"_a.none(), "inverse"_a.none(), "part"_a.none(), "everywhere"_a, "previous_out"_a.none(),
               "obj_out"_a.none(), "odds_out"_a.none(), "shape_out"_a.none(), "own_out"_a.none());
    module.def("evidence", &evidence, "image"_a.none(), "background"_a.none(), "moved"_a.none(), "carried"_a.none(),
               "obj"_a.none(), "odds"_a.none(), "counts"_a.none(), "part"_a.none(), "inside"_a.none(),
               "likelihood"_a.none(), "out"_a.none(), "fresh"_a.none());
    module.def("warp_and_score", &warp_and_score, "previous"_a.none(), "obj"_a.none(), "odds"_a.none(),
               "shape"_a.none(), "inverse"_a.none(), "everywhere"_a, "image"_a.none(), "background"_a.none(),
               "moved"_a.none(), "counts"_a.none(), "part"_a.none(), "inside"_a.none(), "likelihood"_a.none(),
               "previous_out"_a.none(), "obj_out"_a.none(), "odds_out"_a.none(), "shape_out"_a.none(),
               "own_out"_a.none(), "out"_a.none(), "fresh"_a.none());
}

// ---- motion ----

Index collect(Handle reference, Handle weight, const std::array<double, 4> &grid, Index stride, Handle points) {
    const Image in(reference, "reference", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "reference");
    const Plane2 weights(weight, "weight", {size.height, size.width});
    const PointList<float> list(points, 0);
    const Grid where = checked_grid(grid);
    checked_count(stride, "stride", 1, 1 << 28);
    Points found = list.points();
    Unlocked unlocked;
    kernels().collect(size, in.data(), weights.data(), where, stride, &found);
    return found.count;
}

double residual(Handle image, Handle points, Index count, Handle theta, double ceiling, Handle inside) {
    const Image in(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "image");
    const PointList<const float> list(points, count);
    const Numbers motion(theta, "theta", {THETA});
    const Rectangle frame = checked_part(inside, "inside", size);
    Unlocked unlocked;
    return kernels().residual(size, in.data(), list.points(), motion.data(), ceiling, frame);
}

void gauss_newton(Handle image, Handle points, Index count, Handle theta, Handle prior, double scale, double ceiling,
                  Handle inside, Handle costs, Index steps, double stiffness) {
    const Image in(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "image");
    const PointList<const float> list(points, count);
    const NumbersOut motion(theta, "theta", {THETA}), cost(costs, "costs", {2});
    const Numbers ridge(prior, "prior", {THETA});
    const Rectangle frame = checked_part(inside, "inside", size);
    checked_count(steps, "steps", 0, 1000);
    Unlocked unlocked;
    kernels().gauss_newton(size, in.data(), list.points(), {ridge.data(), scale, ceiling, stiffness, steps}, frame,
                           motion.data(), cost.data());
}

void start_flow(Handle near, const std::array<double, 4> &grid, Handle theta, const Pair2 &camera, Handle out) {
    const Mask mask(near, "near");
    const Size size{mask.size(0), mask.size(1)};
    const Numbers motion(theta, "theta", {THETA});
    const ImageOut flow(out, "out", {size.height, size.width, 2});
    const Grid where = checked_grid(grid);
    Unlocked unlocked;
    kernels().start_flow(size, mask.data(), where, motion.data(), camera.data(), flow.data());
}

Weighing checked_weighing(int value, const Byte *shown) {
    checked_count(value, "weighing", 0, 2);
    const auto weighing = static_cast<Weighing>(value);
    if (weighing != Weighing::evenly && !shown) refuse("expected shown to be a mask, got None");
    return weighing;
}

using GridNumbers = std::tuple<double, double, double, double>;
using Corners = std::tuple<Index, Index, Index, Index>;

std::tuple<Index, double, double, GridNumbers, Corners>
predict_motion(Handle odds, Handle shown, int weighing, const std::array<double, 4> &box, Handle object, Handle image,
               Handle inside, const std::array<double, 6> &motion, const Pair2 &camera, bool known, Handle near,
               Handle weight, Handle points, Handle theta, Handle flow) {
    const Plane2 own(odds, "odds");
    const Size size = checked_size(own, "odds");
    const OptionalMask visible(shown, "shown", size);
    const Image layer(object, "obj", {size.height, size.width, CHANNELS});
    const Image now(image, "image", {size.height, size.width, CHANNELS});
    const MaskOut mask(near, "near", {size.height, size.width});
    const PlaneOut weights(weight, "weight", {size.height, size.width});
    const PointList<float> list(points, 0);
    const NumbersOut expected(theta, "theta", {THETA});
    const ImageOut start(flow, "flow", {size.height, size.width, 2});
    const Prediction what{own.data(),    visible.data(), checked_weighing(weighing, visible.data()), checked_grid(box),
                          layer.data(),  now.data(),     checked_part(inside, "inside", size),       motion.data(),
                          camera.data(), known};
    Predicted out{mask.data(), weights.data(), list.points(), expected.data(), start.data(), {}, {}, 0.0, 0.0};
    {
        Unlocked unlocked;
        kernels().predict(size, what, &out);
    }
    const Grid &g = out.grid;
    const Rectangle &e = out.extent;
    return {out.points.count, out.cost, out.visible, GridNumbers{g.cx, g.cy, g.scale, g.area},
            Corners{e.left, e.top, e.right, e.bottom}};
}

void measure_motion(Handle flow, Handle image, Handle previous, Handle inside, Handle near, const Pair2 &camera,
                    double noise, Handle background, Handle counts, const Pair2 &offset, Index ground_steps,
                    Handle odds, Handle weight, const std::array<double, 4> &grid, Handle points, Index count,
                    Handle predicted, bool hidden, bool young, Index steps, Handle ground, Handle theta) {
    const Image now(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(now, "image");
    const Image displacement(flow, "flow", {size.height, size.width, 2});
    const Plane2 last(previous, "previous", {size.height, size.width});
    const Mask mask(near, "near", {size.height, size.width});
    const Image layer(background, "background", {size.height, size.width, CHANNELS});
    const Image counted(counts, "counts", {3, size.height, size.width});
    const Plane2 own(odds, "odds", {size.height, size.width}), weights(weight, "weight", {size.height, size.width});
    const PointList<const float> list(points, count);
    const Numbers expected(predicted, "predicted", {THETA});
    const NumbersOut moved(ground, "ground", {THETA}), found(theta, "theta", {THETA});
    checked_count(ground_steps, "ground_steps", 0, 1000);
    checked_count(steps, "steps", 0, 1000);
    const Measurement what{displacement.data(),
                           now.data(),
                           last.data(),
                           checked_part(inside, "inside", size),
                           mask.data(),
                           camera.data(),
                           noise,
                           {layer.data(), counted.data()},
                           offset.data(),
                           ground_steps,
                           steps,
                           own.data(),
                           weights.data(),
                           checked_grid(grid),
                           list.points(),
                           expected.data(),
                           hidden,
                           young};
    Unlocked unlocked;
    kernels().measure(size, what, moved.data(), found.data());
}

std::tuple<double, double, Index, Index> search_shift(Handle image, Handle object, Handle shape, Handle different,
                                                      const std::array<Index, 2> &centre, Index reach, Index step,
                                                      Handle inside, double noise) {
    const Image now(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(now, "image");
    const Image layer(object, "obj", {size.height, size.width, CHANNELS});
    const Plane2 own(shape, "shape", {size.height, size.width});
    const Mask changed(different, "different", {size.height, size.width});
    const Rectangle frame = checked_part(inside, "inside", size);
    for (const Index one : centre) checked_shift(one, "centre");
    checked_count(reach, "reach", 0, MOST_REACH);
    checked_count(step, "step", 1, MOST_REACH);
    Unlocked unlocked;
    const Found found = kernels().search_shift(size, now.data(), layer.data(), own.data(), changed.data(),
                                               centre.data(), reach, step, frame, noise);
    return {found.score, found.still, found.dx, found.dy};
}

void bind_motion(nb::module_ &module) {
    module.def("collect", &collect, "reference"_a.none(), "weight"_a.none(), "grid"_a, "stride"_a, "points"_a.none());
    module.def("residual", &residual, "image"_a.none(), "points"_a.none(), "count"_a, "theta"_a.none(), "ceiling"_a,
               "inside"_a.none());
    module.def("gauss_newton", &gauss_newton, "image"_a.none(), "points"_a.none(), "count"_a, "theta"_a.none(),
               "prior"_a.none(), "scale"_a, "ceiling"_a, "inside"_a.none(), "costs"_a.none(), "steps"_a, "stiffness"_a);
    module.def("start_flow", &start_flow, "near"_a.none(), "grid"_a, "theta"_a.none(), "camera"_a, "out"_a.none());
    module.def("predict_motion", &predict_motion, "odds"_a.none(), "shown"_a.none(), "weighing"_a, "box"_a,
               "obj"_a.none(), "image"_a.none(), "inside"_a.none(), "motion"_a, "camera"_a, "known"_a, "near"_a.none(),
               "weight"_a.none(), "points"_a.none(), "theta"_a.none(), "flow"_a.none());
    module.def("measure_motion", &measure_motion, "flow"_a.none(), "image"_a.none(), "previous"_a.none(),
               "inside"_a.none(), "near"_a.none(), "camera"_a, "noise"_a, "background"_a.none(), "counts"_a.none(),
               "offset"_a, "ground_steps"_a, "odds"_a.none(), "weight"_a.none(), "grid"_a, "points"_a.none(), "count"_a,
               "predicted"_a.none(), "hidden"_a, "young"_a, "steps"_a, "ground"_a.none(), "theta"_a.none());
    module.def("search_shift", &search_shift, "image"_a.none(), "obj"_a.none(), "shape"_a.none(), "different"_a.none(),
               "centre"_a, "reach"_a, "step"_a, "inside"_a.none(), "noise"_a);
}

// ---- labels and memory ----

std::tuple<Index, Index, Index, Index, double, double, double, double>
label(Handle image, Handle background, Handle counts, Handle odds, Handle own, Handle shape, Handle evidence,
      Handle fresh, Handle before, Handle hiding, bool emerging, Handle colours, double colour_weight, double noise,
      Index growth, bool young, double least, Handle inside, Handle bins, Handle raw, Handle odds_out, Handle mask,
      Handle foreign) {
    const Image now(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(now, "image");
    const Image layer(background, "background", {size.height, size.width, CHANNELS});
    const Image counted(counts, "counts", {3, size.height, size.width});
    const Plane2 expected(odds, "odds", {size.height, size.width}), slow(shape, "shape", {size.height, size.width});
    const Mask object(own, "own", {size.height, size.width}), changed(fresh, "fresh", {size.height, size.width});
    const ImageOut planes(evidence, "evidence", {EVIDENCE_PLANES, size.height, size.width});
    const OptionalMask last(before, "before", size), front(hiding, "hiding", size);
    const Plane2 histograms(colours, "colours", {2, BINS});
    const Array<std::int16_t, 2> bin(bins, "bins", {size.height, size.width});
    const PlaneOut plain(raw, "raw", {size.height, size.width}),
        result(odds_out, "odds_out", {size.height, size.width});
    const MaskOut labelled(mask, "mask", {size.height, size.width}),
        other(foreign, "foreign", {size.height, size.width});
    checked_count(growth, "growth", 0, MOST_REACH);
    const Labelling what{now.data(),
                         {layer.data(), counted.data()},
                         expected.data(),
                         slow.data(),
                         object.data(),
                         planes.data(),
                         changed.data(),
                         last.data(),
                         front.data(),
                         histograms.data(),
                         colour_weight,
                         noise,
                         least,
                         growth,
                         emerging,
                         young,
                         checked_part(inside, "inside", size)};
    Unlocked unlocked;
    const VisiblePart visible =
        kernels().label(size, what, {bin.data(), plain.data(), result.data(), labelled.data(), other.data()});
    return {visible.foreign, visible.expected, visible.both,  visible.seen,
            visible.left,    visible.top,      visible.right, visible.bottom};
}

std::tuple<Index, Index, double> learn(Handle image, Handle aligned, Handle mask, Handle own, Handle foreign,
                                       Handle odds, Handle raw, Handle warped, Handle object, Handle shape,
                                       Handle evidence, Handle bins, Handle background, Handle counts, Handle part,
                                       Handle inside, float shape_rate, bool freeze, bool hidden, Handle colours,
                                       double colour_rate, Handle odds_out, Handle object_out, Handle shape_out,
                                       Handle background_out, Handle counts_out, Handle colours_out) {
    const Image now(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(now, "image");
    const std::initializer_list<Py_ssize_t> sizes{size.height, size.width};
    const std::initializer_list<Py_ssize_t> picture{size.height, size.width, CHANNELS};
    const Image lattice(aligned, "aligned", picture), layer(object, "obj", picture);
    const Image ground(background, "background", picture), counted(counts, "counts", {3, size.height, size.width});
    const Image planes(evidence, "evidence", {EVIDENCE_PLANES, size.height, size.width});
    const Mask labelled(mask, "mask", sizes), expected(own, "own", sizes);
    const OptionalMask other(foreign, "foreign", size);
    const Plane2 belief(odds, "odds", sizes), plain(raw, "raw", sizes), before(warped, "warped", sizes);
    const Plane2 slow(shape, "shape", sizes), histograms(colours, "colours", {2, BINS});
    const Array<const std::int16_t, 2> bin(bins, "bins", sizes);
    const PlaneOut belief_out(odds_out, "odds_out", sizes), slow_out(shape_out, "shape_out", sizes);
    const PlaneOut histograms_out(colours_out, "colours_out", {2, BINS});
    const ImageOut layer_out(object_out, "obj_out", picture), ground_out(background_out, "background_out", picture);
    const ImageOut counted_out(counts_out, "counts_out", {3, size.height, size.width});
    const Lesson what{now.data(),
                      lattice.data(),
                      labelled.data(),
                      expected.data(),
                      other.data(),
                      belief.data(),
                      plain.data(),
                      {nullptr, layer.data(), before.data(), slow.data()},
                      planes.data(),
                      bin.data(),
                      {ground.data(), counted.data()},
                      histograms.data(),
                      checked_part(part, "part", size),
                      checked_part(inside, "inside", size),
                      shape_rate,
                      colour_rate,
                      freeze,
                      hidden};
    Unlocked unlocked;
    const Fit fit = kernels().learn(size, what,
                                    {belief_out.data(), layer_out.data(), slow_out.data(), ground_out.data(),
                                     counted_out.data(), histograms_out.data()});
    return {fit.known, fit.strange, fit.spread};
}

void bind_labels(nb::module_ &module) {
    module.def("label", &label, "image"_a.none(), "background"_a.none(), "counts"_a.none(), "odds"_a.none(),
               "own"_a.none(), "shape"_a.none(), "evidence"_a.none(), "fresh"_a.none(), "before"_a.none(),
               "hiding"_a.none(), "emerging"_a, "colours"_a.none(), "colour_weight"_a, "noise"_a, "growth"_a, "young"_a,
               "least"_a, "inside"_a.none(), "bins"_a.none(), "raw"_a.none(), "odds_out"_a.none(), "mask"_a.none(),
               "foreign"_a.none());
    module.def("learn", &learn, "image"_a.none(), "aligned"_a.none(), "mask"_a.none(), "own"_a.none(),
               "foreign"_a.none(), "odds"_a.none(), "raw"_a.none(), "warped"_a.none(), "obj"_a.none(), "shape"_a.none(),
               "evidence"_a.none(), "bins"_a.none(), "background"_a.none(), "counts"_a.none(), "part"_a.none(),
               "inside"_a.none(), "shape_rate"_a, "freeze"_a, "hidden"_a, "colours"_a.none(), "colour_rate"_a,
               "odds_out"_a.none(), "obj_out"_a.none(), "shape_out"_a.none(), "background_out"_a.none(),
               "counts_out"_a.none(), "colours_out"_a.none());
}

} // namespace

void bind_segmentation(nb::module_ &module) {
    nb::module_ segmentation = module.def_submodule("segmentation");
    segmentation.attr("KNOWN") = KNOWN;
    segmentation.attr("FAR_OFF") = FAR_OFF;
    segmentation.attr("BINS") = BINS;
    segmentation.attr("POINT_ROWS") = POINT_ROWS;
    bind_shapes(segmentation);
    bind_colours(segmentation);
    bind_windows(segmentation);
    bind_evidence(segmentation);
    bind_motion(segmentation);
    bind_labels(segmentation);
}

} // namespace hs
