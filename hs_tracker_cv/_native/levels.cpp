#include "levels.hpp"

#include "cpu.hpp"

#include <atomic>
#include <stdexcept>

namespace hs {
namespace {

const Level LEVELS[] = {
#ifdef HS_X86
    {"v2", 2, sweeps_v2, warping_v2, grids_v2, finder_v2, patches_v2, motion_fit_v2, persistence_v2, segmentation_v2},
    {"v3", 3, sweeps_v3, warping_v3, grids_v3, finder_v3, patches_v3, motion_fit_v3, persistence_v3, segmentation_v3},
    {"v4", 4, sweeps_v4, warping_v4, grids_v4, finder_v4, patches_v4, motion_fit_v4, persistence_v4, segmentation_v4},
#else
    {"plain", 1, sweeps_plain, warping_plain, grids_plain, finder_plain, patches_plain, motion_fit_plain,
     persistence_plain, segmentation_plain},
#endif
};

std::atomic<const Level *> in_use;

} // namespace

std::vector<std::string> level_names() {
    std::vector<std::string> names;
    for (const Level &each : LEVELS)
        if (each.needs <= cpu_level()) names.emplace_back(each.name);
    return names;
}

const Level &level() { return *in_use.load(std::memory_order_relaxed); }

void use_level(const std::string &name) {
    std::string known;
    for (const Level &each : LEVELS) {
        if (each.needs > cpu_level()) continue;
        if (each.name == name) {
            in_use = &each;
            return;
        }
        known += (known.empty() ? "" : ", ") + std::string(each.name);
    }
    throw std::invalid_argument("expected one of " + known + ", got '" + name + "'");
}

} // namespace hs
