// What Python sees: arguments are checked here, Python's lock is let go of, and the kernel of the level in use is called.
#include "cpu.hpp"
#include "flow.hpp"
#include "owned_planes.hpp"
#include "views.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <atomic>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

// The kernels of one level.
struct Level {
    const char *name;
    int needs; // of cpu_level()
    const FlowKernels &flow;
};

const Level LEVELS[] = {
#ifdef HS_X86
    {"v2", 2, flow_v2},
    {"v3", 3, flow_v3},
    {"v4", 4, flow_v4},
#else
    {"plain", 1, flow_plain},
#endif
};

std::atomic<const Level *> level_in_use;

const Level &in_use() { return *level_in_use.load(std::memory_order_relaxed); }

std::vector<std::string> level_names() {
    std::vector<std::string> names;
    for (const Level &level : LEVELS)
        if (level.needs <= cpu_level()) names.emplace_back(level.name);
    return names;
}

void use_level(const std::string &name) {
    for (const Level &level : LEVELS)
        if (level.needs <= cpu_level() && level.name == name) {
            level_in_use = &level;
            return;
        }
    std::string known;
    for (const std::string &each : level_names()) known += (known.empty() ? "" : ", ") + each;
    throw nb::value_error(("expected one of " + known + ", got '" + name + "'").c_str());
}

std::ptrdiff_t plane_index(const OwnedPlanes &planes, std::ptrdiff_t plane) {
    if (plane < 0 || plane >= planes.count())
        throw nb::index_error(("expected a plane from 0 to " + std::to_string(planes.count() - 1) + ", got " +
                               std::to_string(plane)).c_str());
    return plane;
}

// A plane without its ring, as an array that shares memory with it.
nb::ndarray<nb::numpy, float, nb::ndim<2>> pixels(nb::handle self, std::ptrdiff_t plane) {
    const OwnedPlanes &planes = nb::cast<const OwnedPlanes &>(self);
    const Planes &view = planes.view();
    const std::size_t shape[] = {static_cast<std::size_t>(view.height), static_cast<std::size_t>(view.width)};
    const std::int64_t strides[] = {view.stride, 1};
    return {row(view, plane_index(planes, plane), 0), 2, shape, self, strides};
}

void load(nb::handle image, const OwnedPlanes &planes, std::ptrdiff_t plane) {
    const Array<const float, 2> pixels(image, "image");
    const Planes &view = planes.view();
    pixels.expect({view.height, view.width});
    plane_index(planes, plane);
    nb::gil_scoped_release release;
    in_use().flow.load({pixels.data(), view.height, view.width}, view, plane);
}

} // namespace
} // namespace hs

NB_MODULE(kernels, module) {
    using namespace hs;
    const std::vector<std::string> names = level_names();
    if (names.empty()) throw nb::import_error("hs_tracker_cv needs an x86-64 processor with SSE4.2 (x86-64-v2)");
    use_level(names.back());
    module.def("level", [] { return in_use().name; });
    module.def("levels", &level_names);
    module.def("use_level", &use_level, "name"_a);

    nb::class_<OwnedPlanes>(module, "Planes")
        .def(nb::init<std::ptrdiff_t, std::ptrdiff_t, std::ptrdiff_t>(), "count"_a, "height"_a, "width"_a)
        .def("__len__", &OwnedPlanes::count)
        .def("__getitem__", &pixels, "plane"_a);
    module.def("load", &load, "image"_a.none(), "planes"_a, "plane"_a);
}
