#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "estimator/interface/residual.hpp"
#include "models/definition/parameter.hpp"
#include "models/system/system.hpp"

namespace orbid::tests {

/// Readings of states at instants: what both residuals below predict.
struct StateReadings {
    /// Ascending. One more than rows of `values` when nothing is read at the first, where the initial state belongs.
    std::vector<double> times;
    std::vector<Eigen::Index> coordinates;  ///< which are read, in the order of the columns of `values`
    std::vector<estimator::Group> groups;   ///< one per coordinate read, or one for all
    Eigen::MatrixXd values;                 ///< shape (times, coordinates)
    Eigen::MatrixXd deviation;              ///< known sds of the readings, same shape; empty = 1

    [[nodiscard]] int group_of(Eigen::Index i) const { return groups.size() == 1 ? 0 : static_cast<int>(i); }
};

/// A number that is known, or an entry of theta.
struct StartValue {
    double value = 0.0;
    Eigen::Index estimated = -1;
};

/// Flows of the reference problems take some hundred steps: where ten times that is not enough, parameters are far from
/// anything that could be an estimate.
inline models::FlowOptions flow_options() {
    models::FlowOptions options;
    options.maximum_steps = 3000;
    return options;
}

/// Whether the system can be asked at these parameters: values outside their domains are no wrong call of the
/// estimator, only a place where nothing can be simulated.
inline bool in_domain(const models::System& system, const Eigen::VectorXd& all) {
    const auto table = system.parameters();
    for (std::size_t i = 0; i < table.size(); ++i)
        if (!models::contains(table[i].domain, all[static_cast<Eigen::Index>(i)])) return false;
    return true;
}

/// Single shooting: one flow from the first instant through all readings; no latent states.
class FlowResidual : public estimator::Residual {
public:
    FlowResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                 std::vector<StartValue> start, StateReadings data)
        : system_(std::move(system)), binding_(std::move(binding)), start_(std::move(start)), data_(std::move(data)) {
        estimator::BlockLayout block;
        block.label = "series";
        const Eigen::Index instants = data_.values.rows();
        const Eigen::Index observed = data_.values.cols();
        block.observed.resize(data_.values.size());
        if (data_.deviation.size() > 0) block.deviation.resize(data_.values.size());
        for (Eigen::Index k = 0; k < instants; ++k)
            for (Eigen::Index i = 0; i < observed; ++i) {
                block.group.push_back(data_.group_of(i));
                block.observed[k * observed + i] = data_.values(k, i);
                if (data_.deviation.size() > 0) block.deviation[k * observed + i] = data_.deviation(k, i);
            }
        layout_.push_back(std::move(block));
    }

    [[nodiscard]] std::string_view type() const override { return "flow"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return data_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return {Eigen::VectorXd(0)}; }

    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>&,
                                                              bool derivatives) const override {
        std::vector<estimator::BlockValue> values(1);
        if (!active.layout[0].active) return values;
        estimator::BlockValue& value = values[0];
        value.status = estimator::BlockStatus::failed;
        const Eigen::VectorXd all = binding_.values(theta);
        const Eigen::Index n = system_->dimension();
        Eigen::VectorXd x0(n);
        for (Eigen::Index i = 0; i < n; ++i) {
            const StartValue& start = start_[static_cast<std::size_t>(i)];
            x0[i] = start.estimated >= 0 ? theta[start.estimated] : start.value;
        }
        if (!in_domain(*system_, all) || !x0.allFinite()) return values;
        std::vector<double> durations;
        for (std::size_t k = data_.times.size() - static_cast<std::size_t>(data_.values.rows()); k < data_.times.size();
             ++k)
            durations.push_back(data_.times[k] - data_.times.front());
        const models::FlowResult flow =
            derivatives ? system_->flow_with_sensitivities(x0, 0.0, durations, all, binding_.parameter,
                                                           models::Clock::time, flow_options())
                        : system_->flow(x0, 0.0, durations, all, models::Clock::time, flow_options());
        if (flow.status != models::FlowStatus::ok) return values;
        value.status = estimator::BlockStatus::ok;
        const Eigen::Index observed = data_.values.cols();
        const Eigen::Index directions = n + std::ssize(binding_.parameter);
        value.e.resize(data_.values.size());
        if (derivatives) {
            value.e_theta.setZero(data_.values.size(), theta.size());
            value.e_z.resize(data_.values.size(), 0);
        }
        for (Eigen::Index k = 0; k < data_.values.rows(); ++k)
            for (Eigen::Index i = 0; i < observed; ++i) {
                const Eigen::Index row = k * observed + i;
                const Eigen::Index coordinate = data_.coordinates[static_cast<std::size_t>(i)];
                value.e[row] = data_.values(k, i) - flow.states(coordinate, k);
                if (!derivatives) continue;
                const Eigen::RowVectorXd slope = flow.sensitivity(k, directions).row(coordinate);
                value.e_theta.row(row) -= binding_.spread(slope.tail(directions - n));
                for (Eigen::Index j = 0; j < n; ++j)
                    if (const Eigen::Index entry = start_[static_cast<std::size_t>(j)].estimated; entry >= 0)
                        value.e_theta(row, entry) -= slope[j];
            }
        return values;
    }

private:
    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    std::vector<StartValue> start_;
    StateReadings data_;
    std::vector<estimator::BlockLayout> layout_;
};

}  // namespace orbid::tests
