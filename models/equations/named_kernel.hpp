#pragma once

#include <algorithm>
#include <memory>
#include <utility>

#include "models/equations/equations.hpp"
#include "models/system/forwarding_kernel.hpp"

namespace orbid::models {

/// A kernel made from equations, with the names, units and claims of their text. The kernel behind it knows numbers
/// only; its coordinates, parameters and inputs have the order of the text.
class NamedKernel : public ForwardingKernel {
public:
    NamedKernel(std::shared_ptr<const Equations> equations, std::shared_ptr<const Kernel> computing)
        : ForwardingKernel(std::move(computing)), equations_(std::move(equations)) {}
    [[nodiscard]] const Equations& equations() const { return *equations_; }

    std::string_view name() const override { return equations_->text().name; }
    std::string_view variant() const override { return {}; }
    Kind kind() const override { return equations_->kind(); }
    bool stiff() const override { return equations_->text().stiff; }
    double evaluation_cost() const override {
        constexpr double compiled = 1.0 / 3.0;  // of what interpreted ones take
        return std::max(1.0, compiled * equations_->evaluation_cost());
    }
    std::span<const Coordinate> coordinates() const override { return equations_->coordinates(); }
    std::span<const Parameter> parameters() const override { return equations_->parameters(); }
    std::span<const Coordinate> inputs() const override { return equations_->inputs(); }
    std::optional<std::size_t> forcing_frequency() const override { return equations_->frequency(); }
    std::span<const double> symmetry_signs() const override {
        const auto& symmetry = equations_->text().symmetry;
        return symmetry ? std::span<const double>(symmetry->signs) : std::span<const double>{};
    }
    double symmetry_phase_shift() const override {
        const auto& symmetry = equations_->text().symmetry;
        return symmetry ? symmetry->phase_shift : 0.0;
    }
    bool smooth(const double* theta) const override { return equations_->smooth(theta); }

private:
    std::shared_ptr<const Equations> equations_;
};

}  // namespace orbid::models
