#include "periodic/search/model_section.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/arithmetic/median.hpp"
#include "models/arithmetic/splitmix64.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/search/section_cell.hpp"

namespace orbid::periodic {
namespace {

/// Sections simulated between two looks at what became of a trajectory. Long enough to see it repeat.
constexpr std::size_t chunk = 128;
constexpr Index repeated = 64;
constexpr Index longest_stable = 32;

/// A trajectory that has settled repeats to the accuracy of the flow. An unstable orbit is left within 64 sections
/// unless its multiplier is below 1.4, which rounding (1e-16) needs to grow to this.
constexpr double settling_tolerance = 1e-9;

/// Trials with a random state; more are made for a model of which most states are senseless.
constexpr std::size_t probes = 64;
constexpr std::size_t probed_sections = 64;

MatrixXd random_states(const VectorXd& range, std::uint64_t seed, std::uint64_t first, std::size_t count) {
    MatrixXd states(range.size(), static_cast<Index>(count));
    for (std::size_t k = 0; k < count; ++k)
        states.col(static_cast<Index>(k)) = random_state(range, seed, first + k);
    return states;
}

VectorXd unit_range(const models::System& system) {
    VectorXd range = VectorXd::Constant(system.dimension(), system.state_size());
    for (const Index i : angle_coordinates(system))
        range(i) = std::numbers::pi;
    return range;
}

models::EnsembleResult advance(const ModelSection& section, const MatrixXd& starts, std::size_t count,
                               const models::FlowOptions& flow) {
    if (section.system.kind() == models::Kind::autonomous)
        return section.system.crossing_ensemble(starts, *section.section, count, section.longest, section.theta, flow);
    return section.system.ensemble(starts, section.phase, count, section.theta, flow);
}

/// Columns at the end of a piece that repeat an orbit; 0: none.
Index settled_columns(const MatrixXd& piece, const std::vector<Index>& angles, const VectorXd& size) {
    const Index last = piece.cols() - 1;
    if (last < repeated + longest_stable) return 0;
    const auto equal = [&](Index a, Index b) {
        const VectorXd gap = wrapped_angles(piece.col(a) - piece.col(b), angles);
        return (gap.array().abs() <= settling_tolerance * size.array()).all();
    };
    for (Index p = 1; p <= longest_stable; ++p) {
        Index k = last;
        while (k >= p && equal(k, k - p))
            --k;
        if (last - k >= repeated) return last - k;
    }
    return 0;
}

/// Central 99.8 % of each coordinate, of at most 2^16 points of these pieces.
void measure(const models::System& system, const std::vector<MatrixXd>& measured, SectionPieces& pieces) {
    const Index n = system.dimension();
    pieces.lowest = VectorXd::Constant(n, -std::numbers::pi);
    pieces.size = VectorXd::Constant(n, 2.0 * std::numbers::pi);
    Index total = 0;
    for (const MatrixXd& piece : measured)
        total += piece.cols();
    const Index stride = std::max<Index>(1, total / (Index{1} << 16));
    double largest = 0.0;
    for (Index i = 0; i < n; ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) continue;
        std::vector<double> values;
        for (const MatrixXd& piece : measured)
            for (Index k = 0; k < piece.cols(); k += stride)
                values.push_back(piece(i, k));
        std::sort(values.begin(), values.end());
        const std::size_t cut = values.size() / 1000;
        const double low = values.empty() ? 0.0 : values[cut];
        const double high = values.empty() ? 0.0 : values[values.size() - 1 - cut];
        pieces.lowest(i) = low;
        pieces.size(i) = high - low;
        largest = std::max({largest, std::abs(low), std::abs(high)});
    }
    // On a plane across an axis a coordinate is constant but for rounding.
    for (double& size : pieces.size)
        if (!(size > 1e-9 * largest)) size = largest > 0.0 ? largest : 1.0;
}

/// Columns of a piece that was lost before it left the surroundings of the others: as far again on every side.
Index inside(const models::System& system, const SectionPieces& pieces, const MatrixXd& piece) {
    Index k = 0;
    for (; k < piece.cols(); ++k)
        for (Index i = 0; i < piece.rows(); ++i)
            if (!system.coordinates()[static_cast<std::size_t>(i)].angle &&
                !(std::abs(piece(i, k) - pieces.lowest(i) - 0.5 * pieces.size(i)) <= 1.5 * pieces.size(i)))
                return k;
    return k;
}

/// Appends columns from `skip` on, without those at the end that are not finite. @return how many.
Index append_finite(MatrixXd& piece, const MatrixXd& further, Index skip) {
    Index added = std::max<Index>(further.cols() - skip, 0);
    while (added > 0 && !further.col(skip + added - 1).allFinite())
        --added;
    piece.conservativeResize(Eigen::NoChange, piece.cols() + added);
    piece.rightCols(added) = further.middleCols(skip, added);
    return added;
}

}  // namespace

VectorXd random_state(const VectorXd& range, std::uint64_t seed, std::uint64_t index) {
    VectorXd x(range.size());
    for (Index i = 0; i < x.size(); ++i) {
        const auto bits =
            models::splitmix64_finalizer(models::splitmix64_finalizer(models::splitmix64_finalizer(seed) + index) +
                                         static_cast<std::uint64_t>(i) * 0x9e3779b97f4a7c15U);
        x(i) = range(i) * (2.0 * (static_cast<double>(bits >> 12U) + 0.5) * 0x1p-52 - 1.0);
    }
    return x;
}

double longest_return(const models::System& system, const VectorXd& theta,
                      const std::optional<models::Section>& section, std::uint64_t seed,
                      const models::FlowOptions& flow) {
    if (system.kind() != models::Kind::autonomous) return 1.0;
    constexpr std::size_t tried = 8;
    std::vector<double> returns, times;
    const MatrixXd starts = random_states(unit_range(system), seed, 0, tried);
    for (Index k = 0; k < starts.cols(); ++k) {
        const VectorXd x = starts.col(k);
        // A thousand of them hold several returns, where there are any.
        times.push_back(1e3 * motion_time(system, theta, x));
        const auto found = system.crossings(x, *section, 8, times.back(), theta, std::nullopt, flow);
        for (Index j = 1; j < found.times.size(); ++j)
            returns.push_back(found.times(j) - found.times(j - 1));
    }
    if (returns.empty()) return models::upper_median(std::move(times));
    return 100.0 * models::upper_median(std::move(returns));
}

VectorXd start_range(const ModelSection& section, std::uint64_t seed, const models::FlowOptions& flow) {
    const models::System& system = section.system;
    VectorXd range = unit_range(system);
    const auto trial = advance(section, random_states(range, seed, 0, probes), probed_sections, flow);
    VectorXd largest = VectorXd::Zero(range.size());
    for (std::size_t k = 0; k < trial.sections.size(); ++k)
        if (trial.status[k] == models::FlowStatus::ok)
            largest = largest.cwiseMax(trial.sections[k].cwiseAbs().rowwise().maxCoeff());
    for (Index i = 0; i < range.size(); ++i)
        if (!system.coordinates()[static_cast<std::size_t>(i)].angle && largest(i) > 0.0 && std::isfinite(largest(i)))
            range(i) = largest(i);
    return range;
}

namespace {

/// Trajectories that are followed until they settle or are lost, and the extent of their sections.
SectionPieces long_pieces(const ModelSection& section, const SectionPiecesOptions& options) {
    const models::System& system = section.system;
    const Index n = system.dimension();
    const std::vector<Index> angles = angle_coordinates(system);
    const VectorXd range = start_range(section, options.seed, options.flow);
    SectionPieces result;
    std::uint64_t next = 0;
    const auto fresh_state = [&]() -> VectorXd {
        const auto k = static_cast<Index>(next++);
        if (k < options.initial.cols()) return options.initial.col(k);
        return random_state(range, options.seed, next + probes);
    };
    const std::size_t length = std::max<std::size_t>(chunk, options.points / options.trajectories);
    const std::size_t count = std::clamp<std::size_t>(options.points / length, 1, options.trajectories);
    std::vector<MatrixXd> running(count, MatrixXd(n, 0));
    MatrixXd heads(n, static_cast<Index>(count));
    for (std::size_t k = 0; k < count; ++k)
        heads.col(static_cast<Index>(k)) = fresh_state();
    const bool off_section = system.kind() == models::Kind::autonomous;
    std::vector<MatrixXd> cut_short;
    const auto retire = [&](std::size_t k, std::vector<MatrixXd>& to) {
        if (running[k].cols() > 0) to.push_back(std::move(running[k]));
        running[k].resize(n, 0);
    };
    for (std::size_t done = 0; done < options.points; done += chunk * count) {
        const auto run = advance(section, heads, chunk, options.flow);
        for (std::size_t k = 0; k < count; ++k) {
            const auto column = static_cast<Index>(k);
            // The first column repeats the last one; the state that a trajectory of a plane begins at is not on it.
            const Index skip = running[k].cols() > 0 || off_section ? 1 : 0;
            const Index added = append_finite(running[k], run.sections[k], skip);
            if (run.status[k] != models::FlowStatus::ok || added < static_cast<Index>(chunk)) {
                ++result.lost;
                retire(k, cut_short);
                heads.col(column) = fresh_state();
                continue;
            }
            heads.col(column) = running[k].col(running[k].cols() - 1);
            const Index repeats =
                settled_columns(running[k].rightCols(std::min<Index>(running[k].cols(), 256)), angles, 2.0 * range);
            if (repeats == 0) continue;
            ++result.captured;
            const Index kept = running[k].cols() - repeats + 2 * longest_stable;
            running[k] = running[k].leftCols(std::min(kept, running[k].cols())).eval();
            retire(k, result.pieces);
            heads.col(column) = fresh_state();
        }
    }
    for (std::size_t k = 0; k < count; ++k)
        retire(k, result.pieces);
    measure(system, result.pieces.empty() ? cut_short : result.pieces, result);
    for (const MatrixXd& piece : cut_short) {
        const Index kept = inside(system, result, piece);
        if (kept > 0) result.pieces.push_back(piece.leftCols(kept));
    }
    return result;
}

/// One return of states all over the extent of the section and half as far around it: where points go that the
/// trajectories do not visit. Orbits off the attractor pass there.
void add_single_steps(const ModelSection& section, const SectionPiecesOptions& options, SectionPieces& result) {
    const VectorXd middle = result.lowest + 0.5 * result.size;
    const VectorXd half = 0.75 * result.size;
    constexpr std::size_t at_once = 4096;
    for (std::size_t first = 0; first < options.points; first += at_once) {
        MatrixXd starts = random_states(half, models::splitmix64_finalizer(options.seed), first,
                                        std::min(at_once, options.points - first));
        starts.colwise() += middle;
        for (const MatrixXd& sections : advance(section, starts, 1, options.flow).sections) {
            MatrixXd piece(starts.rows(), 0);
            append_finite(piece, sections, 0);
            if (inside(section.system, result, piece) == 2) result.pieces.push_back(std::move(piece));
        }
    }
}

}  // namespace

SectionPieces simulate_pieces(const ModelSection& section, const SectionPiecesOptions& options) {
    SectionPieces result = long_pieces(section, options);
    // States around a plane are not on it.
    if (section.system.kind() != models::Kind::autonomous) add_single_steps(section, options, result);
    return result;
}

}  // namespace orbid::periodic
