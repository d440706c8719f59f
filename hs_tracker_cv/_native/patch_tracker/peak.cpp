#include "peak.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>

namespace hs {
namespace {

using Complex = std::complex<double>;

constexpr double TURN = 2.0 * 3.14159265358979323846 / CELLS;
constexpr int STEPS = 5;
constexpr std::ptrdiff_t AWAY = 4; // cells from the peak

// exp(i angle) of a small angle: the C library's differs between machines.
Complex direction(double angle) {
    const double s = angle * angle;
    return {1.0 - s / 2 * (1.0 - s / 12 * (1.0 - s / 30 * (1.0 - s / 56))),
            angle * (1.0 - s / 6 * (1.0 - s / 20 * (1.0 - s / 42 * (1.0 - s / 72))))};
}

// Value, gradient and second derivatives at a point.
struct Jet {
    double value, x, y, xx, xy, yy;
};

// The response is a trigonometric polynomial, so that it is known between its samples too.
Jet evaluate(const float *spectra, int which, double px, double py) {
    Complex across[HALF], along[CELLS];
    Complex unit_x = direction(TURN * px / 64), unit_y = direction(TURN * py / 64);
    for (int k = 0; k < 6; ++k) unit_x *= unit_x, unit_y *= unit_y;
    across[0] = along[0] = 1.0;
    for (std::ptrdiff_t k = 1; k < HALF; ++k) across[k] = across[k - 1] * unit_x;
    for (std::ptrdiff_t k = 1; k <= CELLS / 2; ++k) {
        along[k] = along[k - 1] * unit_y;
        along[CELLS - k] = std::conj(along[k]);
    }
    Jet jet{};
    for (std::ptrdiff_t y = 0; y < CELLS; ++y) {
        Complex row = 0.0, slope = 0.0, curve = 0.0;
        for (std::ptrdiff_t x = 0; x < HALF; ++x) {
            const float *at = spectra + (y * HALF + x) * 4 + which;
            const Complex term = Complex(at[0], at[2]) * across[x] * (x > 0 && x < CELLS / 2 ? 2.0 : 1.0);
            const double w = TURN * x;
            row += term;
            slope += Complex(-w * term.imag(), w * term.real());
            curve -= w * w * term;
        }
        const double w = TURN * (y <= CELLS / 2 ? y : y - CELLS);
        row *= along[y], slope *= along[y], curve *= along[y];
        jet.value += row.real();
        jet.x += slope.real();
        jet.xx += curve.real();
        jet.y -= w * row.imag();
        jet.xy -= w * slope.imag();
        jet.yy -= w * w * row.real();
    }
    constexpr double SHARE = 1.0 / (CELLS * CELLS);
    return {jet.value * SHARE, jet.x * SHARE, jet.y * SHARE, jet.xx * SHARE, jet.xy * SHARE, jet.yy * SHARE};
}

} // namespace

Circle circle() {
    Circle circle;
    for (std::ptrdiff_t k = 0; k < CELLS; ++k) {
        circle.turn[2 * k] = static_cast<float>(std::cos(TURN * k));
        circle.turn[2 * k + 1] = static_cast<float>(-std::sin(TURN * k));
    }
    return circle;
}

Peak find_peak(const float *responses, const float *spectra, const Fade &fade, float *centred) {
    constexpr std::ptrdiff_t MIDDLE = CELLS / 2;
    std::ptrdiff_t row = 0, column = 0;
    double best = -std::numeric_limits<double>::infinity();
    for (std::ptrdiff_t i = 0; i < CELLS; ++i)
        for (std::ptrdiff_t j = 0; j < CELLS; ++j) {
            const float response = responses[2 * ((i + MIDDLE) % CELLS * CELLS + (j + MIDDLE) % CELLS)];
            centred[i * CELLS + j] = response;
            const double x = fade.right + (j - MIDDLE) * fade.across, y = fade.down + (i - MIDDLE) * fade.along;
            const double value = response - fade.weight * (x * x + y * y);
            if (value > best) best = value, row = i, column = j;
        }
    Peak peak{};
    double second = -std::numeric_limits<double>::infinity(), sum = 0.0, square = 0.0;
    std::ptrdiff_t count = 0;
    for (std::ptrdiff_t i = 0; i < CELLS; ++i)
        for (std::ptrdiff_t j = 0; j < CELLS; ++j) {
            if (std::abs(i - row) <= AWAY && std::abs(j - column) <= AWAY) continue;
            const double response = centred[i * CELLS + j];
            second = std::max(second, response);
            sum += response;
            square += response * response;
            ++count;
        }
    peak.second = second;
    peak.mean = sum / count;
    peak.deviation = std::sqrt(std::max(square / count - peak.mean * peak.mean, 0.0));
    const double start_x = static_cast<double>(column - MIDDLE), start_y = static_cast<double>(row - MIDDLE);
    double x = start_x, y = start_y;
    Jet jet = evaluate(spectra, 0, x, y);
    for (int k = 0; k < STEPS; ++k) {
        const double determinant = jet.xx * jet.yy - jet.xy * jet.xy;
        if (!(determinant > 0.0 && jet.xx < 0.0)) break; // no top is near
        const double next_x = x + std::clamp(-(jet.yy * jet.x - jet.xy * jet.y) / determinant, -0.5, 0.5);
        const double next_y = y + std::clamp(-(jet.xx * jet.y - jet.xy * jet.x) / determinant, -0.5, 0.5);
        const Jet next = evaluate(spectra, 0, next_x, next_y);
        if (!(next.value >= jet.value) || std::abs(next_x - start_x) > 1.0 || std::abs(next_y - start_y) > 1.0) break;
        const bool settled = std::abs(next_x - x) + std::abs(next_y - y) < 1e-3;
        x = next_x, y = next_y, jet = next;
        if (settled) break;
    }
    peak.dx = x;
    peak.dy = y;
    peak.height = jet.value;
    peak.value = best + jet.value - centred[row * CELLS + column];
    peak.witness = evaluate(spectra, 1, x, y).value;
    return peak;
}

} // namespace hs
