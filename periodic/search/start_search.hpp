#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"
#include "periodic/search/orbit_list.hpp"
#include "periodic/search/orbit_search.hpp"
#include "periodic/search/stabilised_start.hpp"

namespace orbid::periodic {

/// Accuracy of the flow while a start is closed: orbits are distinguished to 1e-6.
inline constexpr double search_tolerance = 1e-8;

/// Starts of every origin, solved in batches, and the resulting list of orbits. Parallel within a batch; the same with
/// any number of threads.
class StartSearch {
public:
    StartSearch(const ModelSection& section, const OrbitSearchOptions& options, const SectionPieces& pieces);

    /// The requested symbol sequences.
    void from_codes();

    /// Recurrences of the trajectories, closest first.
    void from_recurrences(int period);

    /// Random states around the section, and their trajectories: orbits off the attractor.
    void from_scattered(int period);

    /// Loops of cells, from fine cells to coarse ones, until a round finds nothing new. Fine cells have few loops, each
    /// close to its orbit, but miss some transitions; coarse ones have many.
    /// @return the last round, with cells of another size than before, found nothing new.
    bool from_joined(int period);

    /// Several starts from every loop of cells, of known orbits too, until a round finds nothing new.
    /// @param compare  all of them, and further rounds, until indices_agree()
    void from_variants(int period, bool compare);

    /// The sum of the indices over the points of the listed orbits whose period divides this one is that over fixed
    /// points (see index_sums()).
    [[nodiscard]] bool indices_agree(int period) const;

    /// Stabilised iterations that begin at the points of orbits of other periods.
    /// @param used  orbits of the list that have already served; set to all.
    /// @param most  iterations, a mixed sample of all.
    void from_orbits(int period, std::size_t& used, std::size_t most);

    /// A stop was requested.
    [[nodiscard]] bool stopped() const { return options_.interrupted && options_.interrupted(); }
    [[nodiscard]] const OrbitList& list() const { return list_; }
    [[nodiscard]] std::size_t starts() const { return starts_; }

private:
    /// Solves starts in batches until all are tried or `patience` in a row found nothing.
    /// @param start_at  points of start number k; empty: none.
    void solve(std::size_t count, StartOrigin origin, std::size_t patience,
               const std::function<MatrixXd(std::size_t)>& start_at);

    /// The finest cells of one length's rounds: finer than usual where those have too many loops.
    [[nodiscard]] double first_edge(int period) const;

    /// At most `most` starts from each loop of one length through cells of one edge; none: too many loops. With one
    /// start a loop, those of known orbits are left out.
    [[nodiscard]] std::optional<std::vector<MatrixXd>> loops_of(int period, double edge, std::size_t most) const;

    [[nodiscard]] VectorXd on_section(const VectorXd& x) const;

    const ModelSection& section_;
    const OrbitSearchOptions& options_;
    const SectionPieces& pieces_;
    OrbitList list_;
    ShootingOptions coarse_;
    SectionChart chart_;
    std::vector<double> signs_;  ///< of a symmetry that maps the section onto itself; empty: none
    std::size_t starts_ = 0;
};

}  // namespace orbid::periodic
