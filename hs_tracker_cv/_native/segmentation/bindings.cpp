#include "bindings.hpp"

#include "light.hpp"
#include "structs.hpp"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <memory>
#include <tuple>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

using Unlocked = nb::gil_scoped_release;

const SegmentationKernels &kernels() { return level().segmentation; }

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

void move_object(Index dx, Index dy, const BoundLayer &layer, const BoundLayer &out) {
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    const Size from = layer.size(), size = out.size();
    const Object object = layer.object(nullptr);
    float *odds = out.odds_out(), *shape = out.shape_out(), *image = out.image_out();
    Unlocked unlocked;
    kernels().shift(from, object.odds, dx, dy, -3.0f, size, odds);
    kernels().shift(from, object.shape, dx, dy, 0.0f, size, shape);
    kernels().shift({from.height, CHANNELS * from.width}, object.image, CHANNELS * dx, dy, 0.0f,
                    {size.height, CHANNELS * size.width}, image);
}

void move_ground(Index dx, Index dy, float gain, const BoundGround &ground, Handle image, Handle odds,
                 const BoundGround &out) {
    const Size to = out.size();
    const Plane2 object(odds, "odds", {to.height, to.width});
    const Image now(image, "image", {to.height, to.width, CHANNELS});
    float *picture = out.image_out(), *counts = out.counts_out();
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    Unlocked unlocked;
    kernels().move_ground(ground.size(), ground.ground(), dx, dy, gain, to, now.data(), object.data(), picture, counts);
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

void without_object(Handle image, Handle odds, Index dx, Index dy, float sure, float fill, Handle out) {
    const Image in(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "image");
    const Plane2 object(odds, "odds", {size.height, size.width});
    const ImageOut result(out, "out", {size.height, size.width, CHANNELS});
    checked_shift(dx, "dx");
    checked_shift(dy, "dy");
    Unlocked unlocked;
    kernels().without_object(size, in.data(), object.data(), dx, dy, sure, fill, result.data());
}

std::pair<Index, std::array<float, CHANNELS>> light_ratio(Handle image, Handle previous,
                                                          const std::array<Index, 4> &box, Index stride,
                                                          const std::array<float, 3> &limits) {
    const Image now(image, "image", {-1, -1, CHANNELS});
    const Size size = checked_size(now, "image");
    const Image before(previous, "previous", {size.height, size.width, CHANNELS});
    checked_count(stride, "stride", 1, MOST_REACH);
    const auto [left, top, right, bottom] = box;
    Unlocked unlocked;
    const Light light = measure_light(size, now.data(), before.data(), {left, top, right, bottom}, stride,
                                      {limits[0], limits[1], limits[2]});
    return {light.pixels, light.ratio};
}

void bind_windows(nb::module_ &module) {
    module.def("smooth", &smooth, "pixels"_a.none(), "taps"_a.none(), "image"_a.none(), "gray"_a.none());
    module.def("shift", &shift, "source"_a.none(), "dx"_a, "dy"_a, "fill"_a, "out"_a.none());
    module.def("move_object", &move_object, "dx"_a, "dy"_a, "layer"_a, "out"_a);
    module.def("move_ground", &move_ground, "dx"_a, "dy"_a, "gain"_a, "ground"_a, "image"_a.none(), "odds"_a.none(),
               "out"_a);
    module.def("resample", &resample, "image"_a.none(), "inverse"_a.none(), "repeat"_a, "fill"_a, "out"_a.none());
    module.def("without_object", &without_object, "image"_a.none(), "odds"_a.none(), "dx"_a, "dy"_a, "sure"_a, "fill"_a,
               "out"_a.none());
    module.def("measure_light", &light_ratio, "image"_a.none(), "previous"_a.none(), "box"_a, "stride"_a, "limits"_a);
}

// ---- evidence ----

void carry(Handle previous, const BoundLayer &layer, Handle counts, Handle inverse, bool everywhere,
           const BoundExpected &expected) {
    const Size size = checked_size(layer.size(), "obj");
    const Image last(previous, "previous", {size.height, size.width, CHANNELS});
    const Image counted(counts, "counts", {3, size.height, size.width});
    const Numbers matrix(inverse, "inverse", {6});
    expect_size(expected.size(), size, "expected");
    const MovedObject out = expected.out();
    Unlocked unlocked;
    kernels().carry(size, layer.object(last.data()), counted.data(), matrix.data(), expected.part(), everywhere, out);
}

double evidence(const BoundScene &scene, const BoundExpected &expected, const Likelihood &likelihood,
                const BoundEvidence &out) {
    const Size size = scene.size();
    expect_size(expected.size(), size, "expected");
    expect_size(out.size(), size, "out");
    const Object object = expected.object();
    const Evidence seen = out.out();
    Unlocked unlocked;
    return kernels().evidence(size, scene.with(object.previous, object.image, object.odds), expected.part(),
                              scene.inside(), likelihood, seen);
}

double warp_and_score(const BoundScene &scene, Handle previous, const BoundLayer &layer, Handle inverse,
                      bool everywhere, const Likelihood &likelihood, const BoundExpected &expected,
                      const BoundEvidence &out) {
    const Size size = scene.size();
    const Image last(previous, "previous", {size.height, size.width, CHANNELS});
    const Numbers matrix(inverse, "inverse", {6});
    expect_size(layer.size(), size, "obj");
    expect_size(expected.size(), size, "expected");
    expect_size(out.size(), size, "out");
    const MovedObject moved = expected.out();
    const Evidence seen = out.out();
    Unlocked unlocked;
    kernels().carry(size, layer.object(last.data()), scene.ground().counts, matrix.data(), expected.part(), everywhere,
                    moved);
    return kernels().evidence(size, scene.with(moved.previous, moved.image, moved.odds), expected.part(),
                              scene.inside(), likelihood, seen);
}

void bind_evidence(nb::module_ &module) {
    module.def("carry", &carry, "previous"_a.none(), "layer"_a, "counts"_a.none(), "inverse"_a.none(), "everywhere"_a,
               "expected"_a);
    module.def("evidence", &evidence, "scene"_a, "expected"_a, "likelihood"_a, "out"_a);
    module.def("warp_and_score", &warp_and_score, "scene"_a, "previous"_a.none(), "layer"_a, "inverse"_a.none(),
               "everywhere"_a, "likelihood"_a, "expected"_a, "out"_a);
}

// ---- motion ----

void collect(Handle reference, Handle weight, const GridNumbers &grid, Index stride, BoundPoints &points) {
    const Image in(reference, "reference", {-1, -1, CHANNELS});
    const Size size = checked_size(in, "reference");
    const Plane2 weights(weight, "weight", {size.height, size.width});
    const Grid where = checked_grid(grid);
    checked_count(stride, "stride", 1, 1 << 28);
    Points found = points.empty();
    {
        Unlocked unlocked;
        kernels().collect(size, in.data(), weights.data(), where, stride, &found);
    }
    points.use(found.count);
}

double residual(const BoundWindow &window, const BoundPoints &points, Handle theta, double ceiling) {
    const Numbers motion(theta, "theta", {THETA});
    Unlocked unlocked;
    return kernels().residual(window.size(), window.image(), points.points(), motion.data(), ceiling, window.inside());
}

void gauss_newton(const BoundWindow &window, const BoundPoints &points, const BoundRegistration &how, Handle theta,
                  Handle costs) {
    const NumbersOut motion(theta, "theta", {THETA}), cost(costs, "costs", {2});
    Unlocked unlocked;
    kernels().gauss_newton(window.size(), window.image(), points.points(), how.view(), window.inside(), motion.data(),
                           cost.data());
}

void start_flow(Handle near, const GridNumbers &grid, Handle theta, const Pair2 &camera, Handle out) {
    const Mask mask(near, "near");
    const Size size{mask.size(0), mask.size(1)};
    const Numbers motion(theta, "theta", {THETA});
    const ImageOut flow(out, "out", {size.height, size.width, 2});
    const Grid where = checked_grid(grid);
    Unlocked unlocked;
    kernels().start_flow(size, mask.data(), where, motion.data(), camera.data(), flow.data());
}

using Corners = std::tuple<Index, Index, Index, Index>;
using FourNumbers = std::tuple<double, double, double, double>;

std::tuple<double, double, FourNumbers, Corners> predict_motion(const BoundWindow &window, Handle object,
                                                                const BoundOutline &outline, const LastMotion &last,
                                                                BoundPoints &points, const BoundPrediction &out) {
    const Size size = window.size();
    const Image layer(object, "obj", {size.height, size.width, CHANNELS});
    expect_size(outline.size(), size, "odds");
    expect_size(out.size(), size, "near");
    const Prediction what{outline.odds(), outline.shown(), outline.weighing(), outline.box(),      layer.data(),
                          window.image(), window.inside(), last.object.data(), last.camera.data(), last.known};
    Predicted found = out.out(points.empty());
    {
        Unlocked unlocked;
        kernels().predict(size, what, &found);
    }
    points.use(found.points.count);
    const Grid &g = found.grid;
    const Rectangle &e = found.extent;
    return {found.cost, found.visible, FourNumbers{g.cx, g.cy, g.scale, g.area},
            Corners{e.left, e.top, e.right, e.bottom}};
}

using Theta = std::array<double, THETA>;

std::pair<Theta, Theta> measure_motion(const BoundWindow &window, Handle previous, Handle flow, Handle odds,
                                       const BoundGround &ground, const BoundPrediction &predicted,
                                       const BoundPoints *points, const Measuring &how) {
    const Size size = window.size();
    const Image displacement(flow, "flow", {size.height, size.width, 2});
    const Plane2 last(previous, "previous", {size.height, size.width});
    const Plane2 own(odds, "odds", {size.height, size.width});
    expect_size(ground.size(), size, "background");
    expect_size(predicted.size(), size, "near");
    const Measurement what{displacement.data(), window.image(),   last.data(),
                           window.inside(),     predicted.near(), how.camera.data(),
                           how.noise,           ground.ground(),  how.offset.data(),
                           how.ground_steps,    how.steps,        own.data(),
                           predicted.weight(),  how.grid,         points ? points->points() : Points{nullptr, 0, 0},
                           predicted.theta(),   how.hidden,       how.young};
    std::pair<Theta, Theta> found{};
    Unlocked unlocked;
    kernels().measure(size, what, found.first.data(), found.second.data());
    return found;
}

std::tuple<double, double, Index, Index> search_shift(const BoundWindow &window, Handle object, Handle shape,
                                                      Handle different, const std::array<Index, 2> &centre, Index reach,
                                                      Index step, double noise) {
    const Size size = window.size();
    const Image layer(object, "obj", {size.height, size.width, CHANNELS});
    const Plane2 own(shape, "shape", {size.height, size.width});
    const Mask changed(different, "different", {size.height, size.width});
    for (const Index one : centre) checked_shift(one, "centre");
    checked_count(reach, "reach", 0, MOST_REACH);
    checked_count(step, "step", 1, MOST_REACH);
    Unlocked unlocked;
    const Found found = kernels().search_shift(size, window.image(), layer.data(), own.data(), changed.data(),
                                               centre.data(), reach, step, window.inside(), noise);
    return {found.score, found.still, found.dx, found.dy};
}

void bind_motion(nb::module_ &module) {
    module.def("collect", &collect, "reference"_a.none(), "weight"_a.none(), "grid"_a, "stride"_a, "points"_a);
    module.def("residual", &residual, "window"_a, "points"_a, "theta"_a.none(), "ceiling"_a);
    module.def("gauss_newton", &gauss_newton, "window"_a, "points"_a, "how"_a, "theta"_a.none(), "costs"_a.none());
    module.def("start_flow", &start_flow, "near"_a.none(), "grid"_a, "theta"_a.none(), "camera"_a, "out"_a.none());
    module.def("predict_motion", &predict_motion, "window"_a, "obj"_a.none(), "outline"_a, "last"_a, "points"_a,
               "out"_a);
    module.def("measure_motion", &measure_motion, "window"_a, "previous"_a.none(), "flow"_a.none(), "odds"_a.none(),
               "ground"_a, "predicted"_a, "points"_a.none(), "how"_a);
    module.def("search_shift", &search_shift, "window"_a, "obj"_a.none(), "shape"_a.none(), "different"_a.none(),
               "centre"_a, "reach"_a, "step"_a, "noise"_a);
}

// ---- labels and memory ----

std::tuple<Index, Index, Index, Index, FourNumbers> label(const BoundScene &scene, const BoundExpected &expected,
                                                          const BoundEvidence &seen, Handle before, Handle hiding,
                                                          const BoundLabelling &how, const BoundLabels &labels) {
    const Size size = scene.size();
    const OptionalMask last(before, "before", size), front(hiding, "hiding", size);
    expect_size(expected.size(), size, "expected");
    expect_size(seen.size(), size, "planes");
    expect_size(labels.size(), size, "mask");
    const Labelling what = how.with(scene, expected, seen, last, front);
    const Labels out = labels.out();
    Unlocked unlocked;
    const VisiblePart visible = kernels().label(size, what, out);
    return {visible.foreign, visible.expected, visible.both, visible.seen,
            FourNumbers{visible.left, visible.top, visible.right, visible.bottom}};
}

std::tuple<Index, Index, double> learn(const BoundWindow &window, Handle aligned, const BoundExpected &expected,
                                       Handle errors, const BoundLabels &labels, const BoundGround &ground,
                                       const BoundLearning &how, const BoundMemory &memory) {
    const Size size = window.size();
    const Image lattice(aligned, "aligned", {size.height, size.width, CHANNELS});
    const Image planes(errors, "errors", {EVIDENCE_PLANES, size.height, size.width});
    expect_size(expected.size(), size, "expected");
    expect_size(labels.size(), size, "mask");
    expect_size(ground.size(), size, "background");
    expect_size(memory.size(), size, "memory");
    const Lesson what = how.with(window, lattice, expected, planes, labels, ground);
    const Memory out = memory.out();
    Unlocked unlocked;
    const Fit fit = kernels().learn(size, what, out);
    return {fit.known, fit.strange, fit.spread};
}

void bind_labels(nb::module_ &module) {
    module.def("label", &label, "scene"_a, "expected"_a, "seen"_a, "before"_a.none(), "hiding"_a.none(), "how"_a,
               "labels"_a);
    module.def("learn", &learn, "window"_a, "aligned"_a.none(), "expected"_a, "errors"_a.none(), "labels"_a, "ground"_a,
               "how"_a, "memory"_a);
}

} // namespace

void bind_segmentation(nb::module_ &module) {
    nb::module_ segmentation = module.def_submodule("segmentation");
    segmentation.attr("KNOWN") = KNOWN;
    segmentation.attr("FAR_OFF") = FAR_OFF;
    segmentation.attr("BINS") = BINS;
    segmentation.attr("POINT_ROWS") = POINT_ROWS;
    bind_structs(segmentation);
    bind_shapes(segmentation);
    bind_colours(segmentation);
    bind_windows(segmentation);
    bind_evidence(segmentation);
    bind_motion(segmentation);
    bind_labels(segmentation);
}

} // namespace hs
