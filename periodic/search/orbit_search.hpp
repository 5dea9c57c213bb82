#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/solver_options.hpp"
#include "periodic/search/symbolic_code.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// Where the start of an orbit came from.
enum class StartOrigin {
    recurrence,  ///< of the model's own trajectory
    joined,      ///< pieces of its trajectories, joined where they pass through the same cell
    symmetry,    ///< the mirror image of another orbit
    orbit,       ///< points of an orbit of another period, stabilised (Davidchack and Lai)
    code,        ///< a symbol sequence
    scattered    ///< random states, also off the attractor
};

[[nodiscard]] std::string_view name(StartOrigin origin);

struct OrbitSearchOptions {
    std::vector<int> periods{1};             ///< different, >= 1, in periods of the forcing, iterations, or crossings
    double phase = 0.0;                      ///< of the section [rad] (forced models)
    std::optional<models::Section> section;  ///< autonomous flows: needed
    std::uint64_t seed = 1;
    /// Of the section that are simulated, >= 100. For forced models and maps as many single steps follow, from states
    /// all over the section.
    std::size_t points = 1U << 17U;
    std::size_t trajectories = 256;  ///< at a time, >= 1; from random states
    Eigen::MatrixXd initial{};       ///< shape (n, m): states from which the first trajectories begin; may be empty
    bool symmetry = true;            ///< look for the mirror image of every orbit (models that declare a symmetry)
    /// As the last resort stabilised iterations from the orbits found, until a round of them finds nothing. Periods
    /// that are settled get a sample of them.
    bool stabilised = true;
    /// Recurrences up to this gap are tried, relative to the extent of the section, closest first; in (0, 0.5].
    double widest = 0.05;
    /// Starts in a row without a new orbit after which the rest of their kind is skipped, >= 1; at least a quarter of
    /// the starts so far.
    std::size_t patience = 2000;
    /// Loops of cells that are tried in one round at most, >= 1: it decides how small the cells are.
    std::size_t loops = 20000;
    /// Names the parts of the section, so that orbits get codes. Orbits of different code differ; whether those of one
    /// code are the same depends on the partition.
    std::optional<SymbolPartition> partition{};
    std::vector<std::string> codes{};     ///< words that are looked for besides (their lengths join `periods`)
    std::function<bool()> interrupted{};  ///< called between batches of starts; empty: never
    ShootingOptions solver{};
    /// Called after every batch of starts with those so far and the orbits found; empty: never.
    std::function<void(std::size_t starts, std::size_t orbits)> progress{};
};

/// A prime periodic orbit that was found.
struct FoundOrbit {
    PeriodicOrbit orbit;  ///< converged, points in the order that begins with the smallest first coordinate
    StartOrigin origin = StartOrigin::recurrence;
    int mirror = -1;       ///< index of its mirror image in the list, its own when symmetric, -1 when not known
    std::size_t hits = 1;  ///< starts that led to it
    std::string code{};    ///< of the points in their order; empty without a partition
};

struct OrbitSearch {
    /// For each period asked for, ascending: the last round of joined pieces, with cells of another size than before,
    /// found nothing new, and for forced models the sums of indices agree (index_sums()). False: there are probably
    /// more (longer periods: more `points`, more `loops`).
    std::vector<bool> settled;
    std::vector<FoundOrbit> orbits;  ///< by period, rotation, points; the same with any number of threads
    std::size_t starts = 0;          ///< that were solved
    std::size_t captured = 0;        ///< trajectories that ended in a stable orbit or at rest
    bool interrupted = false;        ///< a stop was requested: the orbits found until then
};

/// Prime periodic orbits of a model, of the periods asked for, found without data. Starts come from recurrences of its
/// own trajectories, from pieces of them joined to closed sequences of cells, from random states and from mirror
/// images. The last resort is stabilised iterations from the points of the known orbits.
///
/// @return never fails for numerical reasons: orbits that were not found are not in the list.
/// @throws std::invalid_argument naming the option and its rule; models::Stopped if the system asks for a stop
///         before starts are solved: its trajectories are no orbits yet. Later stops return the orbits found until
///         then.
[[nodiscard]] OrbitSearch search_orbits(const models::System& system, const Eigen::VectorXd& theta,
                                        const OrbitSearchOptions& options);

}  // namespace orbid::periodic

#pragma GCC visibility pop
