#include "periodic/search/orbit_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "models/system/stopped.hpp"
#include "periodic/orbit/coarse_flow.hpp"
#include "periodic/search/model_section.hpp"
#include "periodic/search/start_search.hpp"

namespace orbid::periodic {
namespace {

/// Stabilised iterations for a period that is settled already: a sample that would show what the other starts cannot
/// reach.
constexpr std::size_t sample = 256;

void require_search(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("search_orbits: " + message);
}

void validate(const models::System& system, const VectorXd& theta, const OrbitSearchOptions& options) {
    const auto text = [](auto value) { return std::to_string(value); };
    require_search(theta.size() == static_cast<Index>(system.parameters().size()) && theta.allFinite(),
                   "theta needs one finite value for each of the " + text(system.parameters().size()) + " parameters");
    require_search(!options.periods.empty(), "periods must not be empty");
    for (const int period : options.periods) {
        require_search(period >= 1, "periods must be >= 1, got " + text(period));
        require_search(std::count(options.periods.begin(), options.periods.end(), period) == 1,
                       "periods must differ, " + text(period) + " stands twice");
    }
    require_search(std::isfinite(options.phase), "phase must be finite");
    require_search(options.points >= 100, "points must be >= 100, got " + text(options.points));
    require_search(options.trajectories >= 1, "trajectories must be >= 1");
    require_search(options.patience >= 1, "patience must be >= 1");
    require_search(options.loops >= 1, "loops must be >= 1");
    require_search(options.widest > 0.0 && options.widest <= 0.5,
                   "widest must lie in (0, 0.5], got " + text(options.widest));
    require_search(
        options.initial.cols() == 0 || (options.initial.rows() == system.dimension() && options.initial.allFinite()),
        "initial needs one finite state of " + text(system.dimension()) + " coordinates per column");
    const bool autonomous = system.kind() == models::Kind::autonomous;
    require_search(options.section.has_value() == autonomous,
                   autonomous ? "an autonomous model needs a section" : "a section plane belongs to autonomous models");
    if (autonomous)
        require_search(options.section->normal.size() == system.dimension() && options.section->normal.allFinite() &&
                           options.section->normal.norm() > 0.0 && std::isfinite(options.section->offset),
                       "the section's normal needs " + text(system.dimension()) + " finite numbers that are not all 0");
    if (options.partition) validate(*options.partition, system.dimension());
    require_search(options.codes.empty() || options.partition.has_value(), "codes need a partition");
    for (const std::string& code : options.codes) {
        require_search(is_prime_word(code), "code \"" + code + "\" is empty or repeats a shorter word");
        require_search(code.find_first_not_of(options.partition->symbols) == std::string::npos,
                       "code \"" + code + "\" has symbols that are not among \"" + options.partition->symbols + "\"");
    }
}

/// The requested orbits, by period, rotation and points; mirrors renumbered.
std::vector<FoundOrbit> ordered(const std::vector<FoundOrbit>& found, const std::vector<int>& periods) {
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < found.size(); ++k)
        if (std::find(periods.begin(), periods.end(), found[k].orbit.period) != periods.end()) order.push_back(k);
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        const PeriodicOrbit& left = found[a].orbit;
        const PeriodicOrbit& right = found[b].orbit;
        if (left.period != right.period) return left.period < right.period;
        if (left.rotation != right.rotation) return left.rotation < right.rotation;
        return std::lexicographical_compare(left.points.data(), left.points.data() + left.points.size(),
                                            right.points.data(), right.points.data() + right.points.size());
    });
    std::vector<int> place(found.size(), -1);
    for (std::size_t k = 0; k < order.size(); ++k)
        place[order[k]] = static_cast<int>(k);
    std::vector<FoundOrbit> result;
    for (const std::size_t k : order) {
        result.push_back(found[k]);
        if (found[k].mirror >= 0) result.back().mirror = place[static_cast<std::size_t>(found[k].mirror)];
    }
    return result;
}

}  // namespace

std::string_view name(StartOrigin origin) {
    constexpr std::string_view names[] = {"recurrence", "joined", "symmetry", "orbit", "code", "scattered"};
    return names[static_cast<std::size_t>(origin)];
}

namespace {

/// Whether orbits of all periods that divide this one are looked for.
bool has_divisors(const std::vector<int>& periods, int period) {
    for (int divisor = 1; divisor < period; ++divisor)
        if (period % divisor == 0 && std::find(periods.begin(), periods.end(), divisor) == periods.end()) return false;
    return true;
}

/// All starts, period after period. `settled` gets an entry for each of these periods.
void try_starts(StartSearch& search, const std::vector<int>& periods, const OrbitSearchOptions& options, bool forced,
                std::vector<bool>& settled) {
    search.from_codes();
    for (const int period : periods) {
        if (search.stopped()) return;
        search.from_recurrences(period);
        search.from_scattered(period);
        settled.push_back(search.from_joined(period));
    }
    // Orbits that are found for one period serve as starts for the others, until a whole round is in vain.
    std::vector<std::size_t> used(periods.size(), 0);
    for (std::size_t before = 0; options.stabilised && before < search.list().orbits().size() && !search.stopped();) {
        before = search.list().orbits().size();
        for (std::size_t i = 0; i < periods.size(); ++i)
            search.from_orbits(periods[i], used[i], settled[i] ? sample : std::numeric_limits<std::size_t>::max());
    }
    // Where trajectories stay within a disc or a cylinder, unequal sums of indices tell of missing orbits.
    for (std::size_t i = 0; i < periods.size() && !search.stopped(); ++i) {
        const bool compare = forced && has_divisors(periods, periods[i]);
        search.from_variants(periods[i], compare);
        settled[i] = settled[i] && (!compare || search.indices_agree(periods[i]));
    }
}

}  // namespace

OrbitSearch search_orbits(const models::System& system, const VectorXd& theta, const OrbitSearchOptions& options) {
    validate(system, theta, options);
    const models::FlowOptions coarse = coarsened(options.solver.flow, search_tolerance);
    const ModelSection section{system, theta, options.phase, options.section,
                               longest_return(system, theta, options.section, options.seed, coarse)};
    const SectionPieces pieces =
        simulate_pieces(section, {options.points, options.trajectories, options.seed, options.initial, coarse});
    StartSearch search(section, options, pieces);
    std::vector<int> periods = options.periods;
    for (const std::string& code : options.codes)
        periods.push_back(static_cast<int>(code.size()));
    std::sort(periods.begin(), periods.end());
    periods.erase(std::unique(periods.begin(), periods.end()), periods.end());
    OrbitSearch result;
    try {
        try_starts(search, periods, options, system.kind() == models::Kind::forced, result.settled);
    } catch (const models::Stopped&) {
        // A flow was left: the starts of its batch are lost, the orbits of those before are not.
        result.interrupted = true;
    }
    result.settled.resize(periods.size(), false);
    result.orbits = ordered(search.list().orbits(), periods);
    if (options.partition)
        for (FoundOrbit& found : result.orbits)
            found.code = symbolic_code(*options.partition, found.orbit.points);
    result.starts = search.starts();
    result.captured = pieces.captured;
    result.interrupted = result.interrupted || search.stopped();
    return result;
}

}  // namespace orbid::periodic
