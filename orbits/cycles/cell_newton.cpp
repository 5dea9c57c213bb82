#include "orbits/cycles/cell_newton.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "periodic/discretisation/cyclic_system.hpp"

namespace orbid::orbits {

namespace {

// Largest coordinate of a Newton step (scaled units): beyond it the map is not linear enough (from prototypes on the
// pendulum).
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

}  // namespace orbid::orbits
