#include "multigrid.hpp"

#include "levels.hpp"

#include <algorithm>

namespace hs {
namespace {

constexpr Index COARSEST = 4; // shortest side of the coarsest grid, px
constexpr int COARSEST_SWEEPS = 8;

void prolong(const Pair &coarse, const Pair &fine, float keep) {
    level().grids.prolong(coarse.u, fine.u, keep);
    level().grids.prolong(coarse.v, fine.v, keep);
}

} // namespace

Multigrid::Multigrid(Index height, Index width) : finest_(8, height, width) {
    while (std::min(height, width) > COARSEST) {
        height = (height + 1) / 2;
        width = (width + 1) / 2;
        coarse_.push_back({OwnedPlanes(9, height, width)});
    }
}

std::vector<std::pair<Index, Index>> Multigrid::sizes() const {
    std::vector<std::pair<Index, Index>> sizes{{height(), width()}};
    for (const Coarse &grid : coarse_) sizes.emplace_back(grid.planes.height(), grid.planes.width());
    return sizes;
}

double Multigrid::begin(const Frames &frames, bool five_tap, float lambda) {
    const Level &kernels = level();
    const Plane first = other().u, second = other().v, ratio = share();
    kernels.sweeps.load(frames.first, first);
    kernels.sweeps.load(frames.second, second);
    const double square = static_cast<double>(lambda) * lambda;
    const double total = kernels.sweeps.scale(first, second, five_tap, lambda, g(), &ratio) / (square * square);
    for (std::size_t i = 0; i < coarse_.size(); ++i) {
        if (i == 0) {
            kernels.grids.project(g(), ratio, coarse_[i].system());
            continue;
        }
        for (Index j = 0; j < 5; ++j) kernels.grids.restrict_plane(coarse_[i - 1].planes[j], coarse_[i].planes[j]);
    }
    return total;
}

void Multigrid::guess(const float *start) { level().sweeps.load_pair(start, flow()); }

void Multigrid::full() {
    if (coarse_.empty()) {
        clear(flow().u);
        clear(flow().v);
    }
    for (std::size_t i = coarse_.size(); i-- > 0;) {
        cycle(i, i + 1 < coarse_.size());
        prolong(coarse_[i].flow(), i ? coarse_[i - 1].flow() : flow(), 0.0f);
    }
}

double Multigrid::sweep(Index count, const Relaxation &relaxation) {
    const SweepKernels &kernels = level().sweeps;
    kernels.sweep(flow(), other(), g(), count - 1, relaxation);
    return kernels.measured_sweep(other(), flow(), g(), share());
}

void Multigrid::correct() {
    if (coarse_.empty()) return;
    level().sweeps.residual(flow(), other(), g(), share());
    restrict_to(0, other());
    cycle(0, false);
    prolong(coarse_[0].flow(), flow(), 1.0f);
}

void Multigrid::store(float *out) const { level().sweeps.store_pair(flow(), out); }

// One V(1, 1) cycle from grid `first` down to the coarsest one and back, from zero unless its flow is `guessed`.
void Multigrid::cycle(std::size_t first, bool guessed) {
    const GridKernels &kernels = level().grids;
    const std::size_t top = coarse_.size() - 1;
    for (std::size_t i = first; i < top; ++i) {
        const Coarse &grid = coarse_[i];
        const Pair start = grid.flow();
        kernels.sweep(guessed && i == first ? &start : nullptr, grid.other(), grid.system());
        kernels.residual(grid.other(), grid.flow(), grid.system());
        restrict_to(i + 1, grid.flow());
    }
    Pair now = coarse_[top].flow(), next = coarse_[top].other();
    for (int i = 0; i < COARSEST_SWEEPS; ++i) {
        kernels.sweep(i ? &now : nullptr, next, coarse_[top].system());
        std::swap(now, next);
    }
    for (std::size_t i = top; i-- > first;) {
        const Coarse &grid = coarse_[i];
        const Pair corrected = grid.other();
        prolong(coarse_[i + 1].flow(), corrected, 1.0f);
        kernels.sweep(&corrected, grid.flow(), grid.system());
    }
}

// Make a coarse grid's right-hand side of the next finer one's residual.
void Multigrid::restrict_to(std::size_t coarse, const Pair &residual) {
    const Pair right = coarse_[coarse].system().right;
    level().grids.restrict_plane(residual.u, right.u);
    level().grids.restrict_plane(residual.v, right.v);
}

} // namespace hs
