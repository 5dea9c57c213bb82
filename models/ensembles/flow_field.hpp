#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "models/definition/simulation.hpp"
#include "models/ensembles/local_dual.hpp"
#include "models/trajectories/explicit_method.hpp"

namespace orbid::models {

/// What fields of flows in packs have in common, whatever computes their equations: how numbers are stored, the clock,
/// and the forcing.
///
/// @tparam N  > dimension: the other directions are parameters.
template <FlowPackModel M, std::size_t N, class Arch>
class FlowFieldBase {
public:
    /// One register: with so many numbers per lane their sums hide the latency of an operation. Two took as long per
    /// trajectory and leave more lanes idle at a crossing.
    using P = Pack<1, Arch>;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    static_assert(N > n);
    /// Directions that are parameters.
    static constexpr std::size_t free = N - n;

    /// Values and derivatives of a point. First those that step control uses, values and derivatives by the start; then
    /// the derivatives by parameters.
    static constexpr std::size_t size = n * (N + 1);
    static constexpr std::size_t controlled = n * (n + 1);
    using Numbers = std::array<P, size>;
    /// Where the value (j = 0) of coordinate c and its partials (j = 1 + direction) stand.
    static constexpr std::size_t index(std::size_t c, std::size_t j) {
        return j <= n ? c * (n + 1) + j : controlled + c * free + j - n - 1;
    }
    /// A number that depends on parameters: its value, then its partials.
    using Parametric = std::array<P, 1 + free>;

    /// The forcing at the nodes of a step, with its partials by the parameters: the same for all lanes that take this
    /// step.
    using Forcing = std::array<std::array<double, 1 + free>, verner98.stages>;

    /// The forcing during a step of ds from s on of solutions that began at this phase.
    [[nodiscard]] Forcing forcing_of(double phase, double s, double ds) const requires ForcedModel<M> {
        Forcing forcing;
        for (std::size_t i = 0; i < forcing.size(); ++i) {
            const double at = s + verner98.nodes[i] * ds;
            Dual<N> through = clock_ == Clock::phase ? Dual<N>(phase + at) : omega_ * at + phase;
            if constexpr (TabulatedFlowModel<M>) through = model_.forcing(through, scalar_);
            forcing[i][0] = through.value;
            std::copy(through.partial.begin() + n, through.partial.end(), forcing[i].begin() + 1);
        }
        return forcing;
    }
    /// Seconds per unit of the clock.
    [[nodiscard]] double seconds() const { return seconds_; }
    [[nodiscard]] const M& model() const { return model_; }

protected:
    FlowFieldBase(const Values<Dual<N>, q>& p, Clock clock, const M& model)
        : model_(model), clock_(clock), scalar_(constants_from<M, Dual<N>>(p, model)) {
        if constexpr (ForcedModel<M>) {
            omega_ = p[M::forcing_frequency];
            if (clock == Clock::phase) {
                seconds_ = 1.0 / omega_.value;
                // The speed of the clock, divided by its value where omega is not free.
                const Dual<N> rate = omega_.value / omega_;
                rate_ = in_all_lanes(rate);
                rate_depends_ =
                    std::any_of(rate.partial.begin(), rate.partial.end(), [](double d) { return d != 0.0; });
            }
        }
    }

    static Parametric in_all_lanes(const Dual<N>& x) {
        Parametric same;
        same[0] = P(x.value);
        for (std::size_t j = 0; j < free; ++j)
            same[1 + j] = P(x.partial[n + j]);
        return same;
    }

    /// The phase at one instant of each lane; 0 unless forced.
    [[nodiscard]] Parametric phase_at([[maybe_unused]] const P& phase, [[maybe_unused]] const P& s) const {
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
        }
        return through;
    }

    [[no_unique_address]] M model_;
    Clock clock_;
    double seconds_ = 1.0;
    Constants<M, Dual<N>> scalar_;
    Dual<N> omega_{0.0};
    Parametric rate_{};
    bool rate_depends_ = false;  ///< on a parameter
};

/// Right hand side of a model and its derivatives in N directions (those of the start first) in packs,
///
///     (x, X)' = (f, f_x X + f_p),   per unit of a flow's clock over seconds()
template <FlowPackModel M, std::size_t N, class Arch = xsimd::default_arch>
class FlowField : public FlowFieldBase<M, N, Arch> {
    using Base = FlowFieldBase<M, N, Arch>;

public:
    using Base::n, Base::free, Base::index;
    using typename Base::Numbers;
    using typename Base::P;
    using typename Base::Parametric;

    /// @param p  with partials in the N directions
    FlowField(const Values<Dual<N>, Base::q>& p, Clock clock, const M& model = M()) : Base(p, clock, model) {
        for (std::size_t i = 0; i < m; ++i)
            constants_[i] = Base::in_all_lanes(Base::scalar_[i]);
    }

    /// The forcing at one instant of each lane.
    [[nodiscard]] Parametric forcing_at(const P& phase, const P& s) const {
        if constexpr (TabulatedFlowModel<M>)
            return forced(Base::phase_at(phase, s));
        else
            return Base::phase_at(phase, s);
    }
    /// dx/ds over seconds(), times `time`, by a right hand side on local variables: the coordinates, the constants, the
    /// forcing. Flattened: the model's functions have to be inlined, as the operations of packs are.
    [[gnu::noinline, gnu::flatten]] void slope(const Parametric& forcing, const Numbers& at,
                                               [[maybe_unused]] const P& side, const P& time, Numbers& slope) const {
        using Local = LocalDual<n + m + 1, P>;
        State<Local, n> x;
        std::array<Local, m> constants;
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            ((x[i] = Local::variable(at[index(i, 0)], i)), ...);
        }
        (std::make_index_sequence<n>{});
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            ((constants[i] = Local::variable(constants_[i][0], n + i)), ...);
        }
        (std::make_index_sequence<m>{});
        const Local through = Local::variable(forcing[0], n + m);
        State<Local, n> f;
        if constexpr (TabulatedFlowModel<M>)
            f = Base::model_.rhs_forced(through, x, constants, side);
        else if constexpr (SwitchingModel<M>)
            f = Base::model_.rhs(through, x, constants, side);
        else
            f = Base::model_.rhs(through, x, constants);
        [&]<std::size_t... c>(std::index_sequence<c...>) __attribute__((always_inline)) {
            (store<c>(f[c], forcing, at, time, slope), ...);
        }
        (std::make_index_sequence<n>{});
    }

private:
    static constexpr std::size_t m = std::tuple_size_v<Constants<M, double>>;

    /// sum of partial by each local variable times that variable's own partial in one direction.
    template <class Local>
    [[gnu::always_inline]] static void add(const Local& f, std::size_t variable, const P& by, P& sum, bool& any) {
        if (!f.depends_on(variable)) return;
        sum = any ? fma(f.partial(variable), by, sum) : f.partial(variable) * by;
        any = true;
    }

    [[gnu::noinline, gnu::flatten]] Parametric forced(const Parametric& phase) const {
        using Local = LocalDual<1 + m, P>;
        std::array<Local, m> constants;
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            ((constants[i] = Local::variable(constants_[i][0], 1 + i)), ...);
        }
        (std::make_index_sequence<m>{});
        const Local f = Base::model_.forcing(Local::variable(phase[0], 0), constants);
        Parametric through;
        through[0] = f.value;
        [&]<std::size_t... j>(std::index_sequence<j...>) __attribute__((always_inline)) {
            ((through[1 + j] = by_parameter<1 + j>(f, 0, phase, 1)), ...);
        }
        (std::make_index_sequence<free>{});
        return through;
    }
    /// df / d parameter at a fixed state.
    /// @param variable  local variable that is the forcing, or its phase
    /// @param first     first of the local variables that are the constants
    template <std::size_t j, class Local>
    [[gnu::always_inline]] P by_parameter(const Local& f, std::size_t variable, const Parametric& forcing,
                                          std::size_t first) const {
        P sum(0.0);
        bool any = false;
        if constexpr (ForcedModel<M>) add(f, variable, forcing[j], sum, any);
        add_constants<j>(f, first, sum, any);
        return sum;
    }
    template <std::size_t j, class Local>
    [[gnu::always_inline]] void add_constants(const Local& f, std::size_t first, P& sum, bool& any) const {
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            (add(f, first + i, constants_[i][j], sum, any), ...);
        }
        (std::make_index_sequence<m>{});
    }

    template <std::size_t c, class Local>
    [[gnu::always_inline]] void store(const Local& f, const Parametric& forcing, const Numbers& at, const P& time,
                                      Numbers& slope) const {
        slope[index(c, 0)] = time * f.value;
        [&]<std::size_t... j>(std::index_sequence<j...>) __attribute__((always_inline)) {
            ((slope[index(c, 1 + j)] = time * in_direction<j>(f, forcing, at)), ...);
        }
        (std::make_index_sequence<N>{});
        if (Base::rate_depends_)
            for (std::size_t j = 1; j <= free; ++j)
                slope[index(c, n + j)] = fma(Base::rate_[j], slope[index(c, 0)], slope[index(c, n + j)]);
    }
    template <std::size_t j, class Local>
    [[gnu::always_inline]] P in_direction(const Local& f, const Parametric& forcing, const Numbers& at) const {
        P sum(0.0);
        bool any = false;
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            (add(f, i, at[index(i, 1 + j)], sum, any), ...);
        }
        (std::make_index_sequence<n>{});
        if constexpr (j >= n) {
            if constexpr (ForcedModel<M>) add(f, n + m, forcing[1 + j - n], sum, any);
            add_constants<1 + j - n>(f, n, sum, any);
        }
        return sum;
    }

    std::array<Parametric, m> constants_;
};

}  // namespace orbid::models
