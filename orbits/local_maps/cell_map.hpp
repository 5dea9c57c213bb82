#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <tbb/concurrent_unordered_map.h>
#include <Eigen/Core>

#include "orbits/local_maps/local_map.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// The map of the section onto itself in small cells, with one cheap polynomial each. A search evaluates it millions of
/// times before it uses better fits.
///
/// A cell's polynomial is fitted to the nearest neighbours of the cell's centre on first use, with the same result from
/// any thread. Order and number of neighbours are those of the smallest median error (value_sd) at points of the
/// series. Cells are half as wide as the neighbourhoods. Thread-safe; keeps references.
class CellMap {
public:
    struct Cell {
        std::unique_ptr<double[]> numbers;  ///< centre (n), reference (n), then coefficients, n for each monomial
        double inverse_radius = 0.0;
        bool usable = false;  ///< the neighbours' images are explained by the polynomial and the centre is among them
    };

    /// @param order       of the polynomials, 0: 2.
    /// @param neighbours  of a cell, 0: chosen by the data.
    CellMap(const SectionPoints& section, const NeighbourIndex& grid, int order, std::size_t neighbours);

    [[nodiscard]] const Cell& cell_of(const double* x) const;

    /// F(x) (n, not wrapped) and dF(x) (n x n, column-major) by the polynomial of a usable cell. `values` is memory for
    /// at least terms() numbers.
    void evaluate(const Cell& cell, const double* x, double* image, double* jacobian, double* values) const;

    [[nodiscard]] Eigen::Index terms() const { return terms_; }
    [[nodiscard]] double edge() const { return edge_; }  ///< of a cell, scaled units
    [[nodiscard]] int order() const { return order_; }
    [[nodiscard]] std::size_t neighbours() const { return neighbours_; }

private:
    void choose_neighbours(std::size_t asked);
    [[nodiscard]] Cell fitted(const double* x) const;

    const SectionPoints& section_;
    const NeighbourIndex& grid_;
    int order_ = 2;
    std::size_t neighbours_ = 0;
    double edge_ = 0.0;
    std::vector<double> cells_per_unit_;  ///< by coordinate; angles have a whole number around the circle
    std::shared_ptr<const Monomials> monomials_;
    Eigen::Index terms_ = 0;
    mutable tbb::concurrent_unordered_map<std::uint64_t, Cell> cells_;
};

}  // namespace orbid::orbits
