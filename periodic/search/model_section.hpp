#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

namespace orbid::periodic {

/// The section in which orbits of one model at one theta are counted: one point per period of the forcing at a phase,
/// per iteration, or per crossing of a plane.
struct ModelSection {
    const models::System& system;
    const VectorXd& theta;
    double phase = 0.0;                      ///< [rad] (forced models)
    std::optional<models::Section> section;  ///< autonomous flows
    double longest = 0.0;                    ///< [s] allowed for a return (autonomous flows)

    /// Points of a guess on it.
    [[nodiscard]] StartingSolution start(MatrixXd points) const { return {std::move(points), {}, phase, section, 0.0}; }
};

/// Points of a section along the model's own trajectories, from random states.
struct SectionPieces {
    std::vector<MatrixXd> pieces;  ///< shape (n, m) each: successive sections, transients included
    VectorXd lowest;               ///< shape (n): of the central 99.8 % of the points; angles: -pi
    VectorXd size;             ///< shape (n), > 0: their extent; angles: 2 pi; a constant one: the largest value of all
    std::size_t captured = 0;  ///< trajectories that ended in a stable orbit or at rest
    std::size_t lost = 0;      ///< that could not be continued
};

struct SectionPiecesOptions {
    std::size_t points = 1U << 18U;  ///< of long trajectories, > 0; forced models and maps: as many single steps
    std::size_t trajectories = 256;  ///< at a time, > 0
    std::uint64_t seed = 1;
    MatrixXd initial{};  ///< shape (n, m): states from which the first trajectories begin; may be empty
    models::FlowOptions flow{};
};

/// [s] 100 times the median of a few returns from random states: longer returns count as standstill. 1 unless
/// autonomous.
[[nodiscard]] double longest_return(const models::System& system, const VectorXd& theta,
                                    const std::optional<models::Section>& section, std::uint64_t seed,
                                    const models::FlowOptions& flow);

/// Half the range of random states, shape (n): pi for angles. Otherwise the largest absolute value that trajectories
/// from within one unit reach, as far as they can be followed.
[[nodiscard]] VectorXd start_range(const ModelSection& section, std::uint64_t seed, const models::FlowOptions& flow);

/// Trajectories from states that are uniform within start_range(). One that settles on a stable orbit or cannot be
/// continued is replaced by another, but its points are kept. (Settled: 64 sections repeat after p <= 32 within 1e-9 of
/// the size.) For forced models and maps they are followed by single steps from states that are uniform over the extent
/// of these trajectories and half as far around it. The same bytes with any number of threads.
[[nodiscard]] SectionPieces simulate_pieces(const ModelSection& section, const SectionPiecesOptions& options);

/// State number `index` of a stream of uniform random states within +-range. Shape (n).
[[nodiscard]] VectorXd random_state(const VectorXd& range, std::uint64_t seed, std::uint64_t index);

}  // namespace orbid::periodic
