#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "models/arithmetic/dense_lu.hpp"
#include "models/trajectories/stepper.hpp"

namespace orbid::models {

/// Radau IIA of order 5: collocation at three points, the last one being the end of the step.
///
///     Z_i = h sum_j a_ij f(x + Z_j, s + c_j h),   x(s + h) = x + Z_3
///
/// Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.5 (method) and IV.8 (error
/// estimate, control of steps).
struct RadauMethod {
    static constexpr double root6 = 2.449489742783178098;
    static constexpr std::array<double, 3> nodes{(4.0 - root6) / 10.0, (4.0 + root6) / 10.0, 1.0};
    static constexpr std::array<std::array<double, 3>, 3> matrix{
        {{(88.0 - 7.0 * root6) / 360.0, (296.0 - 169.0 * root6) / 1800.0, (-2.0 + 3.0 * root6) / 225.0},
         {(296.0 + 169.0 * root6) / 1800.0, (88.0 + 7.0 * root6) / 360.0, (-2.0 - 3.0 * root6) / 225.0},
         {(16.0 - root6) / 36.0, (16.0 + root6) / 36.0, 1.0 / 9.0}}};
    /// The real eigenvalue of the inverse matrix: 30 / (6 + 81^(1/3) - 9^(1/3)).
    static constexpr double real_eigenvalue = 3.637834252744495732;
    /// Weights of Z_j in the comparison with a formula of order 3.
    static constexpr std::array<double, 3> comparison{-(13.0 + 7.0 * root6) / 3.0, (-13.0 + 7.0 * root6) / 3.0,
                                                      -1.0 / 3.0};
};

/// One step of the method, on values with N directions of derivative (of first or second order).
///
/// The stages are found by a simplified Newton method with the Jacobian at the start. Then Newton's method with the
/// exact Jacobian of every stage iterates until the values are accurate to rounding. The same exact matrix in dual
/// arithmetic gives the derivatives of the solution: each iteration one order of them. So derivatives are those of the
/// computed step, and the values are the same whatever N is.
template <Model M, std::size_t N, std::size_t order = 1>
class ImplicitStepper {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;
    using Stages = std::array<State<double, n>, 3>;

    ImplicitStepper(const Values<T, parameter_count_of<M>>& p, double phase, Clock clock, const M& model = M())
        : field_(p, phase, clock, model),
          values_(plain(p), phase, clock, model),
          slopes_(constant(plain(p)), phase, clock, model) {}

    [[nodiscard]] const M& model() const { return field_.model; }

    void set_input(const InputSignal* input) { field_.input = values_.input = slopes_.input = input; }
    void set_piece(std::size_t piece) { field_.piece = values_.piece = slopes_.piece = piece; }

    [[nodiscard]] Point slope(const Point& x, double s) const { return field_(x, s); }

    /// @param scale   what counts as an error of size one in each coordinate: allowed local errors
    /// @param stages  initial values of Z_i; overwritten by those of the step
    /// @return false where the iterations do not converge: the step is too long
    [[nodiscard]] bool step(const Point& x, double s, double ds, const State<double, n>& scale, Stages& stages,
                            Point& end) {
        const State<double, n> start = plain(x);
        if (!simplified(start, s, ds, scale, stages) || !exact(start, s, ds, stages)) return false;
        std::array<State<T, n>, 3> z;
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t k = 0; k < n; ++k)
                z[i][k] = T(stages[i][k]);
        for (std::size_t i = 0; i < order; ++i) {
            const auto change = correction<T>(field_, stage_lu_, x, s, ds, z);
            for (std::size_t j = 0; j < 3; ++j)
                for (std::size_t k = 0; k < n; ++k)
                    z[j][k] = z[j][k] - change[j * n + k];
        }
        for (std::size_t k = 0; k < n; ++k)
            end[k] = x[k] + z[2][k];
        for (std::size_t j = 0; j < 3; ++j)
            stages[j] = plain(z[j]);
        z_ = z;
        return true;
    }

    /// Difference to a formula of order 3 in the last step, unfiltered and filtered.
    struct Difference {
        Point plain;
        Point filtered;  ///< by (1 - h / gamma f_x)^-1: stiff directions count as they should
    };

    /// @param slope   dx/ds at the start
    /// @param refine  filter once more: at the first step, and after a rejected step, stiff directions have not settled
    ///                yet
    [[nodiscard]] Difference difference(const Point& x, double s, double ds, const Point& slope, bool refine) const {
        State<T, n> change;
        for (std::size_t k = 0; k < n; ++k) {
            change[k] = T(0.0);
            for (std::size_t j = 0; j < 3; ++j)
                change[k] = change[k] + z_[j][k] * (RadauMethod::comparison[j] / ds);
        }
        Difference e;
        const auto filter = [&](const Point& start_slope) {
            for (std::size_t k = 0; k < n; ++k) {
                e.filtered[k] = start_slope[k] + change[k];
                e.plain[k] = e.filtered[k] * (ds / RadauMethod::real_eigenvalue);
            }
            start_lu_.solve(e.filtered);
        };
        filter(slope);
        if (!refine) return e;
        Point moved;
        for (std::size_t k = 0; k < n; ++k)
            moved[k] = x[k] + e.filtered[k];
        filter(field_(moved, s));
        return e;
    }

private:
    static constexpr std::size_t m = 3 * n;
    using Jacobian = std::array<std::array<double, n>, n>;

    template <class S, std::size_t count>
    static std::array<double, count> plain(const std::array<S, count>& x) {
        std::array<double, count> v;
        for (std::size_t i = 0; i < count; ++i)
            v[i] = value_of(x[i]);
        return v;
    }
    template <std::size_t count>
    static std::array<Dual<n>, count> constant(const std::array<double, count>& x) {
        std::array<Dual<n>, count> c;
        for (std::size_t i = 0; i < count; ++i)
            c[i] = Dual<n>(x[i]);
        return c;
    }

    [[nodiscard]] Jacobian jacobian(const State<double, n>& x, double s) const {
        State<Dual<n>, n> at;
        for (std::size_t i = 0; i < n; ++i)
            at[i] = Dual<n>::variable(x[i], i);
        const auto f = slopes_(at, s);
        Jacobian j;
        for (std::size_t i = 0; i < n; ++i)
            j[i] = f[i].partial;
        return j;
    }

    /// I - h (a_ij J_j).
    [[nodiscard]] static bool factor(const std::array<Jacobian, 3>& j, double ds, DenseLu<m>& lu) {
        typename DenseLu<m>::Matrix a;
        for (std::size_t row = 0; row < m; ++row)
            for (std::size_t column = 0; column < m; ++column)
                a[row][column] = (row == column ? 1.0 : 0.0) -
                                 ds * RadauMethod::matrix[row / n][column / n] * j[column / n][row % n][column % n];
        return lu.factor(a);
    }

    /// M^-1 (Z - h sum_j a_ij f(x + Z_j)): what Newton's method takes away.
    template <class S, class F>
    [[nodiscard]] static std::array<S, m> correction(const F& field, const DenseLu<m>& lu, const State<S, n>& x,
                                                     double s, double ds, const std::array<State<S, n>, 3>& z) {
        std::array<State<S, n>, 3> f;
        for (std::size_t j = 0; j < 3; ++j) {
            State<S, n> at;
            for (std::size_t k = 0; k < n; ++k)
                at[k] = x[k] + z[j][k];
            f[j] = field(at, s + RadauMethod::nodes[j] * ds);
        }
        std::array<S, m> change;
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t k = 0; k < n; ++k) {
                S sum = f[0][k] * (ds * RadauMethod::matrix[i][0]);
                for (std::size_t j = 1; j < 3; ++j)
                    sum = sum + f[j][k] * (ds * RadauMethod::matrix[i][j]);
                change[i * n + k] = z[i][k] - sum;
            }
        lu.solve(change);
        return change;
    }

    /// Largest entry of a change in units of `scale`; nan comes out as infinity.
    [[nodiscard]] static double size_of(const std::array<double, m>& change, const State<double, n>& scale) {
        double size = 0.0;
        for (std::size_t i = 0; i < m; ++i) {
            const double part = std::abs(change[i]) / scale[i % n];
            if (!(part <= size)) size = std::isnan(part) ? std::numeric_limits<double>::infinity() : part;
        }
        return size;
    }
    static void take_away(Stages& z, const std::array<double, m>& change) {
        for (std::size_t i = 0; i < m; ++i)
            z[i / n][i % n] -= change[i];
    }

    /// Newton's method with the Jacobian at the start, to a hundredth of what is allowed.
    [[nodiscard]] bool simplified(const State<double, n>& x, double s, double ds, const State<double, n>& scale,
                                  Stages& z) {
        const Jacobian j = jacobian(x, s);
        typename DenseLu<n>::Matrix filter;
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t k = 0; k < n; ++k)
                filter[i][k] = (i == k ? RadauMethod::real_eigenvalue / ds : 0.0) - j[i][k];
        if (!start_lu_.factor(filter) || !factor({j, j, j}, ds, stage_lu_)) return false;
        double before = 0.0;
        // The book's limit of seven iterations keeps the cost low for large matrices.
        for (int i = 0; i < 10; ++i) {
            const auto change = correction<double>(values_, stage_lu_, x, s, ds, z);
            const double size = size_of(change, scale);
            if (!std::isfinite(size)) return false;
            take_away(z, change);
            if (size == 0.0) return true;
            if (i > 0) {
                const double rate = size / before;
                if (!(rate < 0.9)) return size <= 1e-3;
                if (rate / (1.0 - rate) * size <= 1e-2) return true;
            } else if (size <= 1e-6) {
                return true;
            }
            before = size;
        }
        return false;
    }

    /// Newton's method with the Jacobians of the stages: from the allowed errors to rounding, at most four times.
    [[nodiscard]] bool exact(const State<double, n>& x, double s, double ds, Stages& z) {
        for (int i = 0; i < 4; ++i) {
            std::array<Jacobian, 3> j;
            for (std::size_t stage = 0; stage < 3; ++stage) {
                State<double, n> at;
                for (std::size_t k = 0; k < n; ++k)
                    at[k] = x[k] + z[stage][k];
                j[stage] = jacobian(at, s + RadauMethod::nodes[stage] * ds);
            }
            if (!factor(j, ds, stage_lu_)) return false;
            const auto change = correction<double>(values_, stage_lu_, x, s, ds, z);
            take_away(z, change);
            State<double, n> size;
            for (std::size_t k = 0; k < n; ++k)
                size[k] = std::abs(x[k]) + std::abs(z[0][k]) + std::abs(z[1][k]) + std::abs(z[2][k]) + 1e-300;
            const double moved = size_of(change, size);
            if (!std::isfinite(moved)) return false;
            // The remaining error is its square; the matrix is exact to that order, and so are the derivatives.
            if (moved <= 1e-11) return true;
        }
        return true;
    }

    Field<M, N, order> field_;
    Field<M, 0> values_;
    Field<M, n> slopes_;
    DenseLu<n> start_lu_;
    DenseLu<m> stage_lu_;
    std::array<State<T, n>, 3> z_;
};

}  // namespace orbid::models
