// What Python sees: arguments are checked here, Python's lock is let go of, and kernels run.
#include "cpu.hpp"
#include "flow.hpp"
#include "levels.hpp"
#include "multigrid.hpp"
#include "overview.hpp"
#include "patch_tracker/finder_bindings.hpp"
#include "patch_tracker/patch_bindings.hpp"
#include "segmentation/bindings.hpp"
#include "views.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <optional>
#include <string>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

using Unlocked = nb::gil_scoped_release;

void expect(bool holds, const std::string &message) {
    if (!holds) throw nb::value_error(message.c_str());
}

// ValueError unless the planes are so many, of that size.
const Planes &checked(const OwnedPlanes &planes, const char *name, Index count, Index height, Index width) {
    const auto text = [](Index n, Index h, Index w) {
        return std::to_string(n) + " planes of " + std::to_string(h) + " x " + std::to_string(w);
    };
    expect(planes.count() == count && planes.height() == height && planes.width() == width,
           std::string("expected ") + name + " to be " + text(count, height, width) + ", got " +
               text(planes.count(), planes.height(), planes.width()));
    return planes.planes();
}

// Planes that hold the frames of a level: two, or four with a first guess.
const Planes &checked_frames(const OwnedPlanes &frames, const char *name) {
    expect(frames.count() == 2 || frames.count() == 4,
           std::string("expected ") + name + " to be 2 or 4 planes, got " + std::to_string(frames.count()));
    return frames.planes();
}

// Two images of one size.
class FramePair {
  public:
    FramePair(nb::handle frame0, nb::handle frame1) : first_(frame0, "frame0"), second_(frame1, "frame1") {
        expect(height() > 0 && width() > 0, "expected frame0 to have pixels");
        second_.expect({height(), width()});
    }
    Index height() const { return first_.size(0); }
    Index width() const { return first_.size(1); }
    Frames frames() const { return {first_.data(), second_.data()}; }

  private:
    Array<const float, 2> first_, second_;
};

// A plane without its ring, as an array that shares memory with it.
nb::ndarray<nb::numpy, float, nb::ndim<2>> pixels(const OwnedPlanes &planes, Index i) {
    if (i < 0 || i >= planes.count()) {
        const std::string known = "expected a plane from 0 to " + std::to_string(planes.count() - 1);
        throw nb::index_error((known + ", got " + std::to_string(i)).c_str());
    }
    using Memory = std::shared_ptr<float[]>;
    nb::capsule owner(new Memory(planes.memory()), [](void *memory) noexcept { delete static_cast<Memory *>(memory); });
    const Plane plane = planes[i];
    const std::size_t shape[] = {static_cast<std::size_t>(plane.height), static_cast<std::size_t>(plane.width)};
    const std::int64_t strides[] = {plane.stride, 1};
    return {plane.data, 2, shape, owner, strides};
}

void bind_planes(nb::module_ &module) {
    nb::class_<OwnedPlanes>(module, "Planes")
        .def(nb::init<Index, Index, Index>(), "count"_a, "height"_a, "width"_a)
        .def("resize", &OwnedPlanes::resize, "count"_a, "height"_a, "width"_a)
        .def("__len__", &OwnedPlanes::count)
        .def("__getitem__", &pixels, "plane"_a);
}

void bind_system(nb::module_ &module) {
    module.def(
        "derivatives",
        [](nb::handle frame0, nb::handle frame1, bool five_tap, const OwnedPlanes &planes) {
            const FramePair pair(frame0, frame1);
            const Planes &out = checked(planes, "planes", DERIVATIVE_PLANES, pair.height(), pair.width());
            Unlocked unlocked;
            derivatives(pair.frames(), five_tap, out);
        },
        "frame0"_a.none(), "frame1"_a.none(), "five_tap"_a, "planes"_a);
    module.def(
        "classic",
        [](nb::handle frame0, nb::handle frame1, nb::handle flow, bool started, bool five_tap, float smoothness,
           Index sweeps, const OwnedPlanes &planes) {
            const FramePair pair(frame0, frame1);
            const Array<float, 3> result(flow, "flow");
            result.expect({pair.height(), pair.width(), 2});
            expect(sweeps >= 1, "expected sweeps >= 1, got " + std::to_string(sweeps));
            const Planes &room = checked(planes, "planes", CLASSIC_PLANES, pair.height(), pair.width());
            Unlocked unlocked;
            classic(pair.frames(), result.data(), started, five_tap, smoothness, sweeps, room);
        },
        "frame0"_a.none(), "frame1"_a.none(), "flow"_a.none(), "started"_a, "five_tap"_a, "smoothness"_a, "sweeps"_a,
        "planes"_a);
}

void bind_multigrid(nb::module_ &module) {
    nb::class_<Multigrid>(module, "Multigrid")
        .def(
            "__init__", [](Multigrid *self, Index height, Index width) { new (self) Multigrid(height, width); },
            "height"_a, "width"_a)
        .def("sizes", &Multigrid::sizes)
        .def(
            "begin",
            [](Multigrid &self, nb::handle frame0, nb::handle frame1, bool five_tap, float smoothness) {
                const FramePair pair(frame0, frame1);
                expect(pair.height() == self.height() && pair.width() == self.width(),
                       "expected frame0 to have the size of the grid");
                Unlocked unlocked;
                return std::sqrt(self.begin(pair.frames(), five_tap, smoothness));
            },
            "frame0"_a.none(), "frame1"_a.none(), "five_tap"_a, "smoothness"_a)
        .def(
            "guess",
            [](Multigrid &self, nb::handle flow) {
                const Array<const float, 3> start(flow, "flow");
                start.expect({self.height(), self.width(), 2});
                Unlocked unlocked;
                self.guess(start.data());
            },
            "flow"_a.none())
        .def("full", &Multigrid::full, nb::call_guard<Unlocked>())
        .def(
            "sweep",
            [](Multigrid &self, Index count, float relax, float quarter_square) {
                expect(count >= 2 && count % 2 == 0, "expected an even count >= 2, got " + std::to_string(count));
                Unlocked unlocked;
                return std::sqrt(self.sweep(count, {relax, quarter_square}));
            },
            "count"_a, "relax"_a, "quarter_square"_a)
        .def("correct", &Multigrid::correct, nb::call_guard<Unlocked>())
        .def(
            "store",
            [](const Multigrid &self, nb::handle flow) {
                const Array<float, 3> result(flow, "flow");
                result.expect({self.height(), self.width(), 2});
                Unlocked unlocked;
                self.store(result.data());
            },
            "flow"_a.none());
}

using Weights = std::array<float, 3>;

Taps taps(const Weights &weights) { return {weights[0], weights[1], weights[2]}; }

Refinement refinement(float smoothness, bool five_tap, Index warps, Index sweeps, int median, float outlier,
                      float relax, float quarter_square, bool exposure) {
    expect(warps >= 1, "expected warps >= 1, got " + std::to_string(warps));
    expect(sweeps >= 1, "expected sweeps >= 1, got " + std::to_string(sweeps));
    expect(median == 1 || median == 3 || median == 5, "expected median 1, 3 or 5, got " + std::to_string(median));
    return {smoothness, five_tap, warps, sweeps, median, outlier, {relax, quarter_square}, exposure};
}

// The frames of a pyramid, from the finest level to the coarsest.
void bind_frames(nb::module_ &module) {
    module.def(
        "load_frames",
        [](nb::handle frame0, nb::handle frame1, nb::handle guess, const Weights &blur, const OwnedPlanes &frames,
           const OwnedPlanes &scratch) {
            const FramePair pair(frame0, frame1);
            const bool guessed = !guess.is_none();
            const Planes &out = checked(frames, "frames", guessed ? 4 : 2, pair.height(), pair.width());
            const Planes &room = checked(scratch, "scratch", scratch.count(), pair.height(), pair.width());
            std::optional<Array<const float, 3>> start;
            if (guessed) {
                start.emplace(guess, "guess");
                start->expect({pair.height(), pair.width(), 2});
            }
            Unlocked unlocked;
            load_frames(pair.frames(), start ? start->data() : nullptr, taps(blur), out, plane(room, 0));
        },
        "frame0"_a.none(), "frame1"_a.none(), "guess"_a.none(), "blur"_a, "frames"_a, "scratch"_a);
    module.def(
        "reduce_frames",
        [](const OwnedPlanes &fine, const Weights &blur, const OwnedPlanes &out) {
            checked_frames(fine, "fine");
            checked(out, "out", fine.count(), out.height(), out.width());
            Unlocked unlocked;
            reduce_frames(fine.planes(), taps(blur), out.planes());
        },
        "fine"_a, "blur"_a, "out"_a);
}

// The flow from one level to the next.
void bind_levels(nb::module_ &module) {
    module.def(
        "begin_flow",
        [](const OwnedPlanes &frames, const OwnedPlanes &flow) {
            const Planes &start = checked_frames(frames, "frames");
            const Planes &out = checked(flow, "flow", 2, frames.height(), frames.width());
            Unlocked unlocked;
            begin_flow(start, out);
        },
        "frames"_a, "flow"_a);
    module.def(
        "expand_flow",
        [](const OwnedPlanes &coarse_frames, const OwnedPlanes &coarse_flow, const OwnedPlanes &frames,
           const OwnedPlanes &flow) {
            const Planes &start = checked_frames(frames, "frames");
            const Planes &out = checked(flow, "flow", 2, frames.height(), frames.width());
            const Index h = coarse_frames.height(), w = coarse_frames.width();
            checked(coarse_frames, "coarse_frames", frames.count(), h, w);
            checked(coarse_flow, "coarse_flow", 2, h, w);
            Unlocked unlocked;
            expand_flow(coarse_frames.planes(), coarse_flow.planes(), start, out);
        },
        "coarse_frames"_a, "coarse_flow"_a, "frames"_a, "flow"_a);
    module.def(
        "store_flow",
        [](const OwnedPlanes &flow, nb::handle out) {
            const Array<float, 3> result(out, "out");
            result.expect({flow.height(), flow.width(), 2});
            const Planes &planes = checked(flow, "flow", 2, flow.height(), flow.width());
            Unlocked unlocked;
            store_flow(planes, result.data());
        },
        "flow"_a, "out"_a.none());
}

// The flow of one level.
void bind_refinement(nb::module_ &module) {
    nb::class_<Refinement>(module, "Refinement")
        .def(
            "__init__",
            [](Refinement *self, float smoothness, bool five_tap, Index warps, Index sweeps, int median, float outlier,
               float relax, float quarter_square, bool exposure) {
                new (self) Refinement(
                    refinement(smoothness, five_tap, warps, sweeps, median, outlier, relax, quarter_square, exposure));
            },
            nb::kw_only(), "smoothness"_a, "five_tap"_a, "warps"_a, "sweeps"_a, "median"_a, "outlier"_a, "relax"_a,
            "quarter_square"_a, "exposure"_a);
    module.def(
        "refine",
        [](const OwnedPlanes &frames, const OwnedPlanes &flow, const Refinement &how,
           std::optional<std::pair<float, float>> exposure, const OwnedPlanes &scratch) {
            const Planes &images = checked_frames(frames, "frames");
            const Planes &result = checked(flow, "flow", 2, frames.height(), frames.width());
            const Planes &room = checked(scratch, "scratch", REFINE_PLANES, frames.height(), frames.width());
            const Exposure known = exposure ? Exposure{exposure->first, exposure->second} : Exposure{};
            Unlocked unlocked;
            const Exposure found = refine(images, result, how, exposure ? &known : nullptr, room);
            return std::pair(found.gain, found.offset);
        },
        "frames"_a, "flow"_a, "how"_a, "exposure"_a.none(), "scratch"_a);
    module.def(
        "warp",
        [](const OwnedPlanes &frames, const OwnedPlanes &flow, const OwnedPlanes &out) {
            const Planes &images = checked_frames(frames, "frames");
            const Planes &displacement = checked(flow, "flow", 2, frames.height(), frames.width());
            const Planes &result = checked(out, "out", 2, frames.height(), frames.width());
            Unlocked unlocked;
            level().warping.warp(plane(images, 1), pair(displacement, 0), plane(result, 0), plane(result, 1));
        },
        "frames"_a, "flow"_a, "out"_a);
    module.def(
        "median",
        [](const OwnedPlanes &flow, const OwnedPlanes &out, int side) {
            expect(side == 3 || side == 5, "expected side 3 or 5, got " + std::to_string(side));
            const Planes &result = checked(out, "out", flow.count(), flow.height(), flow.width());
            Unlocked unlocked;
            for (Index i = 0; i < flow.count(); ++i) level().warping.median(flow[i], plane(result, i), side);
        },
        "flow"_a, "out"_a, "side"_a);
}

} // namespace
} // namespace hs

NB_MODULE(kernels, module) {
    using namespace hs;
#ifdef NDEBUG
    // A daemon thread of the user's keeps what its globals hold beyond the end of Python: no error of this module.
    nb::set_leak_warnings(false);
#endif
    const std::vector<std::string> names = level_names();
    if (names.empty()) throw nb::import_error("hs_tracker_cv needs an x86-64 processor with SSE4.2 (x86-64-v2)");
    use_level(names.back());
    module.def("level", [] { return level().name; });
    module.def("levels", &level_names);
    module.def("use_level", &use_level, "name"_a);
    bind_planes(module);
    bind_system(module);
    bind_multigrid(module);
    bind_frames(module);
    bind_levels(module);
    bind_refinement(module);
    bind_overview(module);
    bind_finder(module);
    bind_patch_tracker(module);
    bind_segmentation(module);
}
