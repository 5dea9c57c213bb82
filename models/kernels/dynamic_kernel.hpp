#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "models/kernels/dynamic_section.hpp"
#include "models/kernels/model_instance.hpp"

namespace orbid::models {

/// A DynamicModel of one size n behind Kernel.
template <DynamicModel M>
class DynamicKernel final : public Kernel {
public:
    static constexpr std::size_t q = parameter_count_of<M>;

    explicit DynamicKernel(std::size_t size, const M& model = M()) : model_(model) {
        names_.reserve(size);
        for (std::size_t i = 1; i <= size; ++i) {
            names_.emplace_back(model_.coordinate.name).append(std::to_string(i));
            coordinates_.push_back({names_.back(), model_.coordinate.unit, model_.coordinate.angle});
        }
    }

    std::string_view name() const override { return M::name; }
    Kind kind() const override { return Kind::autonomous; }
    std::span<const Coordinate> coordinates() const override { return coordinates_; }
    std::span<const Parameter> parameters() const override { return M::parameters; }

    /// An equilibrium, up to rounding: 1e-12 of the coordinate's size (at least one unit) per unit of time.
    bool at_rest(const double* state, const double* theta) const override {
        std::vector<double> f(coordinates_.size());
        rhs(0.0, state, theta, nullptr, f.data());
        for (std::size_t i = 0; i < f.size(); ++i)
            if (!(std::abs(f[i]) <= 1e-12 * (1.0 + std::abs(state[i])))) return false;
        return true;
    }

    void rhs(double /*phase*/, const double* state, const double* theta, const double* /*input*/,
             double* f) const override {
        Values<double, q> p;
        std::copy(theta, theta + q, p.begin());
        model_.rhs(0.0, std::span<const double>(state, coordinates_.size()), p,
                   std::span<double>(f, coordinates_.size()));
    }
    void rhs_derivatives(double /*phase*/, const double* state, const double* theta, const double* /*input*/,
                         std::span<const std::ptrdiff_t> free, double* derivatives) const override {
        using T = Dual<chunk>;
        const std::size_t n = coordinates_.size(), directions = n + free.size();
        for (std::size_t first = 0; first < directions; first += chunk) {
            std::vector<T> x(state, state + n), f(n);
            Values<T, q> p;
            std::copy(theta, theta + q, p.begin());
            const std::size_t count = std::min(chunk, directions - first);
            for (std::size_t j = 0; j < count; ++j)
                quantity(x, p, free, first + j).partial[j] = 1.0;
            model_.rhs(T(0.0), std::span<const T>(x), p, std::span<T>(f));
            for (std::size_t j = 0; j < count; ++j)
                for (std::size_t i = 0; i < n; ++i)
                    derivatives[(first + j) * n + i] = f[i].partial[j];
        }
    }

    void rhs_second_derivatives(double /*phase*/, const double* state, const double* theta, const double* /*input*/,
                                std::span<const std::ptrdiff_t> free, double* second, double* by_phase) const override {
        using T = Scalar<chunk, 2>;
        const std::size_t n = coordinates_.size(), directions = n + free.size();
        std::vector<T> x(n), f(n);
        for (std::size_t outer = 0; outer < directions; ++outer) {
            for (std::size_t first = 0; first < directions; first += chunk) {
                std::copy(state, state + n, x.begin());
                Values<T, q> p;
                std::copy(theta, theta + q, p.begin());
                const std::size_t count = std::min(chunk, directions - first);
                for (std::size_t j = 0; j < count; ++j)
                    first_order(quantity(x, p, free, first + j)).partial[j] = 1.0;
                quantity(x, p, free, outer).partial[0].value = 1.0;
                model_.rhs(T(0.0), std::span<const T>(x), p, std::span<T>(f));
                for (std::size_t j = 0; j < count; ++j)
                    for (std::size_t i = 0; i < n; ++i)
                        second[(outer * directions + first + j) * n + i] = f[i].partial[0].partial[j];
            }
        }
        std::fill(by_phase, by_phase + n, 0.0);
    }

    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        // The values are computed first, and alone if nothing else is asked for; every pass reproduces them.
        if (output.sensitivities == nullptr) return flow_pass<1>(start, durations, free, 0, output);
        const std::size_t directions = coordinates_.size() + free.size();
        FlowEnd end;
        for (std::size_t first = 0; first < directions && end.status == FlowStatus::ok; first += chunk - 1) {
            if (output.second_derivatives == nullptr) {
                end = flow_pass<chunk>(start, durations, free, first, output);
                continue;
            }
            for (std::size_t second = 0; second < directions && end.status == FlowStatus::ok; ++second)
                end = flow_pass<chunk, 2>(start, durations, free, first, output, second);
        }
        return end;
    }

    FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, const FlowOutput& output) const override {
        if (output.sensitivities == nullptr) return crossing_pass<1>(start, plane, count, longest, free, 0, output);
        FlowEnd end;
        const std::size_t directions = coordinates_.size() + free.size();
        for (std::size_t first = 0; first < directions && end.status == FlowStatus::ok; first += chunk - 1)
            end = crossing_pass<chunk>(start, plane, count, longest, free, first, output);
        return end;
    }

private:
    /// Directions carried at once: the probe of the step control and seven others. Two of the widest vector registers
    /// hold the eight partials.
    static constexpr std::size_t chunk = 8;

    /// The coordinate of the start, or the free parameter, that a direction is.
    template <class T>
    static T& quantity(std::vector<T>& x, Values<T, q>& p, std::span<const std::ptrdiff_t> free,
                       std::size_t direction) {
        return direction < x.size() ? x[direction] : p[static_cast<std::size_t>(free[direction - x.size()])];
    }

    /// The start with partials in the directions [first, first + N - 1), which follow the probe's; of order 2 also in
    /// the direction `second`.
    template <std::size_t N, std::size_t order = 1>
    DynamicTrajectory<M, N, order> trajectory_from(const FlowStart& start, std::size_t n,
                                                   std::span<const std::ptrdiff_t> free, std::size_t first,
                                                   [[maybe_unused]] std::size_t second = 0) const {
        using Path = DynamicTrajectory<M, N, order>;
        std::vector<typename Path::T> x(start.state, start.state + n);
        typename Path::Parameters p;
        std::copy(start.theta, start.theta + q, p.begin());
        for (std::size_t i = 1; i < N && first + i - 1 < n + free.size(); ++i)
            first_order(quantity(x, p, free, first + i - 1)).partial[i] = 1.0;
        if constexpr (order == 2) quantity(x, p, free, second).partial[0].value = 1.0;
        return {p, std::move(x), start.options, model_};
    }

    /// Copies partials but the probe's into the columns of their directions.
    /// @param get  the dual number of coordinate i
    /// @return false when one has left the range of finite numbers
    template <std::size_t N, class Get>
    static bool store(std::size_t n, const Get& get, std::size_t first, std::size_t directions, double* columns) {
        bool finite = true;
        for (std::size_t j = 1; j < N && first + j - 1 < directions; ++j) {
            for (std::size_t i = 0; i < n; ++i) {
                const double partial = get(i).partial[j];
                columns[(first + j - 1) * n + i] = partial;
                finite = finite && std::isfinite(partial);
            }
        }
        return finite;
    }
    template <class T>
    static void store_values(const std::vector<T>& x, double* state) {
        for (std::size_t i = 0; i < x.size(); ++i)
            state[i] = value_of(x[i]);
    }

    template <std::size_t N, std::size_t order = 1>
    FlowEnd flow_pass(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                      std::size_t first, const FlowOutput& output, std::size_t second = 0) const {
        const std::size_t n = coordinates_.size(), directions = n + free.size();
        auto trajectory = trajectory_from<N, order>(start, n, free, first, second);
        FlowEnd end;
        for (std::size_t k = 0; k < durations.size() && end.status == FlowStatus::ok; ++k) {
            end.status = trajectory.advance(durations[k]);
            if (end.status != FlowStatus::ok) break;
            const auto& x = trajectory.state();
            store_values(x, output.states + k * n);
            bool finite = true;
            if (output.sensitivities != nullptr)
                finite = store<N>(
                    n, [&x](std::size_t i) -> const Dual<N>& { return first_order(x[i]); }, first, directions,
                    output.sensitivities + k * directions * n);
            if constexpr (order == 2)
                finite = store<N>(
                             n, [&x](std::size_t i) -> const Dual<N>& { return x[i].partial[0]; }, first, directions,
                             output.second_derivatives + (k * directions + second) * directions * n) &&
                         finite;
            if (!finite) end.status = FlowStatus::not_finite;
        }
        finish(trajectory, output, end);
        return end;
    }

    template <std::size_t N>
    FlowEnd crossing_pass(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                          std::span<const std::ptrdiff_t> free, std::size_t first, const FlowOutput& output) const {
        const std::size_t n = coordinates_.size(), directions = n + free.size();
        auto trajectory = trajectory_from<N>(start, n, free, first);
        DynamicSection<M, N> section(plane, trajectory);
        FlowEnd end;
        double latest = 0.0;
        for (std::size_t k = 0; k < count && end.status == FlowStatus::ok; ++k) {
            end.status = section.next(latest + longest);
            if (end.status != FlowStatus::ok) break;
            latest = section.time().value;
            output.times[k] = latest;
            const bool derivatives = output.sensitivities != nullptr;
            const auto& x = section.state();
            store_values(x, output.states + k * n);
            bool finite = !derivatives || store<N>(
                                              n, [&x](std::size_t i) -> const Dual<N>& { return x[i]; }, first,
                                              directions, output.sensitivities + k * directions * n);
            for (std::size_t j = 1; derivatives && j < N && first + j - 1 < directions; ++j) {
                output.time_sensitivities[k * directions + first + j - 1] = section.time().partial[j];
                finite = finite && std::isfinite(section.time().partial[j]);
            }
            if (!finite) end.status = FlowStatus::not_finite;
            ++end.crossings;
        }
        finish(trajectory, output, end);
        return end;
    }

    template <class Path>
    static void finish(const Path& trajectory, const FlowOutput& output, FlowEnd& end) {
        end.stopped_after = trajectory.time();
        end.steps = trajectory.steps();
        store_values(trajectory.state(), output.stopped_state);
    }

    [[no_unique_address]] M model_;
    std::vector<std::string> names_;
    std::vector<Coordinate> coordinates_;  ///< their names are views of names_
};

}  // namespace orbid::models
