#include "periodic/stability/stability.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>

#include <tbb/parallel_for.h>

#include "models/arithmetic/singular_values.hpp"
#include "models/system/left_loop.hpp"
#include "periodic/stability/floquet_vector.hpp"

namespace orbid::periodic {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXcd;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Cosine of the angle between left and right eigenvector below which the multiplier counts as double: its derivative
/// would be known to fewer than six digits.
constexpr double least_overlap = 1e-8;

/// The way from one point to the next is divided into pieces of this growth (the largest singular value of the Jacobian
/// over the smallest). Errors of the weak directions then stay below it times those of the flow.
constexpr double piece_growth = 100.0;
constexpr int most_pieces = 48;

/// The flow over one piece, and how its Jacobian moves with the parameters as the orbit does.
struct Piece {
    MatrixXd jacobian;
    std::vector<MatrixXd> slopes;  ///< dX / dtheta_k in all, one per free parameter
};

/// The ways along an orbit from each point to the next.
struct Passages {
    const models::System& system;
    const VectorXd& theta;
    double phase;
    const PeriodicOrbit& orbit;
    std::span<const Index> free;
    const models::FlowOptions& options;

    /// The pieces from point j to the next; empty when they cannot be simulated.
    [[nodiscard]] std::vector<Piece> from(Index j) const {
        const Index n = orbit.points.rows();
        const auto f = static_cast<Index>(free.size());
        VectorXd x = orbit.points.col(j);
        const double durations[] = {duration(j)};
        const auto whole = system.flow_with_sensitivities(x, phase, durations, theta, free, clock(), options);
        if (whole.status != models::FlowStatus::ok || !whole.sensitivities.allFinite()) return {};
        const MatrixXd all = whole.sensitivities.leftCols(n);
        const int count = pieces(all);
        if (free.empty() && count == 1) return {Piece{all, {}}};

        // x'_{j+1} = X_j x'_j + Y_j + f tau'_j: the last term is how the time to the next point changes.
        MatrixXd slope = f > 0 ? MatrixXd(orbit.sensitivities.middleRows(n * j, n)) : MatrixXd(n, 0);
        Eigen::RowVectorXd time_slope = Eigen::RowVectorXd::Zero(f);
        if (autonomous() && f > 0) {
            const VectorXd field = field_at(whole.states.col(0));
            const MatrixXd next = orbit.sensitivities.middleRows(n * ((j + 1) % orbit.points.cols()), n);
            time_slope =
                field.transpose() * (next - all * slope - whole.sensitivities.rightCols(f)) / field.squaredNorm();
        }
        std::vector<Piece> result;
        for (int i = 0; i < count; ++i) {
            const double part[] = {durations[0] / count};
            const double begin = clock() == models::Clock::phase ? phase + i * part[0] : 0.0;
            if (!add_piece(x, slope, begin, part, time_slope / count, result)) return {};
        }
        return result;
    }

    [[nodiscard]] bool autonomous() const { return system.kind() == models::Kind::autonomous; }
    [[nodiscard]] models::Clock clock() const {
        return system.kind() == models::Kind::forced ? models::Clock::phase : models::Clock::time;
    }
    [[nodiscard]] double duration(Index j) const {
        if (system.kind() == models::Kind::map) return 1.0;
        if (system.kind() == models::Kind::forced) return system.period(theta, models::Clock::phase);
        return (j + 1 < orbit.times.size() ? orbit.times(j + 1) : orbit.time) - orbit.times(j);
    }
    [[nodiscard]] int pieces(const MatrixXd& jacobian) const {
        if (system.kind() == models::Kind::map) return 1;
        const VectorXd values = models::singular_values(jacobian);
        const double growth = values(0) / values(values.size() - 1);
        if (!std::isfinite(growth)) return 1;
        return std::clamp(static_cast<int>(std::ceil(std::log(growth) / std::log(piece_growth))), 1, most_pieces);
    }
    /// Moves x and its derivatives on over one piece and notes it; false when it cannot be simulated.
    [[nodiscard]] bool add_piece(VectorXd& x, MatrixXd& moved, double begin, std::span<const double> duration,
                                 const Eigen::RowVectorXd& time_slope, std::vector<Piece>& result) const {
        const Index n = x.size();
        const auto f = static_cast<Index>(free.size());
        const Index d = n + f;
        if (f == 0) {
            const auto flow = system.flow_with_sensitivities(x, begin, duration, theta, free, clock(), options);
            result.push_back({flow.sensitivities, {}});
            x = flow.states.col(0);
            return flow.status == models::FlowStatus::ok;
        }
        const auto flow = system.flow_with_second_derivatives(x, begin, duration, theta, free, clock(), options);
        if (flow.status != models::FlowStatus::ok || !flow.second_derivatives.allFinite()) return false;
        Piece piece{flow.sensitivities.leftCols(n), {}};
        x = flow.states.col(0);
        MatrixXd by_time;
        if (autonomous()) by_time = system.rhs_derivatives(x, std::vector<double>{0.0}, theta, {}) * piece.jacobian;
        for (Index k = 0; k < f; ++k) {
            MatrixXd slope(n, n);
            for (Index i = 0; i < n; ++i) {
                slope.col(i) = flow.second_derivatives.col(i * d + n + k);
                for (Index l = 0; l < n; ++l)
                    slope.col(i) += flow.second_derivatives.col(i * d + l) * moved(l, k);
            }
            if (autonomous()) slope += by_time * time_slope(k);
            piece.slopes.push_back(std::move(slope));
        }
        moved = (piece.jacobian * moved + flow.sensitivities.rightCols(f)).eval();
        if (autonomous()) moved += field_at(x) * time_slope;
        result.push_back(std::move(piece));
        return true;
    }
    [[nodiscard]] VectorXd field_at(const VectorXd& x) const { return system.rhs(x, std::vector<double>{0.0}, theta); }
};

void check(const models::System& system, const PeriodicOrbit& orbit, std::span<const Index> free,
           const StabilityOptions& options) {
    const auto require = [](bool holds, const std::string& message) {
        if (!holds) throw std::invalid_argument("stability: " + message);
    };
    require(options.near > 0.0, "near must be > 0");
    require(is_orbit(orbit.status), "the orbit is not solved, its status is " + std::string(name(orbit.status)));
    require(orbit.points.rows() == system.dimension() && orbit.points.cols() > 0, "the orbit has no points");
    require(system.kind() != models::Kind::autonomous || orbit.times.size() == orbit.points.cols(),
            "the orbit has no times of its points");
    require(free.empty() || (orbit.sensitivities.rows() == orbit.points.size() &&
                             orbit.sensitivities.cols() == static_cast<Index>(free.size())),
            "the orbit needs its sensitivities to the same parameters");
}

}  // namespace

std::string_view name(Bifurcation bifurcation) {
    constexpr std::string_view names[] = {"none", "fold", "period_doubling", "neimark_sacker", "branch_point"};
    return names[static_cast<std::size_t>(bifurcation)];
}

Bifurcation nearest_bifurcation(const std::vector<Complex>& multipliers, double near) {
    Bifurcation nearest = Bifurcation::none;
    double distance = near;
    for (const Complex& multiplier : multipliers) {
        const double gap = std::abs(std::abs(multiplier) - 1.0);
        if (!(gap < distance)) continue;
        distance = gap;
        nearest = multiplier.imag() != 0.0  ? Bifurcation::neimark_sacker
                  : multiplier.real() > 0.0 ? Bifurcation::fold
                                            : Bifurcation::period_doubling;
    }
    return nearest;
}

Stability stability(const models::System& system, const VectorXd& theta, double phase, const PeriodicOrbit& orbit,
                    std::span<const Index> free, const StabilityOptions& options) {
    check(system, orbit, free, options);
    const Index p = orbit.points.cols();
    const Index n = orbit.points.rows();
    const auto count = static_cast<Index>(orbit.multipliers.size());
    const auto f = static_cast<Index>(free.size());
    Stability result;
    result.distance = std::numeric_limits<double>::infinity();
    for (const Complex& multiplier : orbit.multipliers) {
        result.unstable += std::abs(multiplier) > 1.0 ? 1 : 0;
        result.distance = std::min(result.distance, std::abs(std::abs(multiplier) - 1.0));
    }
    result.nearest = nearest_bifurcation(orbit.multipliers, options.near);

    const Passages passages{system, theta, phase, orbit, free, options.flow};
    std::vector<std::vector<Piece>> passed(static_cast<std::size_t>(p));
    tbb::parallel_for(Index{0}, p, [&](Index j) { passed[static_cast<std::size_t>(j)] = passages.from(j); });
    models::stop_if_left();
    std::vector<MatrixXd> factors;
    std::vector<const Piece*> pieces;
    std::vector<Index> first;  // piece that begins at each point
    for (const std::vector<Piece>& passage : passed) {
        if (passage.empty()) return result;
        first.push_back(static_cast<Index>(pieces.size()));
        for (const Piece& piece : passage) {
            pieces.push_back(&piece);
            factors.push_back(piece.jacobian);
        }
    }
    result.simulated = true;
    const auto total = static_cast<Index>(pieces.size());

    result.directions.assign(static_cast<std::size_t>(p), MatrixXcd::Constant(n, count, nan));
    result.ln_multiplier_sensitivities = MatrixXd::Constant(count, f, nan);
    for (Index m = 0; m < count; ++m) {
        const Complex multiplier = orbit.multipliers[static_cast<std::size_t>(m)];
        if (multiplier == 0.0) continue;
        const FloquetVectors vectors = floquet_vectors(factors, multiplier);
        for (Index j = 0; j < p; ++j)
            result.directions[static_cast<std::size_t>(j)].col(m) =
                vectors.right.col(first[static_cast<std::size_t>(j)]).stableNormalized();
        // w_j^T v_j is the same at all points.
        const Complex overlap = vectors.left.col(0).transpose() * vectors.right.col(0);
        if (!(std::abs(overlap) > least_overlap * vectors.left.col(0).norm() * vectors.right.col(0).norm())) continue;
        for (Index k = 0; k < f; ++k) {
            Complex slope = 0.0;
            for (Index j = 0; j < total; ++j) {
                const auto slot = static_cast<std::size_t>(j);
                const Complex part = vectors.left.col((j + 1) % total).transpose() *
                                     (pieces[slot]->slopes[static_cast<std::size_t>(k)] * vectors.right.col(j));
                slope += part / vectors.rho[slot];
            }
            result.ln_multiplier_sensitivities(m, k) = (slope / overlap).real();
        }
    }
    return result;
}

}  // namespace orbid::periodic
