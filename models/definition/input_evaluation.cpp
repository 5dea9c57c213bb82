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
        const double* c = coefficients_.data() + (piece * count_ + i) * terms_;
        double sum = c[terms_ - 1];
        for (std::size_t k = terms_ - 1; k-- > 0;)
            sum = c[k] + d * sum;
        values[i] = sum;
    }
}

void InputSignal::expand(std::size_t piece, double t, double* terms) const {
    const double d = t - times_[piece];
    for (std::size_t i = 0; i < count_; ++i) {
        const double* c = coefficients_.data() + (piece * count_ + i) * terms_;
        // Horner's scheme for the polynomial and its first two derivatives.
        double value = 0.0, first = 0.0, second = 0.0;
        for (std::size_t k = terms_; k-- > 0;) {
            second = first + d * second;
            first = value + d * first;
            value = c[k] + d * value;
        }
        terms[3 * i] = value;
        terms[3 * i + 1] = first;
        terms[3 * i + 2] = second;
    }
}

}  // namespace orbid::models
