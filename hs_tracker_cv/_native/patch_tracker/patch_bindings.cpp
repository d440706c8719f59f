// What Python sees of the patch tracker.
#include "patch_bindings.hpp"

#include "../levels.hpp"
#include "picture_views.hpp"

#include <nanobind/stl/array.h>
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

void expect(bool holds, const std::string &message) {
    if (!holds) throw nb::value_error(message.c_str());
}

// A name and sizes (rows, columns) of which none may be less than some.
void expect_sides(const char *name, Py_ssize_t rows, Py_ssize_t columns, Py_ssize_t fewest) {
    expect(rows >= fewest && columns >= fewest,
           std::string("expected ") + name + " to have at least " + std::to_string(fewest) + " x " +
               std::to_string(fewest) + " elements, got " + std::to_string(rows) + " x " + std::to_string(columns));
}

// What the patch kernels work in.
class OwnedPatchRoom {
  public:
    explicit OwnedPatchRoom(const Window &window)
        : floats_(new float[level().patches.floats(window)]),
          integers_(new std::int32_t[level().patches.integers(window)]) {}
    PatchRoom room() const { return {floats_.get(), integers_.get()}; }

  private:
    std::unique_ptr<float[]> floats_;
    std::unique_ptr<std::int32_t[]> integers_;
};

void sample(nb::handle picture, const PlaceNumbers &at, nb::handle samples) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<float, 3> out(samples, "samples");
    const Window window{as_picture(pixels, 2), as_place(at), out.size(1), out.size(2)};
    expect_sides("samples", window.rows, window.columns, 1);
    out.expect({window.picture.channels, -1, -1});
    nb::gil_scoped_release release;
    level().patches.sample(window, OwnedPatchRoom(window).room(), out.data());
}

void patch(nb::handle gray, const PlaceNumbers &at, nb::handle weights, nb::handle templates, nb::handle patch,
           nb::handle scores) {
    const Array<const float, 2> pixels(gray, "gray"), inner(weights, "weights");
    const Array<const float, 3> others(templates, "templates");
    const Array<float, 2> out(patch, "patch");
    const Array<double, 1> agreements(scores, "scores");
    const Picture picture{pixels.data(), pixels.size(0), pixels.size(1), 1};
    expect_sides("gray", picture.height, picture.width, 2);
    const Window window{picture, as_place(at), inner.size(0), inner.size(1)};
    expect_sides("weights", window.rows, window.columns, 1);
    others.expect({-1, window.rows, window.columns});
    out.expect({window.rows, window.columns});
    agreements.expect({others.size(0)});
    nb::gil_scoped_release release;
    level().patches.patch(window, inner.data(), others.data(), others.size(0), OwnedPatchRoom(window).room(),
                          out.data(), agreements.data());
}

Py_ssize_t bins_of(const Picture &picture) { return picture.channels == 1 ? GRAYS : COLOURS; }

void likelihood(nb::handle picture, const PlaceNumbers &at, nb::handle histograms, nb::handle likelihood) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<const float, 2> shares(histograms, "histograms");
    const Array<float, 2> out(likelihood, "likelihood");
    const Window window{as_picture(pixels, 2), as_place(at), out.size(0), out.size(1)};
    expect_sides("likelihood", window.rows, window.columns, 2);
    shares.expect({2, bins_of(window.picture)});
    nb::gil_scoped_release release;
    level().patches.likelihood(window, shares.data(), OwnedPatchRoom(window).room(), out.data());
}

void learn_colours(nb::handle picture, const PlaceNumbers &at, nb::handle inside, float rate, nb::handle old,
                   nb::handle learned) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<const std::uint8_t, 2> mask(inside, "inside");
    const Array<const float, 2> before(old, "old");
    const Array<float, 2> out(learned, "learned");
    const Window window{as_picture(pixels, 2), as_place(at), mask.size(0), mask.size(1)};
    const Py_ssize_t bins = bins_of(window.picture);
    expect_sides("inside", window.rows, window.columns, 1);
    before.expect({2, bins});
    out.expect({2, bins});
    nb::gil_scoped_release release;
    const std::unique_ptr<float[]> counts(new float[2 * bins]);
    level().patches.learn(window, mask.data(), {before.data(), bins}, rate, OwnedPatchRoom(window).room(), counts.get(),
                          out.data());
}

// Prior weights of a fit, see FitPriors.
class BoundPriors {
  public:
    BoundPriors(nb::handle prior, nb::handle outside, nb::handle likelihood, double ratio)
        : object_(prior, "prior"), outside_(outside, "outside", {object_.size(0), object_.size(1)}), ratio_(ratio) {
        expect_sides("prior", object_.size(0), object_.size(1), 2);
        if (likelihood.is_none()) return;
        colours_.emplace(likelihood, "likelihood");
        expect_sides("likelihood", colours_->size(0), colours_->size(1), 2);
    }
    Py_ssize_t height() const { return object_.size(0); }
    Py_ssize_t width() const { return object_.size(1); }
    FitPriors with(bool rotation, double separation) const {
        ColourPrior colours{nullptr, 0, 0, ratio_};
        if (colours_) colours = {colours_->data(), colours_->size(0), colours_->size(1), ratio_};
        return {object_.data(), outside_.data(), colours, rotation, separation};
    }

  private:
    Array<const float, 2> object_, outside_;
    std::optional<Array<const float, 2>> colours_;
    double ratio_;
};

using Fitted = std::tuple<double, double, double, double, bool>;

Fitted fit_motion(nb::handle first, nb::handle second, nb::handle flow, const BoundPriors &priors, bool rotation,
                  double separation, nb::handle planes) {
    const Py_ssize_t height = priors.height(), width = priors.width();
    const Array<const float, 2> here(first, "first", {height, width}), there(second, "second", {height, width});
    const Array<const float, 3> field(flow, "flow", {height, width, 2});
    const Array<float, 3> out(planes, "planes", {3, height, width});
    nb::gil_scoped_release release;
    const MotionFitKernels &kernels = level().motion_fit;
    const std::unique_ptr<float[]> floats(new float[kernels.floats(height, width)]);
    const std::unique_ptr<std::int32_t[]> integers(new std::int32_t[kernels.integers(height, width)]);
    const PatchFlow patches{here.data(), there.data(), field.data(), height, width};
    const MotionFit fit =
        kernels.fit(patches, priors.with(rotation, separation), {floats.get(), integers.get()}, out.data());
    return {fit.motion.right, fit.motion.down, fit.motion.growth, fit.motion.turn, fit.apart};
}

// What is known of the frame before, see Before.
class BoundBefore {
  public:
    BoundBefore(nb::handle persistence, nb::handle body, nb::handle previous, nb::handle means, nb::handle weights)
        : kept_(persistence, "persistence"), body_(body, "body", {rows(), columns()}),
          previous_(previous, "previous", {height(), width()}), means_(means, "means", {4, height(), width()}),
          weights_(weights, "weights", {height(), width()}) {
        expect_sides("persistence", rows(), columns(), 2);
    }
    Py_ssize_t rows() const { return kept_.size(0); }
    Py_ssize_t columns() const { return kept_.size(1); }
    Py_ssize_t height() const { return 2 * rows(); }
    Py_ssize_t width() const { return 2 * columns(); }
    Before view() const {
        return {kept_.data(), body_.data(), previous_.data(), means_.data(), weights_.data(), height(), width()};
    }

  private:
    Array<const float, 2> kept_, body_, previous_;
    Array<const float, 3> means_;
    Array<const float, 2> weights_;
};

// What the flow says, see Passage.
class BoundPassage {
  public:
    BoundPassage(nb::handle planes, nb::handle flow, nb::handle patch, const std::array<double, 4> &way)
        : planes_(planes, "planes"), flow_(flow, "flow"), patch_(patch, "patch"), way_(way) {}
    Passage view(Py_ssize_t height, Py_ssize_t width) const {
        planes_.expect({3, height, width});
        flow_.expect({height, width, 2});
        patch_.expect({height, width});
        return {planes_.data(), flow_.data(), patch_.data(), way_[0], way_[1], way_[2], way_[3]};
    }

  private:
    Array<const float, 3> planes_, flow_;
    Array<const float, 2> patch_;
    std::array<double, 4> way_;
};

// How persistence goes on: see persistence.hpp.
Persistence rates(double same, double changed, double rate, double mean_rate, double mask_rate, double floor) {
    expect(changed > same, "expected changed > same, got " + std::to_string(changed) + " and " + std::to_string(same));
    return {same, changed, rate, mean_rate, mask_rate, floor};
}

void update_persistence(const BoundBefore &before, const BoundPassage &passage, const Persistence &how, nb::handle out,
                        nb::handle learned) {
    const Py_ssize_t height = before.height(), width = before.width();
    const Array<float, 2> updated(out, "out", {before.rows(), before.columns()});
    const Array<float, 3> fresh(learned, "learned", {4, height, width});
    const Passage way = passage.view(height, width);
    nb::gil_scoped_release release;
    const std::unique_ptr<float[]> room(new float[keep_room(height, width)]);
    level().persistence.update(before.view(), way, how, room.get(), updated.data(), fresh.data());
}

void bind_fit(nb::module_ &module) {
    nb::class_<BoundPriors>(module, "FitPriors")
        .def(nb::init<nb::handle, nb::handle, nb::handle, double>(), "prior"_a.none(), "outside"_a.none(),
             "likelihood"_a.none(), "ratio"_a);
    module.def("fit_motion", &fit_motion, "first"_a.none(), "second"_a.none(), "flow"_a.none(), "priors"_a,
               "rotation"_a, "separation"_a, "planes"_a.none());
}

void bind_persistence(nb::module_ &module) {
    nb::class_<BoundBefore>(module, "KnownBefore")
        .def(nb::init<nb::handle, nb::handle, nb::handle, nb::handle, nb::handle>(), "persistence"_a.none(),
             "body"_a.none(), "previous"_a.none(), "means"_a.none(), "weights"_a.none());
    nb::class_<BoundPassage>(module, "Passage")
        .def(nb::init<nb::handle, nb::handle, nb::handle, const std::array<double, 4> &>(), "planes"_a.none(),
             "flow"_a.none(), "patch"_a.none(), "way"_a);
    nb::class_<Persistence>(module, "PersistenceRates")
        .def(
            "__init__",
            [](Persistence *self, double same, double changed, double rate, double mean_rate, double mask_rate,
               double floor) { new (self) Persistence(rates(same, changed, rate, mean_rate, mask_rate, floor)); },
            nb::kw_only(), "same"_a, "changed"_a, "rate"_a, "mean_rate"_a, "mask_rate"_a, "floor"_a);
    module.def("update_persistence", &update_persistence, "before"_a, "passage"_a, "how"_a, "out"_a.none(),
               "learned"_a.none());
}

} // namespace

void bind_patch_tracker(nb::module_ &module) {
    module.def("sample", &sample, "picture"_a.none(), "at"_a, "samples"_a.none());
    module.def("patch", &patch, "gray"_a.none(), "at"_a, "weights"_a.none(), "templates"_a.none(), "patch"_a.none(),
               "scores"_a.none());
    module.def("likelihood", &likelihood, "picture"_a.none(), "at"_a, "histograms"_a.none(), "likelihood"_a.none());
    module.def("learn_colours", &learn_colours, "picture"_a.none(), "at"_a, "inside"_a.none(), "rate"_a, "old"_a.none(),
               "learned"_a.none());
    bind_fit(module);
    bind_persistence(module);
}

} // namespace hs
