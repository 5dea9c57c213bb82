#pragma once

#include <array>
#include <concepts>
#include <cstddef>

#include "models/ensembles/flow_field.hpp"
#include "models/equations/interpreted_model.hpp"

namespace orbid::models {

/// A model whose equations are interpreted.
template <class M>
concept InterpretedPackModel = FlowPackModel<M> && std::derived_from<M, InterpretedShape<dimension_of<M>>>;

/// FlowField of an interpreted model. LocalDual leaves it to the compiler to find which partials are not zero. Here the
/// program knows, and computes only those, by formulas of their own.
template <InterpretedPackModel M, std::size_t N, class Arch>
class FlowField<M, N, Arch> : public FlowFieldBase<M, N, Arch> {
    using Base = FlowFieldBase<M, N, Arch>;

public:
    using Base::n, Base::free, Base::index;
    using typename Base::Numbers;
    using typename Base::P;
    using typename Base::Parametric;

    FlowField(const Values<Dual<N>, Base::q>& p, Clock clock, const M& model)
        : Base(p, clock, model), program_(*model.program) {
        for (std::size_t i = 0; i < program_.constant_count; ++i) {
            values_[i] = P(Base::scalar_[i].value);
            partials_[i] = Base::in_all_lanes(Base::scalar_[i]);
        }
    }

    [[nodiscard]] Parametric forcing_at(const P& phase, const P& s) const {
        if constexpr (ForcedModel<M>)
            return forced(Base::phase_at(phase, s));
        else
            return Base::phase_at(phase, s);
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
        slope.fill(P(0.0));
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
        if (!Base::rate_depends_) return;
        for (std::size_t c = 0; c < n; ++c)
            for (std::size_t j = 1; j <= free; ++j)
                slope[index(c, n + j)] = fma(Base::rate_[j], slope[index(c, 0)], slope[index(c, n + j)]);
    }

private:
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

    const EquationProgram& program_;
    std::array<P, EquationProgram::most_constants> values_;
    std::array<Parametric, EquationProgram::most_constants> partials_;
};

}  // namespace orbid::models
