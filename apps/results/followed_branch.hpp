#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "orbits/records/series.hpp"
#include "periodic/branches/branch.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps {

/// A motion that was measured over the parameter of branches, beside the model's.
struct MeasuredMotion {
    std::string label;  ///< "U = 14.9"
    double parameter = 0.0;
    bool used = true;             ///< false: the model has no orbit for it
    std::optional<int> unstable;  ///< multipliers of the model's orbit outside the unit circle; nothing: there is none
    struct Value {
        std::string name;  ///< "h.half_range", "frequency"
        std::string unit;
        double observed = 0.0;
        double predicted = 0.0;  ///< nan without an orbit
        double sd = 0.0;         ///< of the error of what was measured; nan: not known
    };
    std::vector<Value> values;
};

/// What the continuation of a job, or the branch of an estimate, has led to.
struct FollowedBranches {
    std::string message;  ///< why there is no branch; empty otherwise
    std::vector<periodic::Branch> branches;
    /// Where each of them was followed from, where all of them are pieces of one; empty otherwise.
    std::vector<std::string> pieces{};
    /// Formulas whose amplitudes follow those of the coordinates in each point.
    std::vector<orbits::SeriesCoordinate> readings{};
    std::vector<MeasuredMotion> measured{};
};

/// A measure of a point, of coordinate or reading `index`; nan where it is not known.
[[nodiscard]] double measure_of(const periodic::BranchPoint& point, periodic::OrbitMeasure measure, Eigen::Index index);

/// A place in a list of branches.
struct BranchPlace {
    std::size_t branch = 0;
    std::size_t point = 0;
};

/// The bifurcations of all branches, each once: the orbit that a branch begins with where it was switched to, and the
/// one it ends with where it meets another, are listed with the other branch alone.
[[nodiscard]] std::vector<BranchPlace> located_bifurcations(const std::vector<periodic::Branch>& branches);

/// The branch that was switched to at a place; none when no one was.
[[nodiscard]] std::vector<std::size_t> branches_from(const std::vector<periodic::Branch>& branches, BranchPlace place);

/// Cascades of period doublings: every doubling of a branch that did not begin at one itself, followed by the first
/// doubling of the branch that begins there, and so on. Cascades of one doubling are left out.
[[nodiscard]] std::vector<std::vector<BranchPlace>> doubling_cascades(const std::vector<periodic::Branch>& branches);

/// Period of a branch's orbits; the orbits that it shares with other branches at its ends may have half of it.
[[nodiscard]] int branch_period(const periodic::Branch& branch);

/// Multiplier nearest to the unit circle; nan without any.
[[nodiscard]] std::complex<double> critical_multiplier(const periodic::PeriodicOrbit& orbit);

}  // namespace orbid::apps
