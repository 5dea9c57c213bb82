#pragma once

#include <algorithm>
#include <memory>
#include <tuple>
#include <type_traits>

#include "models/definition/model_check.hpp"
#include "models/ensembles/extrapolated_flow.hpp"
#include "models/ensembles/flow_batch.hpp"
#include "models/ensembles/map_ensemble.hpp"
#include "models/ensembles/section_ensemble.hpp"
#include "models/kernels/dynamic_kernel.hpp"
#include "models/kernels/model_instance.hpp"
#include "models/trajectories/field_derivatives.hpp"
#include "models/trajectories/flow.hpp"
#include "models/trajectories/section_crossing.hpp"
#include "models/trajectories/standstill.hpp"

namespace orbid::models {

/// The templates of a model M behind Kernel. They are instantiated here and nowhere else.
template <DescribedModel M>
class ModelKernel final : public Kernel {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;

    explicit ModelKernel(const M& model = M()) : model_(model) {}

    std::string_view name() const override { return M::name; }
    std::string_view variant() const override {
        if constexpr (VariantModel<M>)
            return M::variant;
        else
            return {};
    }
    Kind kind() const override { return MapModel<M> ? Kind::map : ForcedModel<M> ? Kind::forced : Kind::autonomous; }
    bool stiff() const override { return StiffModel<M>; }
    std::span<const Coordinate> coordinates() const override { return model_.coordinates; }
    std::span<const Parameter> parameters() const override { return M::parameters; }
    std::span<const Coordinate> inputs() const override {
        if constexpr (InputModel<M>)
            return M::inputs;
        else
            return {};
    }
    std::optional<std::size_t> forcing_frequency() const override {
        if constexpr (ForcedModel<M>)
            return M::forcing_frequency;
        else
            return std::nullopt;
    }
    std::span<const double> symmetry_signs() const override {
        if constexpr (SymmetricModel<M>)
            return M::symmetry_signs;
        else
            return {};
    }
    double symmetry_phase_shift() const override {
        if constexpr (SymmetricModel<M>)
            return M::symmetry_phase_shift;
        else
            return 0.0;
    }

    bool smooth([[maybe_unused]] const double* theta) const override {
        if constexpr (SwitchingModel<M> || SurfaceModel<M>)
            return model_.smooth(array_from<double, q>(theta));
        else
            return true;
    }

    bool at_rest(const double* state, const double* theta) const override {
        return stands_still<M>(array_from<double, n>(state), array_from<double, q>(theta), model_);
    }

    void rhs(double phase, const double* state, const double* theta, [[maybe_unused]] const double* input,
             double* f) const override {
        const auto values =
            value_rhs<M>(phase, array_from<double, n>(state), array_from<double, q>(theta), input, model_);
        std::copy(values.begin(), values.end(), f);
    }
    void rhs_derivatives(double phase, const double* state, const double* theta, const double* input,
                         std::span<const std::ptrdiff_t> free, double* derivatives) const override {
        store_field_derivatives<M>(phase, state, theta, input, free, derivatives, model_);
    }
    void rhs_second_derivatives(double phase, const double* state, const double* theta, const double* input,
                                std::span<const std::ptrdiff_t> free, double* second, double* by_phase) const override {
        store_second_field_derivatives<M>(phase, state, theta, input, free, second, by_phase, model_);
    }

    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        FlowEnd end;
        if (output.second_derivatives != nullptr) {
            in_second_order_passes<M>(free.size(), [&]<std::size_t N>(std::size_t first, std::size_t direction) {
                end = flow_pass<M, N, 2>(start, durations, free, first, output, direction, model_);
            });
            return end;
        }
        if constexpr (ExtrapolatedModel<M>) {
            if (kept_by_extrapolation(start.options) && extrapolated_flow(start, durations, free, output, end, model_))
                return end;
        }
        in_passes<M>(free.size(), [&]<std::size_t N>(std::size_t first) {
            end = flow_pass<M, N>(start, durations, free, first, output, 0, model_);
        });
        return end;
    }

    std::unique_ptr<const FlowBatch> flow_batch([[maybe_unused]] const FlowStarts& starts,
                                                [[maybe_unused]] std::span<const double> durations,
                                                [[maybe_unused]] std::span<const std::ptrdiff_t> free) const override {
        if constexpr (FlowPackModel<M>) {
            // Sums in packs are rounded without correction; single flows carry the rounding error along.
            if (starts.options.relative_tolerance >= 1e-13)
                return std::make_unique<PackedFlows<M>>(*this, starts, durations, free, model_);
        }
        return nullptr;
    }

    FlowEnd crossings([[maybe_unused]] const FlowStart& start, [[maybe_unused]] const SectionPlane& plane,
                      [[maybe_unused]] std::size_t count, [[maybe_unused]] double longest,
                      [[maybe_unused]] std::span<const std::ptrdiff_t> free,
                      [[maybe_unused]] const FlowOutput& output) const override {
        FlowEnd end;
        // KernelSystem calls this for autonomous models only.
        if constexpr (!MapModel<M> && !ForcedModel<M>) {
            // Many returns are computed without derivatives, which would overflow on chaotic motion.
            if (output.sensitivities == nullptr)
                return crossing_pass<M, 0>(start, plane, count, longest, {}, 0, output, model_);
            in_passes<M>(free.size(), [&]<std::size_t N>(std::size_t first) {
                end = crossing_pass<M, N>(start, plane, count, longest, free, first, output, model_);
            });
        }
        return end;
    }

    void instrument(const double* state, const double* theta, std::span<const std::ptrdiff_t> free, double* reading,
                    double* derivative) const override {
        if constexpr (InstrumentModel<M>) {
            const auto values = model_.instrument(array_from<double, n>(state), array_from<double, q>(theta));
            std::copy(values.begin(), values.end(), reading);
            if (derivative == nullptr) return;
            in_passes<M>(free.size(), [&]<std::size_t N>(std::size_t first) {
                auto x = array_from<Dual<N>, n>(state);
                auto p = array_from<Dual<N>, q>(theta);
                seed<N, n, q>(x, p, free, first);
                store_partials<N, n>(model_.instrument(x, p), first, n + free.size(), derivative);
            });
        } else {
            Kernel::instrument(state, theta, free, reading, derivative);
        }
    }

    void ensemble([[maybe_unused]] const double* starts, [[maybe_unused]] std::size_t count,
                  [[maybe_unused]] double phase, [[maybe_unused]] std::size_t periods,
                  [[maybe_unused]] const double* theta, [[maybe_unused]] const FlowOptions& options,
                  [[maybe_unused]] double* const* sections, [[maybe_unused]] std::size_t* columns,
                  [[maybe_unused]] FlowStatus* status) const override {
        if constexpr (MapModel<M>) {
            MapEnsemble<M>(array_from<double, q>(theta), options.interrupted, model_)
                .advance(starts, count, periods, sections, columns, status);
        } else if constexpr (ForcedModel<M>) {
            SectionEnsemble<M>(array_from<double, q>(theta), phase, options, model_)
                .advance(starts, count, periods, sections, columns, status);
        }
    }
    std::size_t ensemble_block() const override {
        if constexpr (ForcedModel<M>)
            return SectionEnsemble<M>::block;
        else if constexpr (MapModel<M>)
            return MapEnsemble<M>::block;
        else
            return 1;
    }

private:
    [[no_unique_address]] M model_;
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
    // Any defect of a model is reported here, with one sentence.
    if constexpr (!is_complete<M>()) {
        return {};
    } else if constexpr (DynamicModel<M>) {
        const auto kernel_of_size = [](std::size_t size) -> std::shared_ptr<const Kernel> {
            return std::make_shared<DynamicKernel<M>>(size);
        };
        return {M::name,        M::summary,       M::equations,   {kernel_of_size(M::default_size)},
                kernel_of_size, M::smallest_size, M::default_size};
    } else {
        return []<DescribedModel First, DescribedModel... Others>(std::type_identity<std::tuple<First, Others...>>) {
            return ModelInstance{First::name,
                                 First::summary,
                                 First::equations,
                                 {std::make_shared<ModelKernel<First>>(), std::make_shared<ModelKernel<Others>>()...}};
        }
        (std::type_identity<typename detail::VariantsOf<M>::type>{});
    }
}

}  // namespace orbid::models
