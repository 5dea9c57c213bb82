#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <numbers>
#include <stdexcept>
#include <tuple>

#include "models/argument_check.hpp"
#include "models/flow.hpp"
#include "models/model_instance.hpp"
#include "models/period_grid.hpp"
#include "models/standstill.hpp"

namespace orbid::models {

/// A model behind the plain types of System: the one place where its templates are instantiated.
template <DescribedModel M>
class ModelSystem final : public System {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;

    std::string_view name() const override { return M::name; }
    std::string_view variant() const override {
        if constexpr (VariantModel<M>)
            return M::variant;
        else
            return {};
    }
    Kind kind() const override { return ForcedModel<M> ? Kind::forced : Kind::autonomous; }
    std::span<const Coordinate> coordinates() const override { return M::coordinates; }
    std::span<const Parameter> parameters() const override { return M::parameters; }

    std::optional<Symmetry> symmetry() const override {
        if constexpr (SymmetricModel<M>)
            return Symmetry{{M::symmetry_signs.begin(), M::symmetry_signs.end()}, M::symmetry_phase_shift};
        else
            return std::nullopt;
    }

    bool smooth(const Eigen::VectorXd& theta) const override {
        check_parameters(*this, theta);
        if constexpr (SwitchingModel<M>)
            return M::smooth(array_from<double, q>(theta));
        else
            return true;
    }

    double period([[maybe_unused]] const Eigen::VectorXd& theta, [[maybe_unused]] Clock clock) const override {
        if constexpr (ForcedModel<M>) {
            check_parameters(*this, theta);
            const double turn = 2.0 * std::numbers::pi;
            return clock == Clock::phase ? turn : turn / theta[M::forcing_frequency];
        } else {
            throw std::logic_error("model " + std::string(name()) + " is not forced: it has no period of forcing");
        }
    }

    bool at_rest(const Eigen::VectorXd& state, const Eigen::VectorXd& theta) const override {
        check_parameters(*this, theta);
        check_state(*this, state);
        return stands_still<M>(array_from<double, n>(state), array_from<double, q>(theta));
    }

    Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                        const Eigen::VectorXd& theta) const override {
        check_parameters(*this, theta);
        check_columns(*this, states, phases);
        const auto c = constants_from<M, double>(array_from<double, q>(theta));
        Eigen::MatrixXd f(states.rows(), states.cols());
        for (Eigen::Index k = 0; k < states.cols(); ++k) {
            const auto column =
                value_rhs<M>(phases[static_cast<std::size_t>(k)], array_from<double, n>(states.col(k)), c);
            for (std::size_t i = 0; i < n; ++i)
                f(static_cast<Eigen::Index>(i), k) = column[i];
        }
        return f;
    }

    FlowResult flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                    const Eigen::VectorXd& theta, Clock clock, const FlowOptions& options) const override {
        check_flow(*this, x0, phase, durations, theta, {}, clock, options);
        FlowResult result;
        result.states.resize(n, static_cast<Eigen::Index>(durations.size()));
        result.sensitivities.resize(n, 0);
        flow_pass<M, narrow_chunk<M>>(x0, phase, durations, theta, {}, 0, clock, options, result);
        return result;
    }

    FlowResult flow_with_sensitivities(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                                       const Eigen::VectorXd& theta, std::span<const Eigen::Index> free, Clock clock,
                                       const FlowOptions& options) const override {
        check_flow(*this, x0, phase, durations, theta, free, clock, options);
        const std::size_t directions = n + free.size();
        FlowResult result;
        result.states.resize(n, static_cast<Eigen::Index>(durations.size()));
        result.sensitivities.setZero(n, static_cast<Eigen::Index>(durations.size() * directions));
        std::size_t first = 0;
        do {
            if (free.size() - first <= narrow_chunk<M> - n) {
                flow_pass<M, narrow_chunk<M>>(x0, phase, durations, theta, free, first, clock, options, result);
                first += narrow_chunk<M> - n;
            } else {
                flow_pass<M, wide_chunk<M>>(x0, phase, durations, theta, free, first, clock, options, result);
                first += wide_chunk<M> - n;
            }
        } while (first < free.size());
        return result;
    }

    ReadingResult readings(const Sensor& sensor, const Eigen::MatrixXd& states, std::span<const double> phases,
                           const Eigen::VectorXd& theta, std::optional<std::span<const Eigen::Index>> free,
                           const FlowOptions& options) const override {
        check_parameters(*this, theta);
        check_columns(*this, states, phases);
        check_sensor(*this, sensor);
        check_options(options);
        if (free) check_free(*this, *free);
        const Eigen::Index directions = free ? static_cast<Eigen::Index>(n + free->size()) : 0;
        ReadingResult result;
        result.readings.resize(n, states.cols());
        result.derivatives.setZero(n, states.cols() * directions);
        // Columns are independent; one that cannot be continued gives the status of all, the first one winning.
        std::vector<FlowStatus> status(static_cast<std::size_t>(states.cols()), FlowStatus::ok);
        const auto one = [&](Eigen::Index k) {
            Eigen::Ref<Eigen::VectorXd> reading = result.readings.col(k);
            Eigen::Ref<Eigen::MatrixXd> derivative = result.derivatives.middleCols(k * directions, directions);
            instrument(states.col(k), theta, free, reading, derivative);
            if (sensor.type == Sensor::Type::angle_difference)
                status[static_cast<std::size_t>(k)] =
                    difference_quotient(sensor, states.col(k), phases[static_cast<std::size_t>(k)], theta, free,
                                        options, reading, derivative);
        };
        if (sensor.type == Sensor::Type::state) {
            for (Eigen::Index k = 0; k < states.cols(); ++k)
                one(k);
        } else {
            // 64 short flows: some ten microseconds, well above the cost of a task.
            oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<Eigen::Index>(0, states.cols(), 64),
                                      [&](const oneapi::tbb::blocked_range<Eigen::Index>& range) {
                                          for (Eigen::Index k = range.begin(); k != range.end(); ++k)
                                              one(k);
                                      });
        }
        for (const FlowStatus s : status)
            if (s != FlowStatus::ok && result.status == FlowStatus::ok) result.status = s;
        return result;
    }

    EnsembleResult ensemble(const Eigen::MatrixXd& starts, double phase, std::size_t periods,
                            const Eigen::VectorXd& theta, const FlowOptions& options) const override {
        check_parameters(*this, theta);
        check_options(options);
        const std::vector<double> phases(static_cast<std::size_t>(starts.cols()), phase);
        check_columns(*this, starts, phases);
        const auto count = static_cast<std::size_t>(starts.cols());
        EnsembleResult result;
        result.sections.resize(count);
        result.status.assign(count, FlowStatus::ok);
        if constexpr (!ForcedModel<M>) {
            throw std::logic_error("model " + std::string(name()) + " is not forced: it has no section by phase");
        } else {
            const Grid grid = grid_for(phase, theta, options);
            oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
                result.status[i] = sections_of(starts.col(static_cast<Eigen::Index>(i)), phase, periods, theta, options,
                                               grid, result.sections[i]);
            });
        }
        return result;
    }

private:
    struct NoGrid {};
    struct GridOf {
        template <class Model_>
        static auto type() {
            if constexpr (TabulatedModel<Model_>)
                return std::type_identity<PeriodGrid<Model_>>{};
            else
                return std::type_identity<NoGrid>{};
        }
    };
    using Grid = typename decltype(GridOf::template type<M>())::type;

    /// The table of the forcing, shared by all trajectories. Steps of the pendulum at tolerance 1e-12 number 40 to 50
    /// a period; order 8 makes that number go with the eighth root of the tolerance.
    static Grid grid_for([[maybe_unused]] double phase, [[maybe_unused]] const Eigen::VectorXd& theta,
                         [[maybe_unused]] const FlowOptions& options) {
        if constexpr (TabulatedModel<M>) {
            const double tolerance = std::max(options.relative_tolerance, options.absolute_tolerance);
            const double steps = std::clamp(steps_at_1e12 * std::pow(1e-12 / tolerance, 0.125), 8.0, 400.0);
            return Grid(array_from<double, q>(theta), phase, static_cast<std::size_t>(steps), options);
        } else {
            return {};
        }
    }
    // Measured (k1 = 0, four trajectories, bench/ensemble_bench): 64 steps take 1.26 times the time and leave a tenth
    // of the error (median 1.7e-13 a period instead of 1.7e-12); 40 take 1.23 times the time, as steps begin to fail.
    // Of the time a fifth goes to velocity zeros, and half to the sines of the table's stages, each waiting for the one
    // before.
    static constexpr double steps_at_1e12 = 48.0;

    /// Sections of one trajectory over whole periods.
    static FlowStatus sections_of(const Eigen::VectorXd& start, double phase, std::size_t periods,
                                  const Eigen::VectorXd& theta, const FlowOptions& options,
                                  [[maybe_unused]] const Grid& grid, Eigen::MatrixXd& sections) {
        sections.resize(n, static_cast<Eigen::Index>(periods + 1));
        sections.col(0) = start;
        auto x = array_from<double, n>(start);
        const auto p = array_from<double, q>(theta);
        // The step budget holds for one call of a flow; here that is one period.
        FlowOptions whole = options;
        whole.maximum_steps = std::numeric_limits<std::size_t>::max();
        Trajectory<M, 0> trajectory(p, x, phase, Clock::phase, whole);
        const auto next = [&]() -> FlowStatus {
            trajectory.limit_steps(trajectory.steps() + options.maximum_steps);
            if constexpr (TabulatedModel<M>) {
                return grid.advance(x, trajectory);
            } else {
                trajectory.restart(x);
                const FlowStatus status = trajectory.advance(2.0 * std::numbers::pi);
                x = trajectory.state();
                return status;
            }
        };
        for (std::size_t k = 1; k <= periods; ++k) {
            const FlowStatus status = next();
            if (status != FlowStatus::ok) {
                sections.conservativeResize(Eigen::NoChange, static_cast<Eigen::Index>(k));
                return status;
            }
            for (std::size_t i = 0; i < n; ++i) {
                if (M::coordinates[i].angle) x[i] = wrapped(x[i]);
                sections(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = x[i];
            }
        }
        return FlowStatus::ok;
    }

    /// What the instrument reads in a state, with derivatives with respect to it and the free parameters.
    static void instrument(const Eigen::VectorXd& state, [[maybe_unused]] const Eigen::VectorXd& theta,
                           const std::optional<std::span<const Eigen::Index>>& free,
                           Eigen::Ref<Eigen::VectorXd> reading, Eigen::Ref<Eigen::MatrixXd> derivative) {
        if constexpr (InstrumentModel<M>) {
            const auto values = M::instrument(array_from<double, n>(state), array_from<double, q>(theta));
            for (std::size_t i = 0; i < n; ++i)
                reading[static_cast<Eigen::Index>(i)] = values[i];
            if (!free) return;
            constexpr std::size_t N = wide_chunk<M>;
            std::size_t first = 0;
            do {
                auto x = array_from<Dual<N>, n>(state);
                auto p = array_from<Dual<N>, q>(theta);
                seed<N, n, q>(x, p, *free, first);
                const auto y = M::instrument(x, p);
                for (std::size_t i = 0; i < n; ++i)
                    for (std::size_t j = 0; j < N && (j < n || first + j < n + free->size()); ++j)
                        derivative(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j < n ? j : first + j)) =
                            y[i].partial[j];
                first += N - n;
            } while (first < free->size());
        } else {
            reading = state;
            if (free) derivative.leftCols(n).setIdentity();
        }
    }

    /// Replaces the rate by [angle(t + delay) - angle(t)] / delay; both angles as the instrument reads them.
    FlowStatus difference_quotient(const Sensor& sensor, const Eigen::VectorXd& state, double phase,
                                   const Eigen::VectorXd& theta,
                                   const std::optional<std::span<const Eigen::Index>>& free, const FlowOptions& options,
                                   Eigen::Ref<Eigen::VectorXd> reading, Eigen::Ref<Eigen::MatrixXd> derivative) const {
        const std::array<double, 1> delay{sensor.delay};
        const auto angle = static_cast<Eigen::Index>(sensor.angle);
        const auto rate = static_cast<Eigen::Index>(sensor.rate);
        FlowResult later = free ? flow_with_sensitivities(state, phase, delay, theta, *free, Clock::time, options)
                                : flow(state, phase, delay, theta, Clock::time, options);
        if (later.status != FlowStatus::ok) return later.status;
        Eigen::Matrix<double, static_cast<int>(n), 1> later_reading;
        const Eigen::Index directions = derivative.cols();
        Eigen::MatrixXd at_later = Eigen::MatrixXd::Zero(n, directions);
        instrument(later.states.col(0), theta, free, later_reading, at_later);
        reading[rate] = (later_reading[angle] - reading[angle]) / sensor.delay;
        if (free) {
            // Chain rule: through the later state, and directly through the parameters of the instrument.
            const auto nn = static_cast<Eigen::Index>(n);
            Eigen::RowVectorXd total = at_later.row(angle).leftCols(nn) * later.sensitivities;
            total.rightCols(directions - nn) += at_later.row(angle).rightCols(directions - nn);
            derivative.row(rate) = (total - derivative.row(angle)) / sensor.delay;
        }
        return FlowStatus::ok;
    }
};

namespace detail {
template <class M>
struct VariantsOf {
    using type = std::tuple<M>;
};
template <class M>
requires requires {
    typename M::variants;
}
struct VariantsOf<M> {
    using type = typename M::variants;
};
}  // namespace detail

template <class M>
ModelInstance instance_of() {
    return []<DescribedModel First, DescribedModel... Others>(std::type_identity<std::tuple<First, Others...>>) {
        return ModelInstance{First::name,
                             First::summary,
                             First::equations,
                             {std::make_shared<ModelSystem<First>>(), std::make_shared<ModelSystem<Others>>()...}};
    }
    (std::type_identity<typename detail::VariantsOf<M>::type>{});
}

}  // namespace orbid::models
