#pragma once

#include <vector>

#include "periodic/discretisation/discretisation.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/solution/orbit_problem.hpp"

namespace orbid::periodic {

/// The points at which an orbit is reported.
struct OrbitPoints {
    bool simulated = false;    ///< everything else is meaningful only if so
    MatrixXd states;           ///< shape (n, p), angles not wrapped
    VectorXd times;            ///< shape (p): since the first point [s]
    MatrixXd sensitivities;    ///< shape (n p, f); empty without free parameters
    std::vector<Index> nodes;  ///< node of each point; empty when some point is none
};

/// The points of a solved orbit at the given shares of it (empty: at all nodes). On a section of an autonomous flow all
/// but the first one are crossings near those shares.
///
/// @param sensitivities  of the nodes and ln T, from node_sensitivities(); empty: none wanted.
[[nodiscard]] OrbitPoints points_at(const OrbitProblem& problem, const Discretisation& discretisation,
                                    const MatrixXd& nodes, const MatrixXd& sensitivities,
                                    const std::vector<double>& shares, double time);

/// Products of the factors from each of these nodes to the next; empty for no nodes.
[[nodiscard]] std::vector<MatrixXd> merged_factors(const std::vector<MatrixXd>& factors,
                                                   const std::vector<Index>& nodes);

/// The same monodromy matrix from fewer factors. Those of short steps are multiplied as long as no direction can grow
/// or shrink by more than e^2. That costs a digit at most and makes the periodic Schur form cheaper.
[[nodiscard]] std::vector<MatrixXd> condensed_factors(const std::vector<MatrixXd>& factors);

}  // namespace orbid::periodic
