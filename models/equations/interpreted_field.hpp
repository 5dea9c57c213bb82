#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>

#include "models/ensembles/flow_field.hpp"
#include "models/equations/interpreted_model.hpp"

namespace orbid::models {

/// A model whose equations are interpreted.
template <class M>
concept InterpretedPackModel =
    FlowPackModel<M> && std::same_as<std::remove_cvref_t<decltype(M::coordinates)>, CoordinatesInUse<dimension_of<M>>>;

/// FlowField of an interpreted model. LocalDual leaves it to the compiler to find which partials are not zero. Here the
/// program knows, and computes only those, by formulas of their own.
template <InterpretedPackModel M, std::size_t N, class Arch>
class FlowField<M, N, Arch> {
public:
    using P = Pack<1, Arch>;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    static_assert(N > n);
    static constexpr std::size_t free = N - n;
    static constexpr std::size_t size = n * (N + 1);
    static constexpr std::size_t controlled = n * (n + 1);
    using Numbers = std::array<P, size>;
    static constexpr std::size_t index(std::size_t c, std::size_t j) {
        return j <= n ? c * (n + 1) + j : controlled + c * free + j - n - 1;
    }
    using Parametric = std::array<P, 1 + free>;
    using Forcing = std::array<std::array<double, 1 + free>, verner98.stages>;

    FlowField(const Values<Dual<N>, q>& p, Clock clock)
        : clock_(clock), program_(*equations_in_use.program), scalar_(constants_from<M, Dual<N>>(p)) {
        for (std::size_t i = 0; i < program_.constant_count; ++i) {
            values_[i] = P(scalar_[i].value);
            partials_[i] = in_all_lanes(scalar_[i]);
        }
        if constexpr (ForcedModel<M>) {
            omega_ = p[M::forcing_frequency];
            if (clock == Clock::phase) {
                seconds_ = 1.0 / omega_.value;
                const Dual<N> rate = omega_.value / omega_;
                rate_ = in_all_lanes(rate);
                rate_depends_ =
                    std::any_of(rate.partial.begin(), rate.partial.end(), [](double d) { return d != 0.0; });
            }
        }
    }

    [[nodiscard]] Forcing forcing_of(double phase, double s, double ds) const requires ForcedModel<M> {
        Forcing forcing;
        for (std::size_t i = 0; i < forcing.size(); ++i) {
            const double at = s + verner98.nodes[i] * ds;
            const Dual<N> through =
                M::forcing(clock_ == Clock::phase ? Dual<N>(phase + at) : omega_ * at + phase, scalar_);
            forcing[i][0] = through.value;
            std::copy(through.partial.begin() + n, through.partial.end(), forcing[i].begin() + 1);
        }
        return forcing;
    }

    [[nodiscard]] Parametric forcing_at([[maybe_unused]] const P& phase, [[maybe_unused]] const P& s) const {
        Parametric through;
        through.fill(P(0.0));
        if constexpr (ForcedModel<M>) {
            if (clock_ == Clock::phase) {
                through[0] = phase + s;
            } else {
                through[0] = fma(omega_.value, s, phase);
                for (std::size_t j = 0; j < free; ++j)
                    through[1 + j] = omega_.partial[n + j] * s;
            }
            through = forced(through);
        }
        return through;
    }

    [[gnu::noinline]] void slope(const Parametric& forcing, const Numbers& at, const P& side, const P& time,
                                 Numbers& slope) const {
        P registers[FormulaCode::most_registers];
        std::array<P, n> x;
        for (std::size_t c = 0; c < n; ++c)
            x[c] = at[index(c, 0)];
        const std::array<P*, FormulaCode::segment_count> given{registers, x.data(), const_cast<P*>(values_.data()),
                                                               const_cast<P*>(forcing.data()), x.data()};
        program_.linearised.run(given, &side);
        for (std::size_t k = 0; k < size; ++k)
            slope[k] = P(0.0);
        for (std::size_t c = 0; c < program_.coordinate_count; ++c)
            slope[index(c, 0)] = time * program_.linearised.result(given, c);
        for (std::size_t i = 0; i < program_.entries.size(); ++i) {
            const auto& [c, segment, variable] = program_.entries[i];
            const P partial = time * program_.linearised.result(given, program_.coordinate_count + i);
            if (segment == FormulaCode::coordinates) {
                for (std::size_t j = 1; j <= N; ++j)
                    slope[index(c, j)] = fma(partial, at[index(variable, j)], slope[index(c, j)]);
            } else {
                const Parametric& by = segment == FormulaCode::constants ? partials_[variable] : forcing;
                for (std::size_t j = 1; j <= free; ++j)
                    slope[index(c, n + j)] = fma(partial, by[j], slope[index(c, n + j)]);
            }
        }
        if (!rate_depends_) return;
        for (std::size_t c = 0; c < n; ++c)
            for (std::size_t j = 1; j <= free; ++j)
                slope[index(c, n + j)] = fma(rate_[j], slope[index(c, 0)], slope[index(c, n + j)]);
    }
    [[nodiscard]] double seconds() const { return seconds_; }

private:
    static constexpr std::size_t m = EquationProgram::most_constants;

    static Parametric in_all_lanes(const Dual<N>& x) {
        Parametric same;
        same[0] = P(x.value);
        for (std::size_t j = 0; j < free; ++j)
            same[1 + j] = P(x.partial[n + j]);
        return same;
    }
    [[gnu::noinline]] Parametric forced(const Parametric& phase) const {
        P registers[FormulaCode::most_registers];
        const std::array<P*, FormulaCode::segment_count> given{registers, nullptr, const_cast<P*>(values_.data()),
                                                               const_cast<P*>(phase.data()), nullptr};
        program_.linearised_forcing.run(given, static_cast<const P*>(nullptr));
        Parametric through;
        through.fill(P(0.0));
        through[0] = program_.linearised_forcing.result(given, 0);
        for (std::size_t i = 0; i < program_.forcing_entries.size(); ++i) {
            const auto& entry = program_.forcing_entries[i];
            const P partial = program_.linearised_forcing.result(given, 1 + i);
            const Parametric& by = entry.segment == FormulaCode::constants ? partials_[entry.variable] : phase;
            for (std::size_t j = 1; j <= free; ++j)
                through[j] = fma(partial, by[j], through[j]);
        }
        return through;
    }

    Clock clock_;
    double seconds_ = 1.0;
    const EquationProgram& program_;
    Constants<M, Dual<N>> scalar_;
    std::array<P, m> values_;
    std::array<Parametric, m> partials_;
    Dual<N> omega_{0.0};
    Parametric rate_{};
    bool rate_depends_ = false;
};

}  // namespace orbid::models
