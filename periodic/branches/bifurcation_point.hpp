#pragma once

#include "periodic/branches/branch_curve.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/stability/stability.hpp"

namespace orbid::periodic {

/// The cubic through two points of a curve with their tangents. Its error inside is of fourth order in the distance;
/// beyond b it extrapolates.
class CurveCubic {
public:
    CurveCubic(const CurvePoint& a, const CurvePoint& b);
    [[nodiscard]] double length() const { return length_; }  ///< from a to b along the chord
    /// At a distance s from a.
    [[nodiscard]] VectorXd value(double s) const;
    [[nodiscard]] VectorXd slope(double s) const;
    /// Where the parameter takes the value that it has between distances lower and upper: by bisection.
    [[nodiscard]] double where_parameter(double value, double lower, double upper) const;

private:
    VectorXd a_, b_, slope_a_, slope_b_;
    double length_;
};

/// The bifurcations between two points of a curve, by the signs of the test functions at both.
struct Events {
    bool fold = false;
    bool branch_point = false;
    bool period_doubling = false;
    bool neimark_sacker = false;
    /// More than one of a kind may have been passed: the signs cannot tell, a shorter step would.
    bool several = false;

    [[nodiscard]] bool any() const { return fold || branch_point || period_doubling || neimark_sacker; }
};

///     fold              the parameter's share of the tangent
///     branch point      det(1 - M); a fold changes its sign as well
///     period doubling   det(1 + M)
///     Neimark-Sacker    ln |mu| of the complex pair nearest to the unit circle
///
/// M without the trivial multiplier. All are smooth along the curve, unlike single multipliers (pairs meet on the real
/// axis).
[[nodiscard]] Events events_between(const CurvePoint& a, const CurvePoint& b);

/// Largest move of a multiplier from a to b, relative to its size where that exceeds one; each is matched with the
/// nearest one.
[[nodiscard]] double largest_multiplier_move(const CurvePoint& a, const CurvePoint& b);

/// A bifurcation that was located.
struct LocatedPoint {
    bool found = false;  ///< everything else is meaningful only if so
    CurvePoint point;
    Bifurcation bifurcation = Bifurcation::none;
    double position = 0.0;         ///< distance from a along the chord
    double parameter_error = 0.0;  ///< change by the last steps of the search and of Newton's method
    double unfolding = 0.0;        ///< branch points: residual of the equations there
};

/// The zero of a test function between two points of a curve where it has different signs, by inverse quadratic
/// interpolation, secants and bisections. Every value belongs to an orbit solved on the curve.
[[nodiscard]] LocatedPoint located(const CurvePoint& a, const CurvePoint& b, Bifurcation bifurcation);

/// The orbit between two points of a curve at a given parameter between theirs; status says whether there is one.
[[nodiscard]] Correction orbit_between(const CurvePoint& a, const CurvePoint& b, double parameter);

}  // namespace orbid::periodic
