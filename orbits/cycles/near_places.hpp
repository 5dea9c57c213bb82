#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Places on a section with a radius each: tells which states lie near one of them, in a time that does not grow with
/// their number. Const and thread-safe after construction.
class NearPlaces {
public:
    /// @param places  shape (n, count), scaled units (SectionPoints); angles in turns.
    /// @param radii   of each place, scaled units, > 0.
    /// @param angle   of each coordinate: it is one.
    NearPlaces(Eigen::MatrixXd places, std::vector<double> radii, std::vector<char> angle);

    /// The state, n scaled coordinates, angles not necessarily wrapped, is within the radius of some place. A missing
    /// coordinate (nan) is near nothing.
    [[nodiscard]] bool contains(const double* state) const;

private:
    [[nodiscard]] std::int64_t cell(double value, std::size_t coordinate) const;
    void enter(std::uint32_t place);

    Eigen::MatrixXd places_;
    std::vector<double> radii_;
    std::vector<char> angle_;
    std::size_t gridded_ = 0;             ///< the first coordinates, which cells divide
    std::vector<double> cells_per_unit_;  ///< angles: a whole number around the circle
    std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;  ///< places whose balls touch the cell
};

}  // namespace orbid::orbits
