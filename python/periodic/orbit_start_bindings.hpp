#pragma once

#include <vector>

#include <pybind11/pybind11.h>
#include <Eigen/Core>

#include "models/system/system.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

namespace orbid::python {

/// The start of an orbit given in Python: points (p, n), or one state from which the flow continues.
/// @param period  None, the number of points, or (autonomous models without a section) the duration [s].
/// @throws ValueError when the two do not fit, or the flow cannot be followed that far.
[[nodiscard]] periodic::StartingSolution orbit_start(const models::System& system, const Eigen::VectorXd& theta,
                                                     const pybind11::object& guess, const pybind11::object& period,
                                                     const pybind11::object& section, double phase,
                                                     const std::vector<int>& rotation, const models::FlowOptions& flow);

}  // namespace orbid::python
