#pragma once

#include "tests/estimator/interface/flow_residual.hpp"

namespace orbid::tests {

/// Multiple shooting: a node at every instant, its state latent, and matching conditions between neighbours,
///
///     e_b = y_b - z_b,   c_b = z_{b+1} - Phi(z_b; theta) = 0
///
/// All coordinates are read at every instant. The nodes start at the readings.
class NodeChainResidual : public estimator::Residual {
public:
    NodeChainResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                      StateReadings data)
        : system_(std::move(system)), binding_(std::move(binding)), data_(std::move(data)) {
        const Eigen::Index n = system_->dimension();
        const auto count = std::ssize(data_.times);
        for (std::ptrdiff_t b = 0; b < count; ++b) {
            estimator::BlockLayout block;
            block.label = "node " + std::to_string(b);
            for (Eigen::Index i = 0; i < n; ++i)
                block.group.push_back(data_.group_of(i));
            block.observed = data_.values.row(b).transpose();
            if (data_.deviation.size() > 0) block.deviation = data_.deviation.row(b).transpose();
            block.latents = n;
            if (b + 1 < count) {
                block.constraints = n;
                block.next = b + 1;
            }
            layout_.push_back(std::move(block));
        }
    }

    [[nodiscard]] std::string_view type() const override { return "nodes"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return data_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override {
        std::vector<Eigen::VectorXd> nodes;
        for (Eigen::Index b = 0; b < data_.values.rows(); ++b)
            nodes.emplace_back(data_.values.row(b).transpose());
        return nodes;
    }

    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        const Eigen::VectorXd all = binding_.values(theta);
        const bool possible = in_domain(*system_, all);
        for (std::size_t b = 0; b < layout_.size(); ++b)
            if (active.layout[b].active) values[b] = node(b, theta, all, possible, latents, derivatives);
        return values;
    }

private:
    [[nodiscard]] estimator::BlockValue node(std::size_t b, const Eigen::VectorXd& theta, const Eigen::VectorXd& all,
                                             bool possible, const std::vector<Eigen::VectorXd>& latents,
                                             bool derivatives) const {
        const Eigen::Index n = system_->dimension();
        const Eigen::VectorXd& z = latents[b];
        estimator::BlockValue value;
        value.status = estimator::BlockStatus::failed;
        if (!possible || !z.allFinite()) return value;
        value.e = data_.values.row(static_cast<Eigen::Index>(b)).transpose() - z;
        if (derivatives) {
            value.e_theta.setZero(n, theta.size());
            value.e_z = -Eigen::MatrixXd::Identity(n, n);
        }
        const Eigen::Index constraints = layout_[b].constraints;
        value.c.resize(constraints);
        if (derivatives) {
            value.c_theta.resize(constraints, theta.size());
            value.c_z.resize(constraints, n);
            value.c_next.resize(constraints, constraints > 0 ? n : 0);
        }
        value.status = estimator::BlockStatus::ok;
        if (constraints == 0) return value;
        const std::array<double, 1> duration{data_.times[b + 1] - data_.times[b]};
        const models::FlowResult flow =
            derivatives ? system_->flow_with_sensitivities(z, 0.0, duration, all, binding_.parameter,
                                                           models::Clock::time, flow_options())
                        : system_->flow(z, 0.0, duration, all, models::Clock::time, flow_options());
        if (flow.status != models::FlowStatus::ok) {
            value.status = estimator::BlockStatus::failed;
            return value;
        }
        value.c = latents[b + 1] - flow.states.col(0);
        if (derivatives) {
            value.c_z = -flow.sensitivities.leftCols(n);
            value.c_theta = -binding_.spread(flow.sensitivities.rightCols(std::ssize(binding_.parameter)));
            value.c_next.setIdentity();
        }
        return value;
    }

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    StateReadings data_;
    std::vector<estimator::BlockLayout> layout_;
};

}  // namespace orbid::tests
