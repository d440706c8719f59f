#include "overview.hpp"

#include "median.hpp"
#include "planes.hpp"
#include "views.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace hs {
namespace {

using Unlocked = nb::gil_scoped_release;

// Samples of a frame, and one of so many of them across and down that tells the deviation.
template <class T> struct Samples {
    const T *data;
    Index height, width, channels, thinned;
};

// A side that is divided into cells.
struct Side {
    Index length, cells;

    double edge(Index cell) const { return static_cast<double>(cell * length) / static_cast<double>(cells); }
    Index first(Index cell) const { return cell * length / cells; }
    Index last(Index cell) const { return ((cell + 1) * length + cells - 1) / cells; } // exclusive
    // How much of a sample lies in a cell.
    double cover(Index cell, Index sample) const {
        const auto at = static_cast<double>(sample);
        return std::min(at + 1.0, edge(cell + 1)) - std::max(at, edge(cell));
    }
    double area() const { return static_cast<double>(length) / static_cast<double>(cells); }
};

// Means (down.cells, across.cells, channels) over cells; add(y, weight, sums) adds a row of samples to sums.
template <class Sum, class Add>
std::vector<double> means(const Side &down, const Side &across, Index channels, const Add &add) {
    std::vector<double> out(down.cells * across.cells * channels), covers;
    for (Index j = 0; j < across.cells; ++j)
        for (Index x = across.first(j); x < across.last(j); ++x) covers.push_back(across.cover(j, x));
    std::vector<Sum> sums(across.length * channels);
    const double share = 1.0 / (down.area() * across.area());
    double *result = out.data();
    for (Index i = 0; i < down.cells; ++i) {
        std::fill(sums.begin(), sums.end(), Sum(0));
        for (Index y = down.first(i); y < down.last(i); ++y) add(y, static_cast<Sum>(down.cover(i, y)), sums.data());
        const double *cover = covers.data();
        for (Index j = 0; j < across.cells; ++j, result += channels) {
            const Sum *sum = sums.data() + across.first(j) * channels;
            for (Index x = across.first(j); x < across.last(j); ++x, ++cover, sum += channels)
                for (Index c = 0; c < channels; ++c) result[c] += *cover * sum[c];
            for (Index c = 0; c < channels; ++c) result[c] *= share;
        }
    }
    return out;
}

template <class T> void thumbnail(const Samples<T> &in, Index rows, Index columns, float *gray) {
    const Index length = in.width * in.channels;
    const auto add = [&](Index y, float weight, float *HS_RESTRICT sums) {
        const T *HS_RESTRICT row = in.data + y * length;
        for (Index i = 0; i < length; ++i) sums[i] += weight * static_cast<float>(row[i]);
    };
    const std::vector<double> mean = means<float>({in.height, rows}, {in.width, columns}, in.channels, add);
    for (Index i = 0; i < rows * columns; ++i) {
        double sum = 0.0;
        for (Index c = 0; c < in.channels; ++c) sum += mean[i * in.channels + c];
        gray[i] = static_cast<float>(sum / static_cast<double>(in.channels));
    }
}

template <class T> void deviations(const Samples<T> &in, Index rows, Index columns, float *out) {
    const Index n = in.thinned, height = (in.height + n - 1) / n, width = (in.width + n - 1) / n;
    const auto add = [&](Index y, double weight, double *sums) {
        const T *row = in.data + n * y * in.width * in.channels;
        for (Index x = 0; x < width; ++x) {
            const auto value = static_cast<double>(row[n * x * in.channels]);
            sums[2 * x] += weight * value;
            sums[2 * x + 1] += weight * value * value;
        }
    };
    const std::vector<double> mean = means<double>({height, rows}, {width, columns}, 2, add);
    for (Index i = 0; i < rows * columns; ++i)
        out[i] = static_cast<float>(std::sqrt(std::max(mean[2 * i + 1] - mean[2 * i] * mean[2 * i], 0.0)));
}

template <class T> void fill_overview(const Array<const T, 3> &pixels, Index thinned, const Array<float, 3> &out) {
    const Samples<T> samples{pixels.data(), pixels.size(0), pixels.size(1), pixels.size(2), thinned};
    const Index rows = out.size(1), columns = out.size(2);
    Unlocked unlocked;
    thumbnail(samples, rows, columns, out.data());
    deviations(samples, rows, columns, out.data() + rows * columns);
}

bool has_bytes(nb::handle array) {
    Py_buffer view;
    if (PyObject_GetBuffer(array.ptr(), &view, PyBUF_STRIDES | PyBUF_FORMAT)) {
        PyErr_Clear();
        return false;
    }
    const bool bytes = type_name(view.format, view.itemsize) == "uint8";
    PyBuffer_Release(&view);
    return bytes;
}

void expect_pixels(const Buffer &samples, const Buffer &out, Index thinned) {
    if (samples.size(0) < 1 || samples.size(1) < 1 || samples.size(2) < 1)
        throw nb::value_error("expected samples to have pixels");
    out.expect({2, -1, -1});
    if (thinned < 1) throw nb::value_error(("expected thinned >= 1, got " + std::to_string(thinned)).c_str());
}

void overview(nb::handle samples, Index thinned, nb::handle out) {
    const Array<float, 3> result(out, "out");
    if (has_bytes(samples)) {
        const Array<const std::uint8_t, 3> pixels(samples, "samples");
        expect_pixels(pixels, result, thinned);
        fill_overview(pixels, thinned, result);
    } else {
        const Array<const float, 3> pixels(samples, "samples");
        expect_pixels(pixels, result, thinned);
        fill_overview(pixels, thinned, result);
    }
}

std::vector<float> numbers(nb::handle plane) {
    const Array<const float, 2> in(plane, "plane");
    const Index count = in.size(0) * in.size(1);
    if (count < 1) throw nb::value_error("expected plane to have numbers");
    return {in.data(), in.data() + count};
}

float median_of(nb::handle plane) {
    std::vector<float> values = numbers(plane);
    return median(values);
}

double deviation_of(nb::handle plane) {
    const std::vector<float> values = numbers(plane);
    const auto count = static_cast<double>(values.size());
    double sum = 0.0, squares = 0.0;
    for (const float value : values) sum += value;
    for (const float value : values) squares += (value - sum / count) * (value - sum / count);
    return std::sqrt(squares / count);
}

} // namespace

void bind_overview(nb::module_ &module) {
    module.def("overview", &overview, "samples"_a.none(), "thinned"_a, "out"_a.none());
    module.def("median_of", &median_of, "plane"_a.none());
    module.def("deviation_of", &deviation_of, "plane"_a.none());
}

} // namespace hs
