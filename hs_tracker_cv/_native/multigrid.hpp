// The paper's linear system on grids of halved sizes: the parts of its solution.
#pragma once

#include "flow.hpp"
#include "grids.hpp"

#include <vector>

namespace hs {

// The finest grid has two pairs of planes for the flow, g = F / √D and D / λ²; each coarse one its system and two
// pairs. Sums are those of the squared residual over λ².
class Multigrid {
  public:
    Multigrid(Index height, Index width);

    Index height() const { return finest_.height(); }
    Index width() const { return finest_.width(); }
    std::vector<std::pair<Index, Index>> sizes() const;

    // Make the systems of all grids; the sum of the squared right-hand side.
    double begin(const Frames &frames, bool five_tap, float lambda);
    // Take a first guess of the flow, or make one by full multigrid: from the coarsest grid up, a V cycle on each.
    void guess(const float *flow);
    void full();
    // Sweep the finest grid an even number of times; the sum before the last one.
    double sweep(Index count, const Relaxation &relaxation);
    // Correct the flow by a V cycle of the coarse grids.
    void correct();
    void store(float *flow) const;

  private:
    struct Coarse {
        OwnedPlanes planes;
        CoarseSystem system() const { return coarse_system(planes.planes(), 0); }
        Pair flow() const { return pair(planes.planes(), 5); }
        Pair other() const { return pair(planes.planes(), 7); }
    };

    Pair flow() const { return pair(finest_.planes(), 0); }
    Pair other() const { return pair(finest_.planes(), 2); }
    Slopes g() const { return slopes(finest_.planes(), 4); }
    Plane share() const { return finest_[7]; }

    void cycle(std::size_t first, bool guessed);
    void restrict_to(std::size_t coarse, const Pair &residual);

    OwnedPlanes finest_;
    std::vector<Coarse> coarse_; // the finest of them first
};

} // namespace hs
