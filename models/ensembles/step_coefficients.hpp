#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "models/definition/model.hpp"
#include "models/trajectories/explicit_method.hpp"

namespace orbid::models {

/// The nonzero coefficients of an explicit method, row by row, times the step length: what the step reads in its
/// stages. A short loop over this list runs twice as fast on packs as stages written out (1.4 against 2.9 ns a stage
/// and trajectory). GCC 12 spills the latter.
template <const auto& method>
class StepCoefficients {
public:
    static constexpr std::size_t stages = std::remove_cvref_t<decltype(method)>::stages;

    explicit StepCoefficients(double step) {
        std::size_t count = 0;
        for (std::size_t row = 0; row < rows; ++row) {
            first_[row] = count;
            for (std::size_t j = 0; j < stages; ++j)
                if (coefficient(row, j) != 0.0) terms_[count++] = {step * coefficient(row, j), j};
        }
        first_[rows] = count;
    }

    /// at + sum_j a_row,j slopes[j]
    template <class T, std::size_t n>
    [[nodiscard, gnu::always_inline]] State<T, n> sum(std::size_t row, const State<T, n>& at,
                                                      const State<T, n>* slopes) const {
        using std::fma;
        State<T, n> result = at;
        for (std::size_t k = first_[row]; k < first_[row + 1]; ++k) {
            const State<T, n>& slope = slopes[terms_[k].stage];
            for (std::size_t c = 0; c < n; ++c)
                result[c] = fma(terms_[k].coefficient, slope[c], result[c]);
        }
        return result;
    }

    /// result = at + sum_j a_row,j slopes[j] for `count` packs that are worked on together: they have to stay in
    /// registers. Those of the next stage lie `stride` further.
    template <std::size_t count, std::size_t stride, class P>
    [[gnu::always_inline]] void accumulate(std::size_t row, const P* at, const P* slopes, P* result) const {
        // Written out, as GCC turns loops of copies into calls of memcpy.
        [&]<std::size_t... c>(std::index_sequence<c...>) {
            P sum[count] = {at[c]...};
            for (std::size_t k = first_[row]; k < first_[row + 1]; ++k) {
                const P* const slope = slopes + terms_[k].stage * stride;
                ((sum[c] = fma(terms_[k].coefficient, slope[c], sum[c])), ...);
            }
            ((result[c] = sum[c]), ...);
        }
        (std::make_index_sequence<count>{});
    }

    /// Rows of the result and of the error estimate, which follow those of the stages.
    static constexpr std::size_t result_row = stages;
    static constexpr std::size_t error_row = stages + 1;

private:
    struct Term {
        double coefficient;
        std::size_t stage;
    };
    static constexpr std::size_t rows = stages + 2;
    static constexpr double coefficient(std::size_t row, std::size_t j) {
        if (row == result_row) return method.weights[j];
        if (row == error_row) return method.error[j];
        return method.matrix[row][j];
    }
    static constexpr std::size_t term_count() {
        std::size_t count = 0;
        for (std::size_t row = 0; row < rows; ++row)
            for (std::size_t j = 0; j < stages; ++j)
                count += coefficient(row, j) != 0.0 ? 1 : 0;
        return count;
    }
    std::array<Term, term_count()> terms_;
    std::array<std::size_t, rows + 1> first_;
};

/// One step of an explicit method with fused sums.
///
/// @param rate    rate(i, state): dx/ds at node i, in the unit that makes coefficients times rate a displacement
/// @param slopes  left behind: the rates at all stages; the first belongs to the start, the last to a state close to
/// the
///                end when the last node is 1
template <const auto& method, class T, std::size_t n, class Rate>
inline void explicit_step(const StepCoefficients<method>& coefficients, const State<T, n>& start, const Rate& rate,
                          State<T, n> (&slopes)[StepCoefficients<method>::stages], State<T, n>& end,
                          State<T, n>& error) {
    using Coefficients = StepCoefficients<method>;
    for (std::size_t i = 0; i < Coefficients::stages; ++i)
        slopes[i] = rate(i, coefficients.template sum<T, n>(i, start, slopes));
    end = coefficients.template sum<T, n>(Coefficients::result_row, start, slopes);
    State<T, n> zero;
    for (T& component : zero)
        component = T(0.0);
    error = coefficients.template sum<T, n>(Coefficients::error_row, zero, slopes);
}

}  // namespace orbid::models
