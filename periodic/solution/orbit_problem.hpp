#pragma once

#include <span>
#include <string>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

/// Which orbit of which model is solved for, and to which parameters derivatives are wanted. Everything is kept by
/// reference.
struct OrbitProblem {
    const models::System& system;
    const VectorXd& theta;
    const StartingSolution& start;
    std::span<const Index> free;
    const ShootingOptions& options;

    [[nodiscard]] bool autonomous() const { return system.kind() == models::Kind::autonomous; }
    /// The start is one state and T, without a section.
    [[nodiscard]] bool without_section() const { return autonomous() && !start.section; }
    /// Typical size of each coordinate: of the options, or of the start.
    [[nodiscard]] VectorXd scale() const;
    /// What is known of the orbit before it is found.
    [[nodiscard]] PeriodicOrbit unsolved(OrbitStatus status) const;
};

/// @throws std::invalid_argument naming the option and its rule.
void validate(const OrbitProblem& problem);

/// For methods that need time derivatives. @throws std::invalid_argument for maps, naming the method.
void require_flow(const models::System& system, const std::string& method);
/// The same for models that are not smooth at theta.
void require_smooth(const OrbitProblem& problem, const std::string& method);

}  // namespace orbid::periodic
