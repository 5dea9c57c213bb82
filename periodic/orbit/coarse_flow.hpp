#pragma once

#include <algorithm>

#include "models/system/system.hpp"

namespace orbid::periodic {

/// A flow that needs no smaller errors than these: it only leads to starts.
[[nodiscard]] inline models::FlowOptions coarsened(models::FlowOptions flow, double tolerance) {
    flow.relative_tolerance = std::max(flow.relative_tolerance, tolerance);
    flow.absolute_tolerance = std::max(flow.absolute_tolerance, tolerance);
    return flow;
}

}  // namespace orbid::periodic
