#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "models/ensembles/flow_block.hpp"
#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// Many flows of a model over the same durations in packs, with derivatives by the start and by four parameters at
/// once. More parameters take several passes with the same steps.
///
/// Flows of a forced model that all begin at the same phase share their steps, and the forcing at the nodes is computed
/// once. The number of steps per period follows from the tolerance and from trial flows.
template <FlowPackModel M, class Arch = xsimd::default_arch>
class PackedFlows final : public FlowBatch {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    static constexpr std::size_t N = n + 4;
    using Steps = FlowSteps<M, N, Arch>;

    /// @param kernel  of the same model, for the flows that packs cannot follow; must outlive this object, as starts
    PackedFlows(const Kernel& kernel, const FlowStarts& starts, std::span<const double> durations,
                std::span<const std::ptrdiff_t> free, const M& model = M())
        : kernel_(kernel),
          starts_(starts),
          durations_(durations.begin(), durations.end()),
          free_(free.begin(), free.end()) {
        std::size_t first = 0;
        do {
            State<Dual<N>, n> x{};
            auto p = array_from<Dual<N>, q>(starts.theta);
            seed<N, n, q>(x, p, free, first);
            passes_.push_back(std::make_unique<Pass>(p, starts, first, model));
            first += N - n;
        } while (first < free.size());
        if constexpr (ForcedModel<M>) share_steps();
    }

    void run(std::size_t first, std::size_t count, const FlowOutput* outputs, FlowEnd* ends) const override {
        std::vector<std::size_t> columns(count);
        for (std::size_t i = 0; i < count; ++i)
            columns[i] = first + i;
        for (const auto& pass : passes_) {
            FlowBlock<M, N, Arch> block(pass->steps, starts_, columns);
            const std::size_t directions = n + free_.size();
            block.run(durations_, pass->shared, [&](std::size_t i, std::size_t k) {
                const FlowOutput& output = outputs[i];
                for (std::size_t c = 0; c < n; ++c)
                    output.states[k * n + c] = block.value(i, c);
                if (output.sensitivities == nullptr) return;
                double* const to = output.sensitivities + k * directions * n;
                for (std::size_t j = 0; j < N && (j < n || pass->first + j < directions); ++j)
                    for (std::size_t c = 0; c < n; ++c)
                        to[(j < n ? j : pass->first + j) * n + c] = block.partial(i, c, j);
            });
            if (pass != passes_.back()) continue;
            for (std::size_t i = 0; i < count; ++i) {
                if (block.failed(i)) {
                    const std::size_t column = columns[i];
                    ends[i] = kernel_.flow({starts_.states + column * n, starts_.phases[column], starts_.theta,
                                            starts_.clock, starts_.options},
                                           durations_, free_, outputs[i]);
                    continue;
                }
                for (std::size_t c = 0; c < n; ++c)
                    outputs[i].stopped_state[c] = block.value(i, c);
                ends[i] = {FlowStatus::ok, durations_.empty() ? 0.0 : durations_.back(), block.steps(i),
                           block.crossings(i), 0};
            }
        }
    }

private:
    struct Pass {
        Steps steps;
        std::size_t first;  ///< free parameter with which it begins
        std::vector<SharedStep<Steps>> shared;
        Pass(const Values<Dual<N>, q>& p, const FlowStarts& starts, std::size_t first_, const M& model)
            : steps(p, starts.clock, starts.options, model), first(first_) {}
    };

    void share_steps() requires ForcedModel<M> {
        if (starts_.count == 0 || durations_.empty()) return;
        const double phase = starts_.phases[0];
        if (!std::all_of(starts_.phases, starts_.phases + starts_.count, [&](double p) { return p == phase; })) return;
        const double turn = 2.0 * std::numbers::pi;
        const double period = starts_.clock == Clock::phase ? turn : turn / starts_.theta[M::forcing_frequency];
        // A table of 4096 steps takes as many megabytes as a cache has.
        constexpr double most = 4096.0;
        const double tolerance = std::max(starts_.options.relative_tolerance, starts_.options.absolute_tolerance);
        double count = std::clamp(steps_at_1e12 * std::pow(1e-12 / tolerance, 1.0 / 9.0), 8.0, 400.0);
        if (durations_.back() / period * count > most) return;
        auto& shared = passes_.front()->shared;
        shared = shared_steps(passes_.front()->steps, phase, period / count);
        // A trial takes as long as about fifty flows.
        if (starts_.count >= 512) {
            std::vector<std::size_t> some;
            for (std::size_t i = 0; i < samples; ++i)
                some.push_back(i * starts_.count / samples);
            double best = cost(shared, some);
            for (double finer = count * root; durations_.back() / period * finer <= most; finer *= root) {
                auto steps = shared_steps(passes_.front()->steps, phase, period / finer);
                const double taken = cost(steps, some);
                if (!(taken < best)) break;
                best = taken;
                count = finer;
                shared = std::move(steps);
            }
        }
        for (std::size_t i = 1; i < passes_.size(); ++i)
            passes_[i]->shared = shared_steps(passes_[i]->steps, phase, period / count);
    }
    /// Cost of a flow in units of a shared step. A step that is too coarse for its trajectory costs about four.
    double cost(const std::vector<SharedStep<Steps>>& shared, const std::vector<std::size_t>& some) const {
        FlowBlock<M, N, Arch> block(passes_.front()->steps, starts_, some);
        block.run(durations_, shared, [](std::size_t, std::size_t) {});
        return static_cast<double>(shared.size()) +
               4.0 * static_cast<double>(block.coarse()) / static_cast<double>(some.size());
    }
    std::vector<SharedStep<Steps>> shared_steps(const Steps& steps, double phase,
                                                double longest) const requires ForcedModel<M> {
        std::vector<SharedStep<Steps>> shared;
        double from = 0.0;
        for (std::size_t k = 0; k < durations_.size(); ++k) {
            const double way = durations_[k] - from;
            if (!(way > 0.0)) continue;
            const auto count = static_cast<std::size_t>(std::ceil(way / longest * (1.0 - 1e-9)));
            const double length = way / static_cast<double>(count);
            for (std::size_t i = 0; i < count; ++i) {
                const double start = from + static_cast<double>(i) * length;
                const double end = i + 1 == count ? durations_[k] : from + static_cast<double>(i + 1) * length;
                shared.push_back({start, length, end, k, steps.field().forcing_of(phase, start, length)});
            }
            from = durations_[k];
        }
        return shared;
    }
    // For the parametric pendulum 27 leave many steps too coarse, 32 few; a trial finds what other models need.
    static constexpr double steps_at_1e12 = 32.0;
    static constexpr double root = 1.189207115002721;  ///< 2^(1/4)
    static constexpr std::size_t samples = 8;

    const Kernel& kernel_;
    FlowStarts starts_;
    std::vector<double> durations_;
    std::vector<std::ptrdiff_t> free_;
    std::vector<std::unique_ptr<Pass>> passes_;
};

}  // namespace orbid::models
