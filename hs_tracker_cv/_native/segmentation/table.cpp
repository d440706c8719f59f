// The kernels of a level.
#include "colour.hpp"
#include "evidence.hpp"
#include "kernels.hpp"
#include "labelling.hpp"
#include "memory.hpp"
#include "motion.hpp"
#include "registration.hpp"
#include "shapes.hpp"
#include "windows.hpp"

namespace hs {

extern const SegmentationKernels HS_JOIN(segmentation, HS_LEVEL) = {
    HS_LEVEL::without,     HS_LEVEL::invert,      HS_LEVEL::median,     HS_LEVEL::spread,
    HS_LEVEL::widen,       HS_LEVEL::widen_cross, HS_LEVEL::components, HS_LEVEL::bin_colours,
    HS_LEVEL::likelihood,  HS_LEVEL::blend,       HS_LEVEL::smooth,     HS_LEVEL::shift,
    HS_LEVEL::move_ground, HS_LEVEL::resample,    HS_LEVEL::carry,      HS_LEVEL::without_object,
    HS_LEVEL::evidence,    HS_LEVEL::collect,     HS_LEVEL::residual,   HS_LEVEL::gauss_newton,
    HS_LEVEL::start_flow,  HS_LEVEL::predict,     HS_LEVEL::measure,    HS_LEVEL::search_shift,
    HS_LEVEL::label,       HS_LEVEL::learn,
};

} // namespace hs
