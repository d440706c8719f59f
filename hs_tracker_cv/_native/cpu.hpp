// Which instructions this processor has.
#pragma once

namespace hs {

// 0: less than x86-64-v2; 2, 3, 4: that level of x86-64; 1: another family.
int cpu_level();

} // namespace hs
