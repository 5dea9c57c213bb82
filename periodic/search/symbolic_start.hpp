#pragma once

#include <string>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/solver_options.hpp"
#include "periodic/search/model_section.hpp"
#include "periodic/search/symbolic_code.hpp"

namespace orbid::periodic {

/// An orbit that was sought by its code.
struct CodedOrbit {
    bool found = false;   ///< `orbit` converged, is prime and has the code asked for
    PeriodicOrbit orbit;  ///< of the last try where none was found
    std::string code;     ///< of what was solved last; empty when nothing converged
    /// Symbols ahead that the trajectory shared with the word at its worst point. If fewer than the word has, it
    /// probably does not occur (is pruned), or `pieces` are too short.
    int agreement = 0;
};

/// Starts from symbol sequences. For each point of the word the model's own trajectories are searched for the point
/// whose itinerary agrees longest with the periodic word, ahead and behind. If the partition generates, the distance to
/// the orbit shrinks with every symbol ahead by the expansion and with every symbol behind by the contraction.
/// Otherwise several orbits may share a code, and the one nearest to the simulated trajectories is found.
class SymbolicStarts {
public:
    /// @param pieces  outlive this object.
    /// @throws std::invalid_argument on a wrong partition.
    SymbolicStarts(const ModelSection& section, const SectionPieces& pieces, SymbolPartition partition);

    /// The match number `rank` of every point (0: the best). Shape (n, p). @param agreement  see above.
    [[nodiscard]] MatrixXd start(const std::string& word, std::size_t rank, int& agreement) const;

    /// Tries the best matches, then the next ones, up to `tries`, by multiple shooting.
    /// @throws std::invalid_argument on a word that is empty, repeats a shorter one, or has unknown symbols.
    [[nodiscard]] CodedOrbit solve(const std::string& word, const ShootingOptions& options,
                                   std::size_t tries = 8) const;

private:
    const ModelSection& section_;
    const SectionPieces& pieces_;
    SymbolPartition partition_;
    std::vector<std::string> itineraries_;  ///< of the pieces
};

}  // namespace orbid::periodic
