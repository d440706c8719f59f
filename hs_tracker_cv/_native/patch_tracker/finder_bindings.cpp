// What Python sees of the finder.
#include "finder_bindings.hpp"

#include "../levels.hpp"
#include "finder.hpp"
#include "peak.hpp"
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

// Room of a kernel: what is in it at first does not count.
std::unique_ptr<float[]> room(std::ptrdiff_t floats) { return std::unique_ptr<float[]>(new float[floats]); }

std::ptrdiff_t expect_channels(Py_ssize_t channels) {
    if (channels != GRAY_CHANNELS && channels != COLOUR_CHANNELS)
        throw nb::value_error(("expected " + std::to_string(GRAY_CHANNELS) + " or " + std::to_string(COLOUR_CHANNELS) +
                               " channels, got " + std::to_string(channels))
                                  .c_str());
    return channels;
}

const Circle &whole_circle() {
    static const Circle whole = circle();
    return whole;
}

void describe(nb::handle picture, const PlaceNumbers &at, nb::handle fade, nb::handle names, nb::handle features,
              nb::handle grays) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<const float, 2> weights(fade, "fade");
    const Array<float, 3> out(features, "features");
    const Array<float, 2> means(grays, "grays");
    const Picture view = as_picture(pixels, 1);
    const Place place = as_place(at);
    weights.expect({CELLS, CELLS});
    std::optional<Array<const float, 2>> called;
    if (!names.is_none()) {
        called.emplace(names, "names");
        called->expect({view.channels == 1 ? SHADES : SHADES * SHADES * SHADES, NAMES});
    }
    out.expect({CELLS, CELLS, called ? COLOUR_CHANNELS : GRAY_CHANNELS});
    means.expect({CELLS, CELLS});
    nb::gil_scoped_release release;
    const FinderKernels &finder = level().finder;
    const auto space = room(finder.describe_room(view, place));
    finder.describe(view, place, weights.data(), called ? called->data() : nullptr, space.get(), out.data(),
                    means.data());
}

void shade(nb::handle picture, const PlaceNumbers &at, nb::handle grays) {
    const Array<const float, 3> pixels(picture, "picture");
    const Array<float, 2> out(grays, "grays");
    const Picture view = as_picture(pixels, 1);
    const Place place = as_place(at);
    out.expect({CELLS, CELLS});
    nb::gil_scoped_release release;
    const auto space = room(level().finder.describe_room(view, place));
    level().finder.shade(view, place, space.get(), out.data());
}

void transform(nb::handle features, nb::handle spectrum) {
    const Array<const float, 3> in(features, "features");
    const Array<float, 4> out(spectrum, "spectrum");
    in.expect({CELLS, CELLS, -1});
    const std::ptrdiff_t channels = expect_channels(in.size(2));
    out.expect({CELLS, HALF, 2, channels});
    nb::gil_scoped_release release;
    const auto space = room(transform_room(channels));
    level().finder.transform(in.data(), channels, whole_circle(), space.get(), out.data());
}

Learning learning(float memory, float coupling, float growth, int rounds) {
    if (!(memory >= 0.0f && coupling > 0.0f && growth >= 1.0f && rounds >= 1))
        throw nb::value_error("expected memory >= 0, coupling > 0, growth >= 1 and rounds >= 1");
    return {memory, coupling, growth, rounds};
}

void adapt(nb::handle spectrum, nb::handle target, nb::handle penalty, nb::handle old, const Learning &how,
           nb::handle learned) {
    const Array<const float, 4> in(spectrum, "spectrum");
    const Array<const float, 2> wanted(target, "target"), weights(penalty, "penalty");
    const Array<float, 4> out(learned, "learned");
    in.expect({CELLS, HALF, 2, -1});
    const std::ptrdiff_t channels = expect_channels(in.size(3));
    wanted.expect({CELLS, HALF});
    weights.expect({CELLS, CELLS});
    out.expect({CELLS, HALF, 2, channels});
    std::optional<Array<const float, 4>> before;
    if (!old.is_none()) {
        before.emplace(old, "old");
        before->expect({CELLS, HALF, 2, channels});
    }
    nb::gil_scoped_release release;
    const auto space = room(adapt_room(channels));
    level().finder.adapt(in.data(), wanted.data(), weights.data(), before ? before->data() : nullptr, channels, how,
                         whole_circle(), space.get(), out.data());
}

std::tuple<double, double, double, double, double, double, double, double>
respond(nb::handle learned, nb::handle witness, nb::handle spectrum, const std::array<double, 5> &fade,
        nb::handle response) {
    const auto [weight, right, down, across, along] = fade;
    const Array<const float, 4> first(learned, "learned"), second(witness, "witness"), in(spectrum, "spectrum");
    const Array<float, 2> out(response, "response");
    in.expect({CELLS, HALF, 2, -1});
    const std::ptrdiff_t channels = expect_channels(in.size(3));
    first.expect({CELLS, HALF, 2, channels});
    second.expect({CELLS, HALF, 2, channels});
    out.expect({CELLS, CELLS});
    Peak peak;
    {
        nb::gil_scoped_release release;
        const auto space = room(4 * CELLS * HALF + 4 * CELLS * CELLS);
        float *spectra = space.get(), *responses = spectra + 4 * CELLS * HALF;
        level().finder.respond(first.data(), second.data(), in.data(), channels, whole_circle(),
                               responses + 2 * CELLS * CELLS, spectra, responses);
        peak = find_peak(responses, spectra, {weight, right, down, across, along}, out.data());
    }
    return {peak.dx, peak.dy, peak.height, peak.value, peak.second, peak.mean, peak.deviation, peak.witness};
}

} // namespace

void bind_finder(nb::module_ &module) {
    nb::class_<Learning>(module, "FilterLearning")
        .def(
            "__init__",
            [](Learning *self, float memory, float coupling, float growth, int rounds) {
                new (self) Learning(learning(memory, coupling, growth, rounds));
            },
            nb::kw_only(), "memory"_a, "coupling"_a, "growth"_a, "rounds"_a);
    module.def("describe", &describe, "picture"_a.none(), "at"_a, "fade"_a.none(), "names"_a.none(),
               "features"_a.none(), "grays"_a.none());
    module.def("shade", &shade, "picture"_a.none(), "at"_a, "grays"_a.none());
    module.def("transform", &transform, "features"_a.none(), "spectrum"_a.none());
    module.def("adapt", &adapt, "spectrum"_a.none(), "target"_a.none(), "penalty"_a.none(), "old"_a.none(), "how"_a,
               "learned"_a.none());
    module.def("respond", &respond, "learned"_a.none(), "witness"_a.none(), "spectrum"_a.none(), "fade"_a,
               "response"_a.none());
}

} // namespace hs
