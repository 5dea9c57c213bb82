#pragma once

#include <memory>
#include <string>

#include "models/system/kernel.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// Why flows of this system cannot be left to Boost.Odeint, whatever the parameters: a map, stiff equations, measured
/// inputs. Empty: they can, at parameters at which the equations are smooth.
[[nodiscard]] std::string odeint_refusal(const System& system);

/// The same model with its flows, sections and ensembles computed by Boost.Odeint (a dense-output stepper of Dormand
/// and Prince's pair of the orders 5 and 4), derivatives by the variational equations, second ones too: an independent
/// way to the same numbers, for comparison. Values agree with those of the library's own steppers to the tolerance.
///
/// Every flow also carries derivatives by the n coordinates of its start, n^2 numbers: meant for up to some tens of
/// coordinates. A flow at parameters at which the equations jump, or with derivatives by one that makes them
/// jump as soon as it is not 0, ends at once with FlowStatus::not_smooth.
///
/// @throws std::invalid_argument with odeint_refusal()
[[nodiscard]] std::shared_ptr<const System> odeint_system(const System& system);

/// The system that odeint_system() was given, as far as its flows are concerned; nullptr where the flows of `system`
/// are not Odeint's.
[[nodiscard]] std::shared_ptr<const System> system_without_odeint(const System& system);

}  // namespace orbid::models

#pragma GCC visibility pop
