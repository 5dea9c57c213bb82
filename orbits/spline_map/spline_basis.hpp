#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/section_points.hpp"
#include "orbits/spline_map/difference_rows.hpp"

namespace orbid::orbits {

/// The patches that are not zero at a place, with their values and derivatives there.
struct SplineSupport {
    bool inside = false;                   ///< every patch here has data
    std::vector<std::int32_t> patch;       ///< numbers of the patches, 4^n of them
    std::vector<char> mirrored;            ///< this patch has the coefficients of its mirror image
    Eigen::VectorXd value;                 ///< shape (4^n)
    Eigen::MatrixXd slope;                 ///< shape (n, 4^n) [1 / scaled unit]; empty unless asked for
    std::vector<Eigen::MatrixXd> bending;  ///< second derivatives, shape (n, n) each; empty unless asked for
};

/// Overlapping polynomial patches on a regular grid over the section: products of cubic B-splines, each four spacings
/// wide, twice continuously differentiable, around the circle in angles. They sum to one and reproduce cubic
/// polynomials.
///
/// Only patches over data exist. With a symmetry the grid is its own mirror image and a patch shares its coefficients
/// with its image, so that a map made of them is exactly symmetric: F(S x) = S F(x).
class SplineBasis {
public:
    /// @param places   shape (n, m), scaled units: where data are; nan columns are left out.
    /// @param spacing  > 0, scaled units; shrunk so that whole numbers fit around a turn.
    SplineBasis(const SectionPoints& section, const Eigen::MatrixXd& places, double spacing);

    [[nodiscard]] Eigen::Index dimension() const { return static_cast<Eigen::Index>(spacing_.size()); }
    [[nodiscard]] Eigen::Index patches() const { return patches_; }  ///< mirror images not counted
    /// The number of coefficients, each with number patch * n + coordinate; -1: zero by symmetry.
    [[nodiscard]] Eigen::Index unknowns() const { return patches_ * dimension(); }
    [[nodiscard]] const std::vector<char>& fixed() const { return fixed_; }  ///< unknowns that are zero by symmetry
    [[nodiscard]] double spacing(Eigen::Index d) const { return spacing_[static_cast<std::size_t>(d)]; }

    /// @param derivatives  0, 1 or 2, as needed.
    void support(const double* place, int derivatives, SplineSupport& result) const;

    /// Number of the box of `width` x ... cells that a place lies in; -1 outside.
    [[nodiscard]] std::int64_t region(const double* place, std::int64_t width) const;

    /// Third differences of the coefficients of coordinate d on the grid, along and across its axes: a row each, over
    /// the unknowns. Quadratic polynomials have none, so |rows c|^2 measures the roughness of a map.
    /// @param region  receives for every row the number of the region that it lies in, boxes of `width` patches.
    [[nodiscard]] DifferenceRows third_differences(Eigen::Index d, std::int64_t width,
                                                   std::vector<std::int64_t>& region) const;

private:
    struct Axis {
        double origin = 0.0;
        std::int64_t cells = 1;
        std::int64_t functions = 1;
        bool circle = false;
    };

    void lay_axis(std::size_t d, const Eigen::MatrixXd& places);
    /// The functions on the grid that overlap in a cell with data, and their mirror images.
    [[nodiscard]] std::vector<char> occupied(const Eigen::MatrixXd& places) const;
    void number_patches(const std::vector<char>& with_data);
    /// Coefficients of a difference, of the given orders along the axes, that begins at a function on the grid: empty
    /// where one of them does not exist.
    void find_stencil(std::int64_t raw, const std::vector<std::size_t>& orders, Eigen::Index coordinate,
                      std::vector<std::pair<std::size_t, double>>& stencil) const;
    /// Number of the box of `width` x ... functions that the middle of a difference lies in.
    [[nodiscard]] std::int64_t difference_region(std::int64_t raw, const std::vector<std::size_t>& orders,
                                                 std::int64_t width) const;
    [[nodiscard]] bool locate(const double* place, std::array<std::int64_t, 4>& cell, std::array<double, 4>& u) const;
    [[nodiscard]] std::int64_t function_of(std::size_t d, std::int64_t cell_offset) const;
    [[nodiscard]] std::int64_t mirrored_function(std::int64_t raw) const;

    const SectionPoints* section_;
    std::vector<double> spacing_;
    std::vector<Axis> axes_;
    std::vector<std::int32_t> number_;  ///< of a function on the grid; -1: no data
    std::vector<char> flipped_;         ///< of a function on the grid: shares the coefficients of its mirror image
    std::vector<char> fixed_;
    Eigen::Index patches_ = 0;
};

}  // namespace orbid::orbits
