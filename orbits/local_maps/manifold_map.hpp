#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// The map near a place of a section whose points lie on a sheet of fewer dimensions within their errors.
///
/// In units of the reading errors, z = L^-1 (x - centre), the neighbours of the place spread along the k principal
/// directions U and are noise across them; t = U' z. Images and return times are polynomials of t, corrected to second
/// order for smearing by the errors of t (fit_local_polynomial). Deviations across the sheet are noise without
/// influence; the projection removes them.
struct ManifoldMap {
    Eigen::VectorXd centre;      ///< shape (n), scaled units
    Eigen::VectorXd value;       ///< F(centre), shape (n), wrapped
    Eigen::VectorXd offset;      ///< of the images from that of the nearest neighbour, shape (n)
    Eigen::MatrixXd slope;       ///< dF/dt, shape (n, k)
    Eigen::MatrixXd along;       ///< dt/dx = U' L^-1, shape (k, n)
    Eigen::MatrixXd tangent;     ///< dx/dt = L U, shape (n, k)
    double time = 0.0;           ///< [s] return time at the centre; 0 without times
    Eigen::VectorXd time_slope;  ///< d time / dt, shape (k)
    /// Covariance of the errors of (value, time), shape (n + 1, n + 1), and variances of the columns of `slope` for
    /// unit variance of an image's coordinate.
    Eigen::MatrixXd covariance;
    Eigen::VectorXd slope_leverage;    ///< shape (k)
    Eigen::MatrixXd image_covariance;  ///< of the residuals of (image, time), shape (n + 1, n + 1)
    double unexplained = 1.0;          ///< residual rms of the images over their spread
    double thickness = 0.0;            ///< mean square across the sheet in units of the reading errors: 1 = noise only
    double significance = 0.0;         ///< explained over unexplained mean squares of the images (an F statistic)
    double beside = 0.0;               ///< smallest share of the neighbours on one side of the place along the sheet
    int order = 0;
    std::size_t neighbours = 0;
    bool usable = false;
    Eigen::VectorXd choice;  ///< difference of (value, time) to the second-best fit, part of `covariance`; empty: none

    // How value and time depend on the readings, for the errors that fits share (add_point_errors).
    std::vector<Neighbour> support;    ///< the neighbours fitted
    Eigen::VectorXd weights;           ///< of their images and times in (value, time)
    Eigen::VectorXd backward_weights;  ///< where the map was read backwards, of places and times, else empty
    Eigen::VectorXd unit;              ///< then the direction of the images, shape (n), scaled units
    Eigen::VectorXd measure;           ///< and what measures along it: measure' unit = 1
    struct Slopes {
        Eigen::MatrixXd image;  ///< dF/dx, shape (n, n)
        Eigen::VectorXd time;   ///< shape (n)
    } fitted;                   ///< not read backwards

    [[nodiscard]] Eigen::Index sheet_dimension() const { return slope.cols(); }
    [[nodiscard]] Eigen::MatrixXd jacobian() const { return slope * along; }  ///< shape (n, n), rank k
};

struct SheetSupport;

/// Fits of the map along a sheet.
class ManifoldMapFits {
public:
    /// @param reading_error  L, shape (n, n), lower triangular, scaled units: L L' is the covariance of a point's
    /// errors.
    ManifoldMapFits(const SectionPoints& points, const NeighbourIndex& grid, Eigen::MatrixXd reading_error);

    /// With these neighbours and order 2 or 3. usable = false: too few neighbours whose images do not tear apart, or no
    /// direction in which they spread beyond twice the reading errors.
    [[nodiscard]] ManifoldMap fit(const Eigen::VectorXd& place, int order, std::size_t neighbours) const;

    /// With the order and neighbours of the smallest rms of residuals times root of the leverage; the square of the
    /// difference to the second-best value is part of the covariance.
    [[nodiscard]] ManifoldMap best(const Eigen::VectorXd& place) const;

    [[nodiscard]] const SectionPoints& points() const { return *points_; }

    /// Dimension of the sheet on which the points lie within their errors: at 85 % of the places the neighbours spread
    /// along this many directions, with only noise across. Without a sheet the dimension of the points.
    [[nodiscard]] Eigen::Index sheet_dimension() const;

private:
    [[nodiscard]] ManifoldMap fit(const SheetSupport& support, int order, std::size_t neighbours, bool backwards) const;

    [[nodiscard]] Eigen::Index sheet_dimension_at(const Eigen::VectorXd& place) const;
    // Of an expanding one-dimensional map: the place as a function of the image.
    void read_backwards(ManifoldMap& map, const Eigen::MatrixXd& t, const Eigen::MatrixXd& values, int order) const;

    const SectionPoints* points_;
    const NeighbourIndex* grid_;
    Eigen::MatrixXd error_;      ///< L
    Eigen::MatrixXd whitening_;  ///< its inverse
};

}  // namespace orbid::orbits
