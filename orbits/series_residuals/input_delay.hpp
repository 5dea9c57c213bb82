#pragma once

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// The time between a measured input and its effect as a parameter of the model that its equations do not contain: the
/// model reads u(t - delay).
///
/// A later input is an earlier clock: x(t; delay) is the flow over the recorded signal from phase t_0 - delay. Its
/// derivative needs none of the signal,
///
///     d x(t) / d delay = -[f(x(t)) - X f(x(t_0))],    X = d x(t) / d x(t_0),
///
/// and is continuous where the signal is.
struct InputDelay {
    Eigen::Index parameter = 0;  ///< index into System::parameters(); [s]
    double lower = 0.0;          ///< the least and largest value: the signal must cover what is read with them
    double upper = 0.0;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
