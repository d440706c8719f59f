// What Python sees of the patch tracker.
#include "patch_bindings.hpp"

#include "../levels.hpp"
#include "picture_views.hpp"

#include <nanobind/stl/tuple.h>

#include <cmath>
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

void sample(nb::handle picture, double x, double y, double step_x, double step_y, double angle, nb::handle samples) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<float, 3> out(samples, "samples");
    const Window window{as_picture(pixels, 2), as_place(x, y, step_x, step_y, angle), out.size(1), out.size(2)};
    expect_sides("samples", window.rows, window.columns, 1);
    out.expect({window.picture.channels, -1, -1});
    nb::gil_scoped_release release;
    level().patches.sample(window, OwnedPatchRoom(window).room(), out.data());
}

void patch(nb::handle gray, double x, double y, double step_x, double step_y, double angle, nb::handle weights,
           nb::handle templates, nb::handle patch, nb::handle scores) {
    const Array<const float, 2> pixels(gray, "gray"), inner(weights, "weights");
    const Array<const float, 3> others(templates, "templates");
    const Array<float, 2> out(patch, "patch");
    const Array<double, 1> agreements(scores, "scores");
    const Picture picture{pixels.data(), pixels.size(0), pixels.size(1), 1};
    expect_sides("gray", picture.height, picture.width, 2);
    const Window window{picture, as_place(x, y, step_x, step_y, angle), inner.size(0), inner.size(1)};
    expect_sides("weights", window.rows, window.columns, 1);
    others.expect({-1, window.rows, window.columns});
    out.expect({window.rows, window.columns});
    agreements.expect({others.size(0)});
    nb::gil_scoped_release release;
    level().patches.patch(window, inner.data(), others.data(), others.size(0), OwnedPatchRoom(window).room(),
                          out.data(), agreements.data());
}

Py_ssize_t bins_of(const Picture &picture) { return picture.channels == 1 ? GRAYS : COLOURS; }

void likelihood(nb::handle picture, double x, double y, double step_x, double step_y, double angle,
                nb::handle histograms, nb::handle likelihood) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<const float, 2> shares(histograms, "histograms");
    const Array<float, 2> out(likelihood, "likelihood");
    const Window window{as_picture(pixels, 2), as_place(x, y, step_x, step_y, angle), out.size(0), out.size(1)};
    expect_sides("likelihood", window.rows, window.columns, 2);
    shares.expect({2, bins_of(window.picture)});
    nb::gil_scoped_release release;
    level().patches.likelihood(window, shares.data(), OwnedPatchRoom(window).room(), out.data());
}

void learn_colours(nb::handle picture, double x, double y, double step_x, double step_y, double angle,
                   nb::handle inside, float rate, nb::handle old, nb::handle learned) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<const std::uint8_t, 2> mask(inside, "inside");
    const Array<const float, 2> before(old, "old");
    const Array<float, 2> out(learned, "learned");
    const Window window{as_picture(pixels, 2), as_place(x, y, step_x, step_y, angle), mask.size(0), mask.size(1)};
    const Py_ssize_t bins = bins_of(window.picture);
    expect_sides("inside", window.rows, window.columns, 1);
    before.expect({2, bins});
    out.expect({2, bins});
    nb::gil_scoped_release release;
    const std::unique_ptr<float[]> counts(new float[2 * bins]);
    level().patches.learn(window, mask.data(), {before.data(), bins}, rate, OwnedPatchRoom(window).room(), counts.get(),
                          out.data());
}

using Fitted = std::tuple<double, double, double, double, bool>;

Fitted fit_motion(nb::handle first, nb::handle second, nb::handle flow, nb::handle prior, nb::handle likelihood,
                  double ratio, nb::handle outside, bool rotation, double separation, nb::handle planes) {
    const Array<const float, 2> here(first, "first"), there(second, "second"), weights(prior, "prior");
    const Array<const float, 2> around(outside, "outside");
    const Array<const float, 3> field(flow, "flow");
    const Array<float, 3> out(planes, "planes");
    const Py_ssize_t height = here.size(0), width = here.size(1);
    expect_sides("first", height, width, 2);
    there.expect({height, width});
    weights.expect({height, width});
    around.expect({height, width});
    field.expect({height, width, 2});
    out.expect({3, height, width});
    FitPriors priors{weights.data(), around.data(), {nullptr, 0, 0, ratio}, rotation, separation};
    std::optional<Array<const float, 2>> colours;
    if (!likelihood.is_none()) {
        colours.emplace(likelihood, "likelihood");
        expect_sides("likelihood", colours->size(0), colours->size(1), 2);
        priors.colours = {colours->data(), colours->size(0), colours->size(1), ratio};
    }
    nb::gil_scoped_release release;
    const MotionFitKernels &kernels = level().motion_fit;
    const std::unique_ptr<float[]> floats(new float[kernels.floats(height, width)]);
    const std::unique_ptr<std::int32_t[]> integers(new std::int32_t[kernels.integers(height, width)]);
    const PatchFlow patches{here.data(), there.data(), field.data(), height, width};
    const MotionFit fit = kernels.fit(patches, priors, {floats.get(), integers.get()}, out.data());
    return {fit.motion.right, fit.motion.down, fit.motion.growth, fit.motion.turn, fit.apart};
}

// How `keep` goes on: see persistence.hpp.
Persistence persistence(double same, double changed, double rate, double mean_rate, double mask_rate, double floor) {
    expect(changed > same, "expected changed > same, got " + std::to_string(changed) + " and " + std::to_string(same));
    return {same, changed, rate, mean_rate, mask_rate, floor};
}

void update_persistence(nb::handle last, nb::handle body, nb::handle previous, nb::handle means, nb::handle weights,
                        nb::handle planes, nb::handle flow, nb::handle patch, double right, double down, double cosine,
                        double sine, double same, double changed, double rate, double mean_rate, double mask_rate,
                        double floor, nb::handle out, nb::handle learned) {
    const Array<const float, 2> persistent(last, "persistence"), object(body, "body"), before(previous, "previous");
    const Array<const float, 2> place(weights, "weights"), now(patch, "patch");
    const Array<const float, 3> old(means, "means"), fitted(planes, "planes"), field(flow, "flow");
    const Array<float, 2> updated(out, "out");
    const Array<float, 3> fresh(learned, "learned");
    const Py_ssize_t rows = persistent.size(0), columns = persistent.size(1), height = 2 * rows, width = 2 * columns;
    expect_sides("persistence", rows, columns, 2);
    object.expect({rows, columns});
    for (const auto *plane : {&before, &place, &now}) plane->expect({height, width});
    old.expect({4, height, width});
    fitted.expect({3, height, width});
    field.expect({height, width, 2});
    updated.expect({rows, columns});
    fresh.expect({4, height, width});
    const Persistence how = persistence(same, changed, rate, mean_rate, mask_rate, floor);
    nb::gil_scoped_release release;
    const std::unique_ptr<float[]> room(new float[keep_room(height, width)]);
    level().persistence.update(
        {persistent.data(), object.data(), before.data(), old.data(), place.data(), height, width},
        {fitted.data(), field.data(), now.data(), right, down, cosine, sine}, how, room.get(), updated.data(),
        fresh.data());
}

} // namespace

void bind_patch_tracker(nb::module_ &module) {
    module.def("sample", &sample, "picture"_a.none(), "x"_a, "y"_a, "step_x"_a, "step_y"_a, "angle"_a,
               "samples"_a.none());
    module.def("patch", &patch, "gray"_a.none(), "x"_a, "y"_a, "step_x"_a, "step_y"_a, "angle"_a, "weights"_a.none(),
               "templates"_a.none(), "patch"_a.none(), "scores"_a.none());
    module.def("likelihood", &likelihood, "picture"_a.none(), "x"_a, "y"_a, "step_x"_a, "step_y"_a, "angle"_a,
               "histograms"_a.none(), "likelihood"_a.none());
    module.def("learn_colours", &learn_colours, "picture"_a.none(), "x"_a, "y"_a, "step_x"_a, "step_y"_a, "angle"_a,
               "inside"_a.none(), "rate"_a, "old"_a.none(), "learned"_a.none());
    module.def("fit_motion", &fit_motion, "first"_a.none(), "second"_a.none(), "flow"_a.none(), "prior"_a.none(),
               "likelihood"_a.none(), "ratio"_a, "outside"_a.none(), "rotation"_a, "separation"_a, "planes"_a.none());
    module.def("update_persistence", &update_persistence, "persistence"_a.none(), "body"_a.none(), "previous"_a.none(),
               "means"_a.none(), "weights"_a.none(), "planes"_a.none(), "flow"_a.none(), "patch"_a.none(), "right"_a,
               "down"_a, "cosine"_a, "sine"_a, "same"_a, "changed"_a, "rate"_a, "mean_rate"_a, "mask_rate"_a, "floor"_a,
               "out"_a.none(), "learned"_a.none());
}

} // namespace hs
