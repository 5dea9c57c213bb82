// What the flows of a model ask of a signal, in a file without other dependencies: compiled models include it.
#include <algorithm>

#include "models/definition/input_signal.hpp"

namespace orbid::models {

std::size_t InputSignal::piece_at(double t) const {
    const auto after = std::upper_bound(times_.begin() + 1, times_.end() - 1, t);
    return static_cast<std::size_t>(after - times_.begin()) - 1;
}

void InputSignal::evaluate(std::size_t piece, double t, double* values) const {
    const double d = t - times_[piece];
    for (std::size_t i = 0; i < count_; ++i) {
        const double* c = coefficients_.data() + (piece * count_ + i) * 4;
        values[i] = c[0] + d * (c[1] + d * (c[2] + d * c[3]));
    }
}

void InputSignal::expand(std::size_t piece, double t, double* terms) const {
    const double d = t - times_[piece];
    for (std::size_t i = 0; i < count_; ++i) {
        const double* c = coefficients_.data() + (piece * count_ + i) * 4;
        terms[3 * i] = c[0] + d * (c[1] + d * (c[2] + d * c[3]));
        terms[3 * i + 1] = c[1] + d * (2.0 * c[2] + d * 3.0 * c[3]);
        terms[3 * i + 2] = c[2] + d * 3.0 * c[3];
    }
}

}  // namespace orbid::models
