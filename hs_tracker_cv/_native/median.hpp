// The median of numbers. Not for files that are compiled for every level, see planes.hpp.
#pragma once

#include <algorithm>
#include <vector>

namespace hs {

// The mean of the two in the middle of an even count, as NumPy has it; of at least one number, in any order afterwards.
inline float median(std::vector<float> &values) {
    const auto middle = values.begin() + values.size() / 2;
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2) return *middle;
    return (*std::max_element(values.begin(), middle) + *middle) / 2.0f;
}

} // namespace hs
