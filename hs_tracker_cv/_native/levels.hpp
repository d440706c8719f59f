// The level whose kernels are in use.
#pragma once

#include "grids.hpp"
#include "patch_tracker/finder.hpp"
#include "patch_tracker/motion_fit.hpp"
#include "patch_tracker/patches.hpp"
#include "patch_tracker/persistence.hpp"
#include "segmentation/kernels.hpp"
#include "sweeps.hpp"
#include "warping.hpp"

#include <string>
#include <vector>

namespace hs {

// The kernels of one level, by room.
struct Level {
    const char *name;
    int needs; // of cpu_level()
    const SweepKernels &sweeps;
    const WarpKernels &warping;
    const GridKernels &grids;
    const FinderKernels &finder;
    const PatchKernels &patches;
    const MotionFitKernels &motion_fit;
    const PersistenceKernels &persistence;
    const SegmentationKernels &segmentation;
};

// Names of those that this processor can run, the most capable last.
std::vector<std::string> level_names();

// The one in use: the most capable one, unless another was chosen.
const Level &level();

// Use another one from now on, in all threads; std::invalid_argument if there is none of that name.
void use_level(const std::string &name);

} // namespace hs
