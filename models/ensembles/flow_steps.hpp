#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>

#include "models/ensembles/flow_field.hpp"
#include "models/ensembles/step_coefficients.hpp"

namespace orbid::models {

/// Steps of a model with N directions of derivative in packs. Each lane has a time, a length and a side of its own.
///
/// Derivatives come from the same steps as the values (M4). The method is linear in the stages, so value and partials
/// of a lane are stepped in the same way. The result of a lane depends on that lane alone.
template <FlowPackModel M, std::size_t N, class Arch = xsimd::default_arch>
class FlowSteps {
public:
    using Field = FlowField<M, N, Arch>;
    using P = typename Field::P;
    using Numbers = typename Field::Numbers;
    using Forcing = typename Field::Forcing;
    static constexpr std::size_t n = Field::n, size = Field::size, controlled = Field::controlled;
    static constexpr std::size_t index(std::size_t c, std::size_t j) { return Field::index(c, j); }

    struct Step {
        Numbers end;
        P ratio;                  ///< of estimated to allowed error; infinite where the end is not finite
        P first_rise, last_rise;  ///< acceleration times duration at the start and close to the end (switching models)
    };
    /// A lane on the switching surface.
    struct Surface {
        Numbers x;
        P s;
        typename P::Mask close;    ///< found as precisely as the steps are
        typename P::Mask through;  ///< and clearly passed
    };

    /// @param p  with partials in the N directions
    FlowSteps(const Values<Dual<N>, parameter_count_of<M>>& p, Clock clock, const FlowOptions& options,
              const M& model = M())
        : field_(p, clock, model), options_(options), coefficients_(1.0) {}

    /// A step of ds from x at s.
    /// @param phase    of the forcing at s = 0
    /// @param forcing  of this step, the same for all lanes; nullptr: computed for each
    [[gnu::noinline]] void step(const Numbers& x, const P& phase, const P& s, const P& ds, const P& side,
                                const Forcing* forcing, Step& step) const {
        const P time = ds * field_.seconds();
        Numbers slopes[verner98.stages], at;
        typename Field::Parametric through{};
        for (std::size_t i = 0; i < verner98.stages; ++i) {
            sum(i, x, slopes, at);
            if constexpr (ForcedModel<M>) {
                if (forcing != nullptr) {
                    for (std::size_t j = 0; j < through.size(); ++j)
                        through[j] = P((*forcing)[i][j]);
                } else {
                    through = field_.forcing_at(phase, s + verner98.nodes[i] * ds);
                }
            }
            field_.slope(through, at, side, time, slopes[i]);
        }
        sum(Coefficients::result_row, x, slopes, step.end);
        judge(x, slopes, step);
        if constexpr (SwitchingModel<M>) {
            step.first_rise = slopes[0][index(velocity, 0)];
            step.last_rise = slopes[verner98.stages - 1][index(velocity, 0)];
        }
    }

    /// From the end of a step, close to the switching surface, to the surface and through it.
    ///
    /// The way there by the midpoint rule with the step that makes the velocity 0. The cube of its length is below all
    /// tolerances as long as it is less than 1e-4 of a step of `length`. Then (M5): one Newton step, dt* = -v / a-,
    /// makes the event time a dual number. It multiplies the partials of the velocity by a+ / a-; the slopes of the
    /// position agree.
    [[gnu::noinline]] void pass(const Numbers& near, const P& phase, const P& s, const P& length, const P& side,
                                Surface& surface) const requires SwitchingModel<M> {
        constexpr std::size_t v = index(velocity, 0);
        Numbers f, between;
        field_.slope(field_.forcing_at(phase, s), near, side, P(1.0), f);
        const P about = -near[v] / f[v];
        for (std::size_t k = 0; k < size; ++k)
            between[k] = fma(0.5 * about, f[k], near[k]);
        field_.slope(field_.forcing_at(phase, s + (0.5 / field_.seconds()) * about), between, side, P(1.0), f);
        const P correction = -near[v] / f[v];
        for (std::size_t k = 0; k < size; ++k)
            surface.x[k] = fma(correction, f[k], near[k]);
        surface.x[v] = P(0.0);
        const P way = (1.0 / field_.seconds()) * correction;
        surface.s = s + way;
        const typename Field::Parametric through = field_.forcing_at(phase, surface.s);
        field_.slope(through, surface.x, side, P(1.0), f);
        field_.slope(through, surface.x, -side, P(1.0), between);
        // Crossed, neither held nor grazing. The accelerations of both sides point across, and clearly so where they
        // differ (1e-6 of the jump; a Trajectory decides closer cases).
        const P arriving = side * f[v], leaving = side * between[v];
        const P margin = 1e-6 * abs(leaving - arriving);
        surface.close = abs(way) <= 1e-4 * length;
        surface.through = (arriving < -margin) & (leaving < -margin);
        const P factor = leaving / arriving;
        for (std::size_t j = 1; j <= N; ++j)
            surface.x[index(velocity, j)] *= factor;
    }

    /// Largest change of a coordinate over its size per unit of s, for a first guess at a step's length.
    [[nodiscard]] P rate_of_change(const Numbers& x, const P& phase, const P& side) const {
        Numbers f;
        field_.slope(field_.forcing_at(phase, P(0.0)), x, side, P(field_.seconds()), f);
        P rate(0.0);
        for (std::size_t c = 0; c < n; ++c)
            rate = max(rate, abs(f[index(c, 0)]) / (abs(x[index(c, 0)]) + 1e-3));
        return rate;
    }

    [[nodiscard]] const Field& field() const { return field_; }

private:
    using Coefficients = StepCoefficients<verner98>;

    /// Fourteen sums at a time stay in the sixteen registers.
    template <std::size_t count, std::size_t row_size = size>
    void sum_of(std::size_t row, const P* at, const Numbers* slopes, P* result) const {
        constexpr std::size_t pieces = (count + 13) / 14;
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            (coefficients_.template accumulate<count*(i + 1) / pieces - count * i / pieces, row_size>(
                 row, at + count * i / pieces, slopes->data() + count * i / pieces, result + count * i / pieces),
             ...);
        }
        (std::make_index_sequence<pieces>{});
    }
    [[gnu::noinline]] void sum(std::size_t row, const Numbers& at, const Numbers* slopes, Numbers& result) const {
        sum_of<size>(row, at.data(), slopes, result.data());
    }

    /// error_ratio() in packs.
    [[gnu::noinline]] void judge(const Numbers& x, const Numbers* slopes, Step& step) const {
        std::array<P, controlled> zero, error;
        zero.fill(P(0.0));
        sum_of<controlled>(Coefficients::error_row, zero.data(), slopes, error.data());
        step.ratio = P(0.0);
        auto finite = P(0.0) == P(0.0);
        for (std::size_t c = 0; c < n; ++c) {
            const P& end = step.end[index(c, 0)];
            P extent = max(abs(x[index(c, 0)]), abs(end));
            finite = finite & isfinite(end) & isfinite(error[index(c, 0)]);
            if (field_.model().coordinates[c].angle) extent = min(extent, P(std::numbers::pi));
            const P allowed = fma(options_.relative_tolerance, extent, P(options_.absolute_tolerance));
            step.ratio = max(step.ratio, abs(error[index(c, 0)]) / allowed);
        }
        for (std::size_t j = 1; j <= n; ++j) {
            P extent(1.0), worst(0.0);
            for (std::size_t c = 0; c < n; ++c) {
                extent = max(extent, abs(step.end[index(c, j)]));
                worst = max(worst, abs(error[index(c, j)]));
                finite = finite & isfinite(error[index(c, j)]);
            }
            step.ratio = max(step.ratio, worst / (10.0 * options_.relative_tolerance * extent));
        }
        step.ratio = select(finite, step.ratio, P(std::numeric_limits<double>::infinity()));
    }

    Field field_;
    FlowOptions options_;
    Coefficients coefficients_;
};

}  // namespace orbid::models
