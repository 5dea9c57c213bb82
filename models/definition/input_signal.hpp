#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::models {

/// Measured inputs u(t) of a model: values at ascending instants, interpolated between them.
///
/// linear        straight lines; u' jumps at every instant
/// cubic         the natural cubic spline through the values (u'' = 0 at both ends, u''' jumps at every instant)
/// held          the value of an instant until the next one, where u jumps (a zero-order hold)
/// band_limited  what a converter behind an anti-aliasing filter has read: the signal without content above half the
///               sampling rate (band_limited_derivatives), by polynomials of degree 7 between equidistant instants
///
/// Const and thread-safe. Nothing is extrapolated.
class InputSignal {
public:
    enum class Interpolation { linear, cubic, held, band_limited };

    /// @param times   [s], at least two, strictly ascending, finite; band_limited: equidistant within 5 % of a step
    /// @param values  count x times.size() finite numbers, the inputs of one instant beside each other
    /// @param count   number of inputs, > 0
    /// @throws DataError naming the instant or value that breaks a rule
    /// @throws std::invalid_argument when count is 0 or does not suit the number of values
    InputSignal(std::span<const double> times, std::span<const double> values, std::size_t count,
                Interpolation interpolation);

    [[nodiscard]] std::size_t count() const { return count_; }
    [[nodiscard]] Interpolation interpolation() const { return interpolation_; }
    [[nodiscard]] double first_time() const { return times_.front(); }
    [[nodiscard]] double last_time() const { return times_.back(); }
    [[nodiscard]] std::span<const double> times() const { return times_; }

    /// Piece [times[i], times[i + 1]) that t lies in; clamped to the first and the last piece.
    [[nodiscard]] std::size_t piece_at(double t) const;
    /// Values at t of the polynomials of a piece (also slightly outside of it), shape (count).
    void evaluate(std::size_t piece, double t, double* values) const;
    /// Value, u' and u'' / 2 at t of the polynomials of a piece, shape (3, count): three numbers for each input.
    void expand(std::size_t piece, double t, double* terms) const;

private:
    std::vector<double> times_;
    std::vector<double> coefficients_;  ///< per piece and input: c0 + c1 d + c2 d^2 + ..., d = t - times[piece]
    std::size_t count_;
    std::size_t terms_;  ///< coefficients of each piece and input
    Interpolation interpolation_;
};

/// "linear", "cubic", "held", "band_limited".
[[nodiscard]] std::string_view name(InputSignal::Interpolation interpolation);

}  // namespace orbid::models

#pragma GCC visibility pop
