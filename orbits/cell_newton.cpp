#include "orbits/cell_newton.hpp"

#include <vector>

#include <Eigen/LU>

#include "periodic/cyclic_system.hpp"

namespace orbid::orbits {

namespace {

// Largest coordinate of a Newton step (scaled units): beyond it the map is not linear enough. Measured on the pendulum:
// 0.02 and 0.1 lose cycles of period 5.
constexpr double step_cap = 0.04;

// A start needs 5-10 steps; more means that it wanders.
constexpr int maximum_steps = 25;

// From steps this small (in edges of a cell) on the points stay in their cells.
constexpr double settled_step = 0.1;
constexpr double converged_step = 1e-11;

// Up to this size the whole matrix fits on the stack, and elimination of it is faster than using its structure.
constexpr Eigen::Index small_size = 16;

using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, small_size, small_size>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, small_size, 1>;

// d of  d_{j+1} - A_j d_j = b_j;  b is replaced by d.
void solve_cyclic(Eigen::Index n, Eigen::Index p, const std::vector<double>& jacobians, std::vector<double>& b) {
    Eigen::Map<Eigen::VectorXd> right(b.data(), n * p);
    if (n * p <= small_size) {
        SmallMatrix matrix = SmallMatrix::Zero(n * p, n * p);
        for (Eigen::Index j = 0; j < p; ++j) {
            matrix.block(j * n, ((j + 1) % p) * n, n, n).diagonal().array() += 1.0;
            matrix.block(j * n, j * n, n, n) -= Eigen::Map<const Eigen::MatrixXd>(jacobians.data() + j * n * n, n, n);
        }
        const SmallVector solution = Eigen::PartialPivLU<SmallMatrix>(matrix).solve(SmallVector(right));
        right = solution;
        return;
    }
    std::vector<Eigen::MatrixXd> factors;
    for (Eigen::Index j = 0; j < p; ++j)
        factors.emplace_back(Eigen::Map<const Eigen::MatrixXd>(jacobians.data() + j * n * n, n, n));
    right = periodic::CyclicSystem(factors).solve(right);
}

}  // namespace

bool close_on_cells(const SectionPoints& section, const CellMap& map, Eigen::MatrixXd& points) {
    const Eigen::Index n = points.rows(), p = points.cols();
    std::vector<const CellMap::Cell*> cells(static_cast<std::size_t>(p), nullptr);
    std::vector<double> jacobians(static_cast<std::size_t>(n * n * p)), defect(static_cast<std::size_t>(n * p));
    std::vector<double> image(static_cast<std::size_t>(n)), values(static_cast<std::size_t>(map.terms()));
    bool frozen = false;
    for (int step = 0; step < maximum_steps; ++step) {
        for (Eigen::Index j = 0; j < p; ++j) {
            const CellMap::Cell*& cell = cells[static_cast<std::size_t>(j)];
            if (!frozen) cell = &map.cell_of(points.col(j).data());
            if (!cell->usable) return false;
            map.evaluate(*cell, points.col(j).data(), image.data(), jacobians.data() + j * n * n, values.data());
            for (Eigen::Index d = 0; d < n; ++d)
                defect[static_cast<std::size_t>(j * n + d)] =
                    section.difference(image[static_cast<std::size_t>(d)], points(d, (j + 1) % p), d);
        }
        solve_cyclic(n, p, jacobians, defect);
        const Eigen::Map<Eigen::MatrixXd> change(defect.data(), n, p);
        const double size = change.cwiseAbs().maxCoeff();
        if (!(size < 1e6)) return false;
        const double share = size > step_cap ? step_cap / size : 1.0;
        for (Eigen::Index j = 0; j < p; ++j)
            points.col(j) = section.wrapped(points.col(j) + share * change.col(j));
        if (frozen && size > map.edge()) return false;
        if (size < settled_step * map.edge()) frozen = true;
        if (size < converged_step) return true;
    }
    return false;
}

}  // namespace orbid::orbits
