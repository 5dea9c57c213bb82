#pragma once

#include <cmath>
#include <cstddef>
#include <limits>

#include "models/definition/input_signal.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// The piece of a measured input that a solution is on, along the variable s of its flow: t = start + s [s].
///
/// A step that ends where a piece ends sees only one polynomial. Jumps of u' (linear) or u''' (cubic) at the instants
/// of the signal then do not lower the order of the method.
class InputKnots {
public:
    /// @param start  time [s] on the clock of the signal at s = 0
    InputKnots(const InputSignal& signal, double start) : signal_(&signal), start_(start) { enter(0.0); }

    /// Looks up the piece of s; later ones are reached by proceed().
    void enter(double s) { piece_ = signal_->piece_at(start_ + s); }

    [[nodiscard]] std::size_t piece() const { return piece_; }

    /// Moves to the piece that begins at s or contains it, on the way to `target`.
    /// @return false where the signal has not begun, or ends before the target is reached
    [[nodiscard]] bool proceed(double s, double target) {
        // Instants and the start are rounded, and so is their difference.
        const double slack =
            4.0 * std::numeric_limits<double>::epsilon() * (std::abs(start_) + std::abs(s) + std::abs(target));
        if (s < signal_->first_time() - start_ - slack) return false;
        const std::size_t pieces = signal_->times().size() - 1;
        while (piece_ + 1 < pieces && end_of(piece_) <= s)
            ++piece_;
        until_ = std::fmin(target, end_of(piece_));
        if (piece_ + 1 == pieces && target <= end_of(piece_) + slack) until_ = target;
        return s < until_;
    }
    /// Where the next step has to end at the latest.
    [[nodiscard]] double until() const { return until_; }

private:
    [[nodiscard]] double end_of(std::size_t piece) const { return signal_->times()[piece + 1] - start_; }

    const InputSignal* signal_;
    double start_;
    double until_ = 0.0;
    std::size_t piece_ = 0;
};

}  // namespace orbid::models

#pragma GCC visibility pop
