#include "orbits/cycles/cycle_refinement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "periodic/discretisation/cyclic_system.hpp"

namespace orbid::orbits {
namespace {

// Largest coordinate of a Newton step: beyond a few boxes local maps say nothing.
constexpr double cycle_step_cap = 0.04;

// Newton has converged when its step is down to rounding, or when steps this small do not become smaller any more
// (nearly singular cycles amplify rounding). It needs 4-6 steps, more means that it wanders.
constexpr double converged_cycle_step = 1e-14;
constexpr double rounding_step = 1e-10;
constexpr int most_cycle_steps = 25;

// New fits until the points lie within this part of the radius around the fits' centres: the fit is then as good as
// one centred exactly.
constexpr double centred = 0.02;
constexpr int maximum_rounds = 5;

// Points that have moved farther than this part of a radius choose their fits again.
constexpr double moved_away = 0.5;

// Farther from the centre than this, in radii, a map is not asked any more.
constexpr double extrapolation = 3.0;

// The same on cells (scaled units): beyond it the map is not linear enough (from prototypes on the pendulum).
constexpr double cell_step_cap = 0.04;

// A start needs 5-10 steps; more means that it wanders.
constexpr int most_cell_steps = 25;

// From steps this small (in edges of a cell) on the points stay in their cells.
constexpr double settled_step = 0.1;
constexpr double converged_cell_step = 1e-11;

// Up to this size elimination of the whole matrix is faster than using its structure.
constexpr std::size_t small_size = 24;

// Solves matrix x = b, size m, row by row, by elimination with row pivoting in plain loops: matrices of this size are
// not worth a library's preparations. A singular one gives numbers that are not finite.
void eliminate(std::size_t m, double* matrix, double* b) {
    for (std::size_t c = 0; c < m; ++c) {
        std::size_t pivot = c;
        for (std::size_t row = c + 1; row < m; ++row)
            if (std::abs(matrix[row * m + c]) > std::abs(matrix[pivot * m + c])) pivot = row;
        if (pivot != c) {
            std::swap_ranges(matrix + c * m + c, matrix + (c + 1) * m, matrix + pivot * m + c);
            std::swap(b[c], b[pivot]);
        }
        for (std::size_t row = c + 1; row < m; ++row) {
            const double factor = matrix[row * m + c] / matrix[c * m + c];
            if (factor == 0.0) continue;  // most of the matrix is empty
            for (std::size_t k = c + 1; k < m; ++k)
                matrix[row * m + k] -= factor * matrix[c * m + k];
            b[row] -= factor * b[c];
        }
    }
    for (std::size_t c = m; c-- > 0;) {
        for (std::size_t k = c + 1; k < m; ++k)
            b[c] -= matrix[c * m + k] * b[k];
        b[c] /= matrix[c * m + c];
    }
}

// d of  d_{j+1} - A_j d_j = b_j;  b is replaced by d. `matrix` is memory.
void solve_cyclic(std::size_t n, std::size_t p, const std::vector<double>& jacobians, std::vector<double>& b,
                  std::vector<double>& matrix) {
    const std::size_t m = n * p;
    if (m <= small_size) {
        matrix.assign(m * m, 0.0);
        for (std::size_t j = 0; j < p; ++j)
            for (std::size_t row = 0; row < n; ++row) {
                double* to = matrix.data() + (j * n + row) * m;
                to[(j + 1) % p * n + row] += 1.0;
                for (std::size_t a = 0; a < n; ++a)
                    to[j * n + a] -= jacobians[(j * n + a) * n + row];
            }
        eliminate(m, matrix.data(), b.data());
        return;
    }
    const auto size = static_cast<Eigen::Index>(n);
    std::vector<Eigen::MatrixXd> factors;
    for (std::size_t j = 0; j < p; ++j)
        factors.emplace_back(Eigen::Map<const Eigen::MatrixXd>(jacobians.data() + j * n * n, size, size));
    Eigen::Map<Eigen::VectorXd> right(b.data(), static_cast<Eigen::Index>(m));
    right = periodic::CyclicSystem(factors).solve(right);
}

Eigen::VectorXd offset_of(const SectionPoints& section, const Eigen::MatrixXd& points, const LocalMap& map,
                          Eigen::Index j) {
    return section.difference(Eigen::VectorXd(points.col(j)), map.centre);
}

// Fits around the points, of the sizes chosen before where there are any.
bool fit_all(const FitChoice& choice, RefinedCycle& cycle) {
    const auto p = static_cast<std::size_t>(cycle.points.cols());
    cycle.maps.clear();
    cycle.sizes.resize(p);
    for (std::size_t j = 0; j < p; ++j) {
        const Eigen::VectorXd place = cycle.points.col(static_cast<Eigen::Index>(j));
        if (cycle.sizes[j].empty()) cycle.sizes[j] = choice.best(place);
        if (cycle.sizes[j].empty()) return false;
        cycle.maps.push_back(choice.fitted(place, {cycle.sizes[j].front()}).fits.front());
        if (!cycle.maps.back().usable) return false;
    }
    return true;
}

// Newton with the maps as they are; the points are left at the solution.
bool close_orbit(const SectionPoints& section, RefinedCycle& cycle) {
    const Eigen::Index n = cycle.points.rows(), p = cycle.points.cols();
    Eigen::VectorXd defect(n * p);
    double previous = std::numeric_limits<double>::infinity();
    for (int step = 0; step < most_cycle_steps; ++step) {
        std::vector<Eigen::MatrixXd> jacobians;
        for (Eigen::Index j = 0; j < p; ++j) {
            const LocalMap& map = cycle.maps[static_cast<std::size_t>(j)];
            const Eigen::VectorXd d = offset_of(section, cycle.points, map, j);
            if (!(d.cwiseAbs().maxCoeff() <= std::max(cycle_step_cap, extrapolation * map.radius))) return false;
            jacobians.push_back(map.jacobian_at(d));
            defect.segment(j * n, n) = section.difference(Eigen::VectorXd(map.value + map.displacement(d)),
                                                          Eigen::VectorXd(cycle.points.col((j + 1) % p)));
        }
        Eigen::VectorXd change = periodic::CyclicSystem(jacobians).solve(defect);
        if (!change.allFinite()) return false;
        const double size = change.cwiseAbs().maxCoeff();
        if (size > cycle_step_cap) change *= cycle_step_cap / size;
        for (Eigen::Index j = 0; j < p; ++j)
            cycle.points.col(j) = section.wrapped(cycle.points.col(j) + change.segment(j * n, n));
        if (size < converged_cycle_step || (size < rounding_step && size > 0.1 * previous)) return true;
        previous = size;
    }
    return false;
}

bool is_centred(const SectionPoints& section, const RefinedCycle& cycle, double share) {
    for (Eigen::Index j = 0; j < cycle.points.cols(); ++j) {
        const LocalMap& map = cycle.maps[static_cast<std::size_t>(j)];
        if (!(offset_of(section, cycle.points, map, j).norm() <= share * map.radius)) return false;
    }
    return true;
}

// From the points of `cycle`, on fits of its sizes; where it has none they are chosen.
void refine(const SectionPoints& section, const FitChoice& choice, bool fixed_sizes, RefinedCycle& cycle) {
    for (int round = 0; round < maximum_rounds; ++round) {
        if (!fit_all(choice, cycle) || !close_orbit(section, cycle)) return;
        cycle.converged = is_centred(section, cycle, centred);
        if (cycle.converged) return;
        // Sizes chosen for other places may not suit these.
        if (!fixed_sizes && !is_centred(section, cycle, moved_away)) cycle.sizes.clear();
    }
    // Neighbours that come and go can keep the points moving a little for ever; well inside the fits that is harmless
    // and part of the differences between fits.
    cycle.converged = is_centred(section, cycle, 10.0 * centred);
}

}  // namespace

bool close_on_cells(const SectionPoints& section, const CellMap& map, Eigen::MatrixXd& points) {
    const Eigen::Index n = points.rows(), p = points.cols();
    std::vector<const CellMap::Cell*> cells(static_cast<std::size_t>(p), nullptr);
    std::vector<double> jacobians(static_cast<std::size_t>(n * n * p)), defect(static_cast<std::size_t>(n * p));
    std::vector<double> image(static_cast<std::size_t>(n)), values(static_cast<std::size_t>(map.terms()));
    std::vector<double> matrix;
    bool frozen = false;
    for (int step = 0; step < most_cell_steps; ++step) {
        for (Eigen::Index j = 0; j < p; ++j) {
            const CellMap::Cell*& cell = cells[static_cast<std::size_t>(j)];
            if (!frozen) cell = &map.cell_of(points.col(j).data());
            if (!cell->usable) return false;
            map.evaluate(*cell, points.col(j).data(), image.data(), jacobians.data() + j * n * n, values.data());
            for (Eigen::Index d = 0; d < n; ++d)
                defect[static_cast<std::size_t>(j * n + d)] =
                    section.difference(image[static_cast<std::size_t>(d)], points(d, (j + 1) % p), d);
        }
        solve_cyclic(static_cast<std::size_t>(n), static_cast<std::size_t>(p), jacobians, defect, matrix);
        double size = 0.0;
        bool finite = true;
        for (const double d : defect) {
            size = std::max(size, std::abs(d));
            finite = finite && std::isfinite(d);
        }
        if (!finite) return false;
        const double share = size > cell_step_cap ? cell_step_cap / size : 1.0;
        for (Eigen::Index j = 0; j < p; ++j)
            for (Eigen::Index d = 0; d < n; ++d)
                points(d, j) = section.wrapped(points(d, j) + share * defect[static_cast<std::size_t>(j * n + d)], d);
        if (frozen && size > map.edge()) return false;
        if (size < settled_step * map.edge()) frozen = true;
        if (size < converged_cell_step) return true;
    }
    return false;
}

Eigen::MatrixXd coupled_matrix(const std::vector<Eigen::MatrixXd>& jacobians) {
    const auto p = static_cast<Eigen::Index>(jacobians.size());
    const Eigen::Index n = jacobians.front().rows();
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(n * p, n * p);
    for (Eigen::Index j = 0; j < p; ++j) {
        result.block(j * n, j * n, n, n) += jacobians[static_cast<std::size_t>(j)];
        result.block(j * n, ((j + 1) % p) * n, n, n) -= Eigen::MatrixXd::Identity(n, n);
    }
    return result;
}

std::vector<Eigen::MatrixXd> RefinedCycle::jacobians(const SectionPoints& section) const {
    std::vector<Eigen::MatrixXd> result;
    for (Eigen::Index j = 0; j < points.cols(); ++j) {
        const LocalMap& map = maps[static_cast<std::size_t>(j)];
        result.push_back(map.jacobian_at(offset_of(section, points, map, j)));
    }
    return result;
}

RefinedCycle refine_cycle(const SectionPoints& section, const FitChoice& choice, const Eigen::MatrixXd& start) {
    RefinedCycle cycle;
    cycle.points = start;
    refine(section, choice, false, cycle);
    return cycle;
}

RefinedCycle refine_cycle(const SectionPoints& section, const FitChoice& choice, const Eigen::MatrixXd& start,
                          const FitSize& size) {
    RefinedCycle cycle;
    cycle.points = start;
    cycle.sizes.assign(static_cast<std::size_t>(start.cols()), {size});
    refine(section, choice, true, cycle);
    return cycle;
}

RefinedCycle alternative_cycle(const SectionPoints& section, const RefinedCycle& cycle,
                               const std::vector<PlacedFits>& fits, std::size_t which) {
    RefinedCycle result;
    result.points = cycle.points;
    for (std::size_t j = 0; j < cycle.maps.size(); ++j) {
        const bool there = fits[j].fits.size() > which && fits[j].fits[which].usable;
        result.maps.push_back(there ? fits[j].fits[which] : cycle.maps[j]);
    }
    result.converged = close_orbit(section, result);
    return result;
}

}  // namespace orbid::orbits
