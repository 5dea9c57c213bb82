#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "estimator/estimate/estimate.hpp"

namespace orbid::tests {

/// A residual made of plain functions, one per block: what a test needs and nothing else.
class FunctionResidual : public estimator::Residual {
public:
    using Function =
        std::function<estimator::BlockValue(const Eigen::VectorXd& theta, const Eigen::VectorXd& z, bool derivatives)>;

    void add_group(estimator::Group group) { groups_.push_back(std::move(group)); }
    void add_block(estimator::BlockLayout layout, Function function, Eigen::VectorXd z = {}) {
        if (layout.latents > 0) structure_ = estimator::LatentStructure::independent_blocks;
        layout_.push_back(std::move(layout));
        functions_.push_back(std::move(function));
        latents_.push_back(std::move(z));
    }

    [[nodiscard]] std::string_view type() const override { return "function"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return structure_; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return latents_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        for (std::size_t b = 0; b < layout_.size(); ++b)
            if (active.layout[b].active) values[b] = functions_[b](theta, latents[b], derivatives);
        return values;
    }
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd&,
                                               const std::vector<Eigen::VectorXd>&,
                                               const Eigen::VectorXd&) const override {
        return on_update ? on_update(active) : estimator::RefreshReport{};
    }
    void deactivate(std::size_t block) { layout_[block].active = false; }

    std::function<estimator::RefreshReport(estimator::ActiveSet&)> on_update;

private:
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Function> functions_;
    std::vector<Eigen::VectorXd> latents_;
    estimator::LatentStructure structure_ = estimator::LatentStructure::none;
};

/// A chain made of plain functions, one per block: of its own latent states and those of the next block.
class FunctionChain : public estimator::Residual {
public:
    using Function = std::function<estimator::BlockValue(const Eigen::VectorXd& theta, const Eigen::VectorXd& z,
                                                         const Eigen::VectorXd& z_next)>;

    void add_group(estimator::Group group) { groups_.push_back(std::move(group)); }
    void add_block(estimator::BlockLayout layout, Function function, Eigen::VectorXd z) {
        layout_.push_back(std::move(layout));
        functions_.push_back(std::move(function));
        latents_.push_back(std::move(z));
    }

    [[nodiscard]] std::string_view type() const override { return "chain"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return structure_asked; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return latents_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        for (std::size_t b = 0; b < layout_.size(); ++b) {
            if (!active.layout[b].active) continue;
            const std::ptrdiff_t next = layout_[b].next;
            values[b] = functions_[b](theta, latents[b],
                                      next < 0 ? Eigen::VectorXd() : latents[static_cast<std::size_t>(next)]);
        }
        return values;
    }

    void deactivate(std::size_t block) { layout_[block].active = false; }

    estimator::LatentStructure structure_asked = estimator::LatentStructure::chain;

private:
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Function> functions_;
    std::vector<Eigen::VectorXd> latents_;
};

/// e = y - X theta - Z z.
inline FunctionResidual::Function linear(Eigen::VectorXd y, Eigen::MatrixXd x, Eigen::MatrixXd z = {}) {
    return [y = std::move(y), x = std::move(x), design = std::move(z)](const Eigen::VectorXd& theta,
                                                                       const Eigen::VectorXd& latents, bool) {
        estimator::BlockValue value;
        value.e = y - x * theta;
        value.e_theta = -x;
        value.e_z.resize(y.size(), 0);
        if (design.cols() > 0) {
            value.e -= design * latents;
            value.e_z = -design;
        }
        return value;
    };
}

inline estimator::BlockLayout layout(std::string label, Eigen::Index records, int group = 0) {
    estimator::BlockLayout block;
    block.label = std::move(label);
    block.group.assign(static_cast<std::size_t>(records), group);
    return block;
}

inline estimator::Group group(std::string name, double value = 0.0, bool estimate = true) {
    estimator::Group result;
    result.name = std::move(name);
    result.scale.value = value;
    result.scale.estimate = estimate;
    return result;
}

inline estimator::FreeParameter free_parameter(std::string name, double start) {
    estimator::FreeParameter parameter;
    parameter.name = std::move(name);
    parameter.start = start;
    return parameter;
}

}  // namespace orbid::tests
