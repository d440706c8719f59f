#include "structs.hpp"

#include <nanobind/stl/array.h>

#include <string>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

Weighing checked_weighing(int value, const Byte *shown) {
    checked_count(value, "weighing", 0, 2);
    const auto weighing = static_cast<Weighing>(value);
    if (weighing != Weighing::evenly && !shown) refuse("expected shown to be a mask, got None");
    return weighing;
}

} // namespace

void refuse(const std::string &message) { throw nb::value_error(message.c_str()); }

Size checked_size(const Buffer &array, const char *name) {
    return checked_size(Size{array.size(0), array.size(1)}, name);
}

Size checked_size(Size size, const char *name) {
    if (size.height < LEAST_SIDE || size.width < LEAST_SIDE)
        refuse(std::string("expected ") + name + " to have at least 3 x 3 pixels, got " + std::to_string(size.height) +
               " x " + std::to_string(size.width));
    // Indices of pixels must fit into 32 bits.
    if (size.height > (Index(1) << 28) / size.width)
        refuse(std::string("expected ") + name + " to have at most 2^28 pixels");
    return size;
}

void expect_size(Size size, Size window, const char *name) {
    if (size.height == window.height && size.width == window.width) return;
    const auto text = [](Size s) { return "(" + std::to_string(s.height) + ", " + std::to_string(s.width) + ")"; };
    refuse(std::string("expected ") + name + " to have shape " + text(window) + ", got " + text(size));
}

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

Grid checked_grid(const GridNumbers &grid) {
    if (!(grid[2] > 0.0))
        refuse("expected a grid (cx, cy, scale, area) with scale > 0, got " + std::to_string(grid[2]));
    if (!(grid[3] >= 0.0 && grid[3] < 1e12)) refuse("expected an area from 0 to 1e12, got " + std::to_string(grid[3]));
    return {grid[0], grid[1], grid[2], grid[3]};
}

BoundWindow::BoundWindow(Handle image, Handle inside)
    : image_(image, "image", {-1, -1, CHANNELS}), size_(checked_size(image_, "image")),
      inside_(checked_part(inside, "inside", size_)) {}

BoundGround::BoundGround(Handle image, Handle counts)
    : image_(image, "background", {-1, -1, CHANNELS}), counts_(counts, "counts", {3, image_.size(0), image_.size(1)}) {}

BoundScene::BoundScene(Handle image, Handle inside, Handle moved, Handle background, Handle counts)
    : window_(image, inside), moved_(moved, "moved", {size().height, size().width, CHANNELS}),
      background_(background, "background", {size().height, size().width, CHANNELS}),
      counts_(counts, "counts", {3, size().height, size().width}) {}

BoundLayer::BoundLayer(Handle image, Handle odds, Handle shape)
    : image_(image, "obj", {-1, -1, CHANNELS}), odds_(odds, "odds", {image_.size(0), image_.size(1)}),
      shape_(shape, "shape", {image_.size(0), image_.size(1)}) {}

BoundExpected::BoundExpected(Handle previous, Handle image, Handle odds, Handle shape, Handle own, Handle part)
    : layer_(image, odds, shape), previous_(previous, "previous", {size().height, size().width, CHANNELS}),
      own_(own, "own", {size().height, size().width}), part_(checked_part(part, "part", size())) {}

BoundEvidence::BoundEvidence(Handle planes, Handle fresh)
    : planes_(planes, "planes", {EVIDENCE_PLANES, -1, -1}), fresh_(fresh, "fresh", {planes_.size(1), planes_.size(2)}) {
}

BoundLabels::BoundLabels(Handle bins, Handle raw, Handle odds, Handle mask, Handle foreign)
    : mask_(mask, "mask"), bins_(bins, "bins", {mask_.size(0), mask_.size(1)}),
      raw_(raw, "raw", {mask_.size(0), mask_.size(1)}), odds_(odds, "odds", {mask_.size(0), mask_.size(1)}) {
    if (foreign.is_none()) return;
    foreign_.emplace(foreign, "foreign", std::initializer_list<Py_ssize_t>{mask_.size(0), mask_.size(1)});
}

Labels BoundLabels::out() const {
    if (!foreign_) refuse("expected foreign to be a mask, got None");
    return {bins_.out(), raw_.out(), odds_.out(), mask_.out(), foreign_->out()};
}

BoundOutline::BoundOutline(Handle odds, Handle shown, int weighing, const GridNumbers &box)
    : odds_(odds, "odds"), size_(checked_size(odds_, "odds")), shown_(shown, "shown", size_),
      weighing_(checked_weighing(weighing, shown_.data())), box_(checked_grid(box)) {}

BoundPrediction::BoundPrediction(Handle near, Handle weight, Handle theta, Handle flow)
    : near_(near, "near"), weight_(weight, "weight", {near_.size(0), near_.size(1)}), theta_(theta, "theta", {THETA}),
      flow_(flow, "flow", {near_.size(0), near_.size(1), 2}) {}

BoundLabelling::BoundLabelling(Handle colours, double colour_weight, double noise, double least, Index growth,
                               bool emerging, bool young)
    : colours_(colours, "colours", {2, BINS}), colour_weight_(colour_weight), noise_(noise), least_(least),
      growth_(checked_count(growth, "growth", 0, MOST_REACH)), emerging_(emerging), young_(young) {}

Labelling BoundLabelling::with(const BoundScene &scene, const BoundExpected &expected, const BoundEvidence &seen,
                               const OptionalMask &before, const OptionalMask &hiding) const {
    const Object object = expected.object();
    return {scene.image(), scene.ground(), object.odds,   object.shape,    expected.own(), seen.planes_out(),
            seen.fresh(),  before.data(),  hiding.data(), colours_.data(), colour_weight_, noise_,
            least_,        growth_,        emerging_,     young_,          scene.inside()};
}

Lesson BoundLearning::with(const BoundWindow &window, const Image &aligned, const BoundExpected &expected,
                           const Image &planes, const BoundLabels &labels, const BoundGround &ground) const {
    const Object object = expected.object();
    return {window.image(),   aligned.data(),  labels.mask(),   expected.own(),
            labels.foreign(), labels.odds(),   labels.raw(),    {nullptr, object.image, object.odds, object.shape},
            planes.data(),    labels.bins(),   ground.ground(), colours_.data(),
            expected.part(),  window.inside(), shape_rate_,     colour_rate_,
            freeze_,          hidden_};
}

// What is known and seen.
static void bind_windows_and_layers(nb::module_ &module) {
    nb::class_<BoundWindow>(module, "Window").def(nb::init<Handle, Handle>(), "image"_a.none(), "inside"_a.none());
    nb::class_<BoundGround>(module, "Ground").def(nb::init<Handle, Handle>(), "background"_a.none(), "counts"_a.none());
    nb::class_<BoundScene>(module, "Scene")
        .def(nb::init<Handle, Handle, Handle, Handle, Handle>(), "image"_a.none(), "inside"_a.none(), "moved"_a.none(),
             "background"_a.none(), "counts"_a.none());
    nb::class_<BoundLayer>(module, "Layer")
        .def(nb::init<Handle, Handle, Handle>(), "obj"_a.none(), "odds"_a.none(), "shape"_a.none());
    nb::class_<BoundExpected>(module, "Expected")
        .def(nb::init<Handle, Handle, Handle, Handle, Handle, Handle>(), "previous"_a.none(), "obj"_a.none(),
             "odds"_a.none(), "shape"_a.none(), "own"_a.none(), "part"_a.none());
    nb::class_<BoundEvidence>(module, "Evidence").def(nb::init<Handle, Handle>(), "planes"_a.none(), "fresh"_a.none());
    nb::class_<BoundLabels>(module, "Labels")
        .def(nb::init<Handle, Handle, Handle, Handle, Handle>(), "bins"_a.none(), "raw"_a.none(), "odds"_a.none(),
             "mask"_a.none(), "foreign"_a.none());
    nb::class_<BoundMemory>(module, "Memory")
        .def(nb::init<Handle, Handle, Handle, Handle, Handle, Handle>(), "odds"_a.none(), "obj"_a.none(),
             "shape"_a.none(), "background"_a.none(), "counts"_a.none(), "colours"_a.none());
}

// Of the motion.
static void bind_motions(nb::module_ &module) {
    nb::class_<BoundPoints>(module, "Points")
        .def(nb::init<Handle, Index>(), "rows"_a.none(), "count"_a = 0)
        .def_prop_ro("count", &BoundPoints::count);
    nb::class_<BoundOutline>(module, "Outline")
        .def(nb::init<Handle, Handle, int, const GridNumbers &>(), "odds"_a.none(), "shown"_a.none(), "weighing"_a,
             "box"_a);
    nb::class_<LastMotion>(module, "LastMotion")
        .def(
            "__init__",
            [](LastMotion *self, const std::array<double, 6> &motion, const Pair2 &camera, bool known) {
                new (self) LastMotion{motion, camera, known};
            },
            nb::kw_only(), "motion"_a, "camera"_a, "known"_a);
    nb::class_<BoundPrediction>(module, "Prediction")
        .def(nb::init<Handle, Handle, Handle, Handle>(), "near"_a.none(), "weight"_a.none(), "theta"_a.none(),
             "flow"_a.none());
    nb::class_<Measuring>(module, "Measuring")
        .def(
            "__init__",
            [](Measuring *self, const GridNumbers &grid, const Pair2 &camera, const Pair2 &offset, double noise,
               bool hidden, bool young, Index ground_steps, Index steps) {
                new (self) Measuring{checked_grid(grid),
                                     camera,
                                     offset,
                                     noise,
                                     hidden,
                                     young,
                                     checked_count(ground_steps, "ground_steps", 0, MOST_STEPS),
                                     checked_count(steps, "steps", 0, MOST_STEPS)};
            },
            nb::kw_only(), "grid"_a, "camera"_a, "offset"_a, "noise"_a, "hidden"_a, "young"_a, "ground_steps"_a,
            "steps"_a);
    nb::class_<BoundRegistration>(module, "Registration")
        .def(nb::init<Handle, double, double, double, Index>(), nb::kw_only(), "prior"_a.none(), "scale"_a, "ceiling"_a,
             "stiffness"_a, "steps"_a);
}

// How a frame is labelled and learned from.
static void bind_labelling(nb::module_ &module) {
    nb::class_<Likelihood>(module, "Likelihood")
        .def(
            "__init__",
            [](Likelihood *self, float ground_slope, float object_slope, float channel_weight, float contrast,
               bool occluded, float noise, const std::array<float, 2> &ground_gains,
               const std::array<float, 2> &object_gains) {
                new (self) Likelihood{ground_slope, object_slope,    channel_weight,  contrast,        float(occluded),
                                      noise,        ground_gains[0], ground_gains[1], object_gains[0], object_gains[1]};
            },
            nb::kw_only(), "ground_slope"_a, "object_slope"_a, "channel_weight"_a, "contrast"_a, "occluded"_a,
            "noise"_a, "ground_gains"_a, "object_gains"_a);
    nb::class_<BoundLabelling>(module, "Labelling")
        .def(nb::init<Handle, double, double, double, Index, bool, bool>(), nb::kw_only(), "colours"_a.none(),
             "colour_weight"_a, "noise"_a, "least"_a, "growth"_a, "emerging"_a, "young"_a);
    nb::class_<BoundLearning>(module, "Learning")
        .def(nb::init<Handle, float, double, bool, bool>(), nb::kw_only(), "colours"_a.none(), "shape_rate"_a,
             "colour_rate"_a, "freeze"_a, "hidden"_a);
}

void bind_structs(nb::module_ &module) {
    bind_windows_and_layers(module);
    bind_motions(module);
    bind_labelling(module);
}

} // namespace hs
