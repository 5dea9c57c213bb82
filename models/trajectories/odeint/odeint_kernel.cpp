#include "models/trajectories/odeint/odeint_kernel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "models/system/forwarding_kernel.hpp"
#include "models/system/kernel_system.hpp"
#include "models/trajectories/odeint/odeint_section.hpp"

namespace orbid::models {

namespace {

/// Copies a solution's derivatives into columns of a matrix of n rows.
/// @return false when one has left the range of finite numbers
bool store(const std::vector<double>& y, std::size_t from, std::size_t count, double* columns) {
    const auto begin = y.begin() + static_cast<std::ptrdiff_t>(from), end = begin + static_cast<std::ptrdiff_t>(count);
    std::copy(begin, end, columns);
    return std::all_of(begin, end, [](double x) { return std::isfinite(x); });
}

/// A kernel whose equations are solved by Odeint.
class OdeintKernel final : public ForwardingKernel {
public:
    using ForwardingKernel::ForwardingKernel;

    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        if (!stays_smooth(start.theta, free)) return refused(start, output);
        const FlowEnd end = follow(start, durations, free, output.second_derivatives != nullptr ? 2 : 1, output);
        // Derivatives that nobody asked for, but that take part in the choice of steps, leave the range of numbers on
        // long chaotic motion: the values alone need not.
        if (output.sensitivities == nullptr && end.status == FlowStatus::not_finite)
            return follow(start, durations, free, 0, output);
        return end;
    }

    /// One by one.
    std::unique_ptr<const FlowBatch> flow_batch(const FlowStarts& /*starts*/, std::span<const double> /*durations*/,
                                                std::span<const std::ptrdiff_t> /*free*/) const override {
        return nullptr;
    }

    FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, const FlowOutput& output) const override {
        if (!stays_smooth(start.theta, free)) return refused(start, output);
        const bool derivatives = output.sensitivities != nullptr;
        OdeintSolution solution(*other(), start, free, derivatives ? 1 : 0);
        OdeintSection section(*other(), start, plane, solution);
        const std::size_t n = coordinates().size(), directions = n + free.size();
        FlowEnd end;
        std::copy(start.state, start.state + n, output.stopped_state);
        for (; end.crossings < count; ++end.crossings) {
            solution.limit_steps(solution.steps() + start.options.maximum_steps);
            auto crossing = section.next(end.stopped_after + longest);
            if (!crossing) break;
            end.stopped_after = output.times[end.crossings] = crossing->time;
            if (derivatives)
                move_along(*crossing, plane, directions, output.sensitivities + end.crossings * directions * n,
                           output.time_sensitivities + end.crossings * directions);
            std::copy_n(crossing->y.begin(), n, output.states + end.crossings * n);
            std::copy_n(crossing->y.begin(), n, output.stopped_state);
        }
        end.steps = solution.steps();
        if (end.crossings == count) return end;
        end.status = section.status();
        const double latest = end.stopped_after + longest;
        end.stopped_after = end.status == FlowStatus::no_crossing ? latest : solution.end();
        const auto y = solution.at(end.stopped_after);
        std::copy_n(y.begin(), n, output.stopped_state);
        return end;
    }

    void ensemble(const double* starts, std::size_t count, double phase, std::size_t periods, const double* theta,
                  const FlowOptions& options, double* const* sections, std::size_t* columns,
                  FlowStatus* status) const override {
        const std::size_t n = coordinates().size();
        for (std::size_t i = 0; i < count; ++i) {
            std::copy_n(starts + i * n, n, sections[i]);
            columns[i] = 1;
            status[i] = smooth(theta) ? FlowStatus::ok : FlowStatus::not_smooth;
            if (status[i] != FlowStatus::ok) continue;
            OdeintSolution solution(*other(), {starts + i * n, phase, theta, Clock::phase, options}, {}, 0);
            for (; columns[i] <= periods; ++columns[i]) {
                // The step budget holds for one call of a flow; here that is one period.
                solution.limit_steps(solution.steps() + options.maximum_steps);
                if (columns[i] > 1) solution.restart(sections[i] + (columns[i] - 1) * n);
                status[i] = solution.advance(2.0 * std::numbers::pi);
                if (status[i] != FlowStatus::ok) break;
                const auto y = solution.at(2.0 * std::numbers::pi);
                for (std::size_t c = 0; c < n; ++c)
                    sections[i][columns[i] * n + c] = coordinates()[c].angle ? wrapped(y[c]) : y[c];
            }
        }
    }
    std::size_t ensemble_block() const override { return 1; }

private:
    /// At these parameters, and when those by which derivatives are asked for change: f by a dry friction jumps also
    /// where there is none.
    [[nodiscard]] bool stays_smooth(const double* theta, std::span<const std::ptrdiff_t> free) const {
        if (!smooth(theta)) return false;
        std::vector<double> moved(theta, theta + parameters().size());
        return std::all_of(free.begin(), free.end(), [&](std::ptrdiff_t i) {
            const auto index = static_cast<std::size_t>(i);
            moved[index] += parameters()[index].typical_size;
            const bool still = smooth(moved.data());
            moved[index] = theta[index];
            return still;
        });
    }

    FlowEnd refused(const FlowStart& start, const FlowOutput& output) const {
        std::copy_n(start.state, coordinates().size(), output.stopped_state);
        FlowEnd end;
        end.status = FlowStatus::not_smooth;
        return end;
    }

    FlowEnd follow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                   int order, const FlowOutput& output) const {
        const std::size_t n = coordinates().size(), d = n + free.size();
        // Solutions of forced models run over the phase.
        const auto frequency = forcing_frequency();
        const double rate = frequency && start.clock == Clock::time ? start.theta[*frequency] : 1.0;
        OdeintSolution solution(*other(), start, free, order);
        FlowEnd end;
        for (std::size_t k = 0; k < durations.size() && end.status == FlowStatus::ok; ++k) {
            const double s = durations[k] * rate;
            end.status = solution.advance(s);
            if (end.status != FlowStatus::ok) break;
            auto y = solution.at(s);
            if (start.clock == Clock::time && output.sensitivities != nullptr) solution.at_fixed_time(y, s);
            std::copy_n(y.begin(), n, output.states + k * n);
            std::copy_n(y.begin(), n, output.stopped_state);
            end.stopped_after = durations[k];
            if (output.sensitivities != nullptr && !store(y, n, n * d, output.sensitivities + k * d * n))
                end.status = FlowStatus::not_finite;
            if (order == 2 && !store(y, n * (1 + d), n * d * d, output.second_derivatives + k * d * d * n))
                end.status = FlowStatus::not_finite;
        }
        if (end.status != FlowStatus::ok || durations.empty()) {
            end.stopped_after = solution.end() / rate;
            std::copy_n(solution.end_state().begin(), n, output.stopped_state);
        }
        end.steps = solution.steps();
        return end;
    }

    /// The derivatives of a solution at a fixed time become those of the point of crossing, which moves along with it:
    /// t_j = -(normal . x_j) / (normal . f).
    static void move_along(const OdeintSection::Crossing& crossing, const SectionPlane& plane, std::size_t directions,
                           double* columns, double* times) {
        const std::size_t n = crossing.f.size();
        double speed = 0.0;
        for (std::size_t i = 0; i < n; ++i)
            speed += plane.normal[i] * crossing.f[i];
        for (std::size_t j = 0; j < directions; ++j) {
            const double* column = crossing.y.data() + n + j * n;
            double across = 0.0;
            for (std::size_t i = 0; i < n; ++i)
                across += plane.normal[i] * column[i];
            times[j] = -across / speed;
            for (std::size_t i = 0; i < n; ++i)
                columns[j * n + i] = column[i] + crossing.f[i] * times[j];
        }
    }
};

}  // namespace

std::string odeint_refusal(const System& system) {
    if (system.kind() == Kind::map) return "a map is iterated, not integrated";
    if (system.stiff()) return "the model is stiff, and Odeint's stepper is explicit";
    if (!system.inputs().empty()) return "the model reads measured inputs, at whose instants steps have to end";
    if (dynamic_cast<const KernelSystem*>(&system) == nullptr) return "the system has no kernel of equations";
    return {};
}

std::shared_ptr<const System> odeint_system(const System& system) {
    if (const std::string why = odeint_refusal(system); !why.empty())
        throw std::invalid_argument(
            fmt::format("model {} cannot be integrated by Boost.Odeint: {}", system.name(), why));
    return std::make_shared<KernelSystem>(
        std::make_shared<OdeintKernel>(dynamic_cast<const KernelSystem&>(system).kernel()));
}

std::shared_ptr<const System> system_without_odeint(const System& system) {
    const auto* known = dynamic_cast<const KernelSystem*>(&system);
    const auto* kernel = known == nullptr ? nullptr : dynamic_cast<const OdeintKernel*>(known->kernel().get());
    return kernel == nullptr ? nullptr : std::make_shared<KernelSystem>(kernel->other());
}

}  // namespace orbid::models
