#pragma once

#include <vector>

#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/solution/orbit_problem.hpp"

namespace orbid::periodic {

/// A mesh brought close to the intended orbit.
struct FarStartSearch {
    ShootingMesh mesh;          ///< nodes and time of the approach, or the ones given where there is nothing better
    bool closed = false;        ///< the nodes close but for a small step of Newton's method
    std::vector<int> rotation;  ///< turns per angle of the whole orbit; empty where the flow of the guess ends early
    int iterations = 0;         ///< steps of Newton's method taken
};

/// First steps towards an orbit, with a coarse flow (1e-6). They choose the whole turns and iterate. Where the first
/// step of Newton's method does not contract, they look for the orbit nearest to the guess instead (corrected_guess()).
/// The accurate computation that follows then starts from the right place.
///
/// @param mesh  through the points of the problem's start.
[[nodiscard]] FarStartSearch improve_guess(const OrbitProblem& problem, const ShootingMesh& mesh);

}  // namespace orbid::periodic
