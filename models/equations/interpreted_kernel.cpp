#include "models/equations/interpreted_kernel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "models/equations/interpreted_model.hpp"
#include "models/equations/interpreted_shape_choice.hpp"
#include "models/equations/named_kernel.hpp"

namespace orbid::models {

namespace {

/// Where each parameter stands in a shape: the frequency of a forcing first.
std::vector<std::size_t> places_of(const Equations& equations) {
    std::vector<std::size_t> places(equations.parameters().size());
    const auto frequency = equations.frequency();
    for (std::size_t i = 0; i < places.size(); ++i)
        places[i] = !frequency || i > *frequency ? i : i == *frequency ? 0 : i + 1;
    return places;
}

/// What a shape reads: the program and its coordinates, filled up to those of the shape.
struct Interpreted {
    std::vector<std::size_t> places;
    EquationProgram program;
    std::vector<Coordinate> coordinates;
    Interpreted(const Equations& equations, std::size_t size)
        : places(places_of(equations)),
          program(equation_program(equations, places)),
          coordinates(equations.coordinates().begin(), equations.coordinates().end()) {
        coordinates.resize(size, real("", "1"));
    }
};

/// A shape with N >= n coordinates as a kernel of n: starts are filled up, results picked out.
class InterpretedKernel final : public NamedKernel {
public:
    InterpretedKernel(const std::shared_ptr<const Equations>& equations, const InterpretedShapeChoice& shape,
                      std::unique_ptr<const Interpreted> interpreted)
        : NamedKernel(equations, shape.kernel(interpreted->program, interpreted->coordinates)),
          interpreted_(std::move(interpreted)),
          n_(equations->coordinates().size()),
          size_(shape.size) {}

    double evaluation_cost() const override { return equations().evaluation_cost(); }
    bool at_rest(const double* state, const double* theta) const override {
        return other()->at_rest(padded(state).data(), placed(theta).data());
    }
    void rhs(double phase, const double* state, const double* theta, const double* input, double* f) const override {
        std::vector<double> all(size_);
        other()->rhs(phase, padded(state).data(), placed(theta).data(), padded_input(input).data(), all.data());
        std::copy_n(all.begin(), n_, f);
    }
    void rhs_derivatives(double phase, const double* state, const double* theta, const double* input,
                         std::span<const std::ptrdiff_t> free, double* derivatives) const override {
        std::vector<double> all(size_ * (size_ + free.size()));
        other()->rhs_derivatives(phase, padded(state).data(), placed(theta).data(), padded_input(input).data(),
                                 placed(free), all.data());
        pick(all, 1, free.size(), derivatives);
    }
    void rhs_second_derivatives(double phase, const double* state, const double* theta, const double* input,
                                std::span<const std::ptrdiff_t> free, double* second, double* by_phase) const override {
        const std::size_t d = size_ + free.size();
        std::vector<double> all(size_ * d * d), all_by_phase(size_);
        other()->rhs_second_derivatives(phase, padded(state).data(), placed(theta).data(), padded_input(input).data(),
                                        placed(free), all.data(), all_by_phase.data());
        pick_second(all, 1, free.size(), second);
        std::copy_n(all_by_phase.begin(), n_, by_phase);
    }

    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        const Start from(*this, start);
        if (n_ == size_) return other()->flow(from.start, durations, placed(free), output);
        Padded all(*this, durations.size(), free.size(), output);
        const FlowEnd end = other()->flow(from.start, durations, placed(free), all.output);
        all.pick(*this, output);
        return end;
    }

    FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, const FlowOutput& output) const override {
        const Start from(*this, start);
        if (n_ == size_) return other()->crossings(from.start, plane, count, longest, placed(free), output);
        std::vector<double> normal(plane.normal.begin(), plane.normal.end());
        normal.resize(size_, 0.0);
        Padded all(*this, count, free.size(), output);
        const FlowEnd end = other()->crossings(from.start, {normal, plane.offset, plane.direction}, count, longest,
                                               placed(free), all.output);
        all.pick(*this, output);
        return end;
    }

    void instrument(const double* state, const double* theta, std::span<const std::ptrdiff_t> free, double* reading,
                    double* derivative) const override {
        Kernel::instrument(state, theta, free, reading, derivative);
    }

    std::unique_ptr<const FlowBatch> flow_batch(const FlowStarts& starts, std::span<const double> durations,
                                                std::span<const std::ptrdiff_t> free) const override {
        auto batch = std::make_unique<Batch>(*this, starts, durations.size(), free.size());
        batch->flows = other()->flow_batch(batch->starts, durations, placed(free));
        if (!batch->flows) return nullptr;
        return batch;
    }

    void ensemble(const double* starts, std::size_t count, double phase, std::size_t periods, const double* theta,
                  const FlowOptions& options, double* const* sections, std::size_t* columns,
                  FlowStatus* status) const override {
        const auto p = placed(theta);
        if (n_ == size_)
            return other()->ensemble(starts, count, phase, periods, p.data(), options, sections, columns, status);
        std::vector<double> from, all(count * size_ * (periods + 1));
        std::vector<double*> to;
        for (std::size_t i = 0; i < count; ++i) {
            const auto state = padded(starts + i * n_);
            from.insert(from.end(), state.begin(), state.end());
            to.push_back(all.data() + i * size_ * (periods + 1));
        }
        other()->ensemble(from.data(), count, phase, periods, p.data(), options, to.data(), columns, status);
        for (std::size_t i = 0; i < count; ++i)
            for (std::size_t k = 0; k < columns[i]; ++k)
                std::copy_n(to[i] + k * size_, n_, sections[i] + k * n_);
    }

private:
    std::vector<double> padded(const double* state) const {
        std::vector<double> all(state, state + n_);
        all.resize(size_, 0.0);
        return all;
    }
    std::vector<double> padded_input(const double* input) const {
        const std::size_t count = equations().inputs().size();
        std::vector<double> all(input, input + (input == nullptr ? 0 : count));
        all.resize(InterpretedInputs<1>::inputs.size(), 0.0);
        return all;
    }
    std::vector<double> placed(const double* theta) const {
        std::vector<double> all(EquationProgram::most_parameters, 1.0);
        for (std::size_t i = 0; i < interpreted_->places.size(); ++i)
            all[interpreted_->places[i]] = theta[i];
        return all;
    }
    std::vector<std::ptrdiff_t> placed(std::span<const std::ptrdiff_t> free) const {
        std::vector<std::ptrdiff_t> all;
        for (const std::ptrdiff_t i : free)
            all.push_back(static_cast<std::ptrdiff_t>(interpreted_->places[static_cast<std::size_t>(i)]));
        return all;
    }

    /// Which direction of the shape is direction j.
    [[nodiscard]] std::size_t padded(std::size_t j) const { return j < n_ ? j : j - n_ + size_; }
    /// Blocks of size_ + free columns to blocks of n_ + free.
    void pick(const std::vector<double>& all, std::size_t blocks, std::size_t free, double* to) const {
        for (std::size_t k = 0; k < blocks; ++k)
            for (std::size_t j = 0; j < n_ + free; ++j)
                std::copy_n(all.data() + (k * (size_ + free) + padded(j)) * size_, n_, to + (k * (n_ + free) + j) * n_);
    }
    /// The same of blocks for second derivatives.
    void pick_second(const std::vector<double>& all, std::size_t blocks, std::size_t free, double* to) const {
        const std::size_t d = n_ + free, padded_d = size_ + free;
        for (std::size_t k = 0; k < blocks; ++k)
            for (std::size_t i = 0; i < d; ++i)
                for (std::size_t j = 0; j < d; ++j)
                    std::copy_n(all.data() + ((k * padded_d + padded(i)) * padded_d + padded(j)) * size_, n_,
                                to + ((k * d + i) * d + j) * n_);
    }

    struct Start {
        std::vector<double> state, theta;
        FlowStart start;
        Start(const InterpretedKernel& kernel, const FlowStart& from)
            : state(kernel.padded(from.state)), theta(kernel.placed(from.theta)), start(from) {
            start.state = state.data();
            start.theta = theta.data();
        }
    };

    /// Room for the results of a shape with more coordinates.
    struct Padded {
        std::size_t count, free;
        std::vector<double> states, stopped, sensitivities, second, time_sensitivities;
        FlowOutput output{};
        Padded(const InterpretedKernel& kernel, std::size_t count_, std::size_t free_, const FlowOutput& like)
            : count(count_), free(free_), states(kernel.size_ * count_), stopped(kernel.size_) {
            const std::size_t d = kernel.size_ + free;
            const auto room = [](std::vector<double>& values, std::size_t size, const double* asked) -> double* {
                if (asked == nullptr) return nullptr;
                values.resize(size);
                return values.data();
            };
            output = {states.data(),
                      stopped.data(),
                      room(sensitivities, kernel.size_ * count * d, like.sensitivities),
                      room(second, kernel.size_ * count * d * d, like.second_derivatives),
                      like.times,
                      room(time_sensitivities, count * d, like.time_sensitivities)};
        }
        void pick(const InterpretedKernel& kernel, const FlowOutput& to) const {
            const std::size_t n = kernel.n_, size = kernel.size_;
            for (std::size_t k = 0; k < count; ++k)
                std::copy_n(states.data() + k * size, n, to.states + k * n);
            std::copy_n(stopped.begin(), n, to.stopped_state);
            if (to.sensitivities != nullptr) kernel.pick(sensitivities, count, free, to.sensitivities);
            if (to.second_derivatives != nullptr) kernel.pick_second(second, count, free, to.second_derivatives);
            if (to.time_sensitivities == nullptr) return;
            for (std::size_t k = 0; k < count; ++k)
                for (std::size_t i = 0; i < n + free; ++i)
                    to.time_sensitivities[k * (n + free) + i] =
                        time_sensitivities[k * (size + free) + kernel.padded(i)];
        }
    };

    struct Batch final : FlowBatch {
        const InterpretedKernel& kernel;
        std::vector<double> states, theta;
        FlowStarts starts;
        std::size_t durations, free;
        std::unique_ptr<const FlowBatch> flows;

        Batch(const InterpretedKernel& kernel_, const FlowStarts& from, std::size_t durations_, std::size_t free_)
            : kernel(kernel_), theta(kernel_.placed(from.theta)), starts(from), durations(durations_), free(free_) {
            for (std::size_t i = 0; i < from.count; ++i) {
                const auto state = kernel.padded(from.states + i * kernel.n_);
                states.insert(states.end(), state.begin(), state.end());
            }
            starts.states = states.data();
            starts.theta = theta.data();
        }
        void run(std::size_t first, std::size_t count, const FlowOutput* outputs, FlowEnd* ends) const override {
            if (kernel.n_ == kernel.size_) return flows->run(first, count, outputs, ends);
            std::vector<Padded> all;
            std::vector<FlowOutput> to;
            for (std::size_t i = 0; i < count; ++i)
                all.emplace_back(kernel, durations, free, outputs[i]);
            for (const Padded& each : all)
                to.push_back(each.output);
            flows->run(first, count, to.data(), ends);
            for (std::size_t i = 0; i < count; ++i)
                all[i].pick(kernel, outputs[i]);
        }
    };

    std::unique_ptr<const Interpreted> interpreted_;
    std::size_t n_, size_;
};

}  // namespace

std::shared_ptr<const Kernel> interpreted_kernel(const std::shared_ptr<const Equations>& equations, std::string& why) {
    const InterpretedShapeChoice shape = interpreted_shape_for(*equations, why);
    if (!shape.kernel) return nullptr;
    try {
        return std::make_shared<InterpretedKernel>(equations, shape,
                                                   std::make_unique<const Interpreted>(*equations, shape.size));
    } catch (const std::length_error&) {
        why = fmt::format("formulas with more than {} intermediate results at a time", FormulaCode::most_registers);
        return nullptr;
    }
}

}  // namespace orbid::models
