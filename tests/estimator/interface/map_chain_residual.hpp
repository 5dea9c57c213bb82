#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "estimator/estimate/estimate.hpp"

namespace orbid::tests {

/// A map z -> F(z; theta) with its derivatives.
struct MapValue {
    Eigen::VectorXd next;
    Eigen::MatrixXd by_state;
    Eigen::MatrixXd by_parameter;
};
using ChainMap = std::function<MapValue(const Eigen::VectorXd& z, const Eigen::VectorXd& theta)>;

/// How neighbours of a MapChainResidual have to meet.
struct MapMatching {
    bool constraint = false;     ///< equality, else records linked to the next block
    estimator::Group group;      ///< of the linked records
    std::vector<double> stages;  ///< fixed sds to go through one after the other; empty: that of `group` alone
};

/// Readings of a map's states along one orbit, the states latent, neighbours linked:
///
///     e_b = y_b - z_b,   and   z_{b+1} - F(z_b; theta) = error, or = 0
///
/// All coordinates are read with one scale. States start on their readings.
class MapChainResidual : public estimator::Residual {
public:
    MapChainResidual(ChainMap map, Eigen::MatrixXd readings, estimator::Group reading, MapMatching matching)
        : map_(std::move(map)), readings_(std::move(readings)), matching_(std::move(matching)) {
        groups_ = {std::move(reading)};
        if (!matching_.constraint) groups_.push_back(matching_.group);
        if (!matching_.stages.empty()) groups_[1].scale.value = matching_.stages.front();
        const Eigen::Index n = readings_.rows();
        for (Eigen::Index b = 0; b < readings_.cols(); ++b) {
            estimator::BlockLayout block;
            block.label = "point " + std::to_string(b);
            block.group.assign(static_cast<std::size_t>(n), 0);
            block.latents = n;
            if (b + 1 < readings_.cols()) {
                block.next = b + 1;
                if (matching_.constraint) {
                    block.constraints = n;
                } else {
                    block.linked_from = n;
                    block.group.resize(static_cast<std::size_t>(2 * n), 1);
                }
            }
            layout_.push_back(std::move(block));
        }
    }

    [[nodiscard]] std::string_view type() const override { return "map"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override {
        std::vector<Eigen::VectorXd> states;
        for (Eigen::Index b = 0; b < readings_.cols(); ++b)
            states.emplace_back(readings_.col(b));
        return states;
    }
    [[nodiscard]] estimator::ActiveSet initial_set() const override {
        return {groups_, layout_, initial_latents(), matching_.stages.size() > 1, {Eigen::VectorXd::Zero(1)}};
    }
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd&,
                                               const std::vector<Eigen::VectorXd>&,
                                               const Eigen::VectorXd& scales) const override {
        scales_seen.push_back(scales);
        if (!active.is_intermediate_stage) return {};
        const auto stage = static_cast<std::size_t>(++active.memory[0][0]);
        active.groups[1].scale.value = matching_.stages[stage];
        active.is_intermediate_stage = stage + 1 < matching_.stages.size();
        return {};
    }

    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        for (std::size_t b = 0; b < layout_.size(); ++b)
            if (active.layout[b].active) values[b] = value(b, theta, latents, derivatives);
        return values;
    }

    mutable std::vector<Eigen::VectorXd> scales_seen;  ///< by update_active_set()

private:
    [[nodiscard]] estimator::BlockValue value(std::size_t b, const Eigen::VectorXd& theta,
                                              const std::vector<Eigen::VectorXd>& latents, bool derivatives) const {
        const Eigen::Index n = readings_.rows();
        const auto records = static_cast<Eigen::Index>(layout_[b].group.size());
        const Eigen::Index constraints = layout_[b].constraints;
        const bool joined = layout_[b].next >= 0;
        estimator::BlockValue value;
        value.e.resize(records);
        value.e.head(n) = readings_.col(static_cast<Eigen::Index>(b)) - latents[b];
        const MapValue image = joined ? map_(latents[b], theta) : MapValue{};
        if (joined) {
            const Eigen::VectorXd gap = latents[b + 1] - image.next;
            if (matching_.constraint)
                value.c = gap;
            else
                value.e.tail(n) = gap;
        }
        if (!derivatives) return value;
        value.e_theta.setZero(records, theta.size());
        value.e_z.setZero(records, n);
        value.e_z.topRows(n) = -Eigen::MatrixXd::Identity(n, n);
        if (!joined) return value;
        if (matching_.constraint) {
            value.c_theta = -image.by_parameter;
            value.c_z = -image.by_state;
            value.c_next = Eigen::MatrixXd::Identity(constraints, n);
        } else {
            value.e_theta.bottomRows(n) = -image.by_parameter;
            value.e_z.bottomRows(n) = -image.by_state;
            value.e_next.setZero(records, n);
            value.e_next.bottomRows(n).setIdentity();
        }
        return value;
    }

    ChainMap map_;
    Eigen::MatrixXd readings_;
    MapMatching matching_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

/// Henon's map, theta = (a, b): x' = 1 - a x^2 + y, y' = b x.
inline MapValue henon(const Eigen::VectorXd& z, const Eigen::VectorXd& theta) {
    MapValue value;
    value.next = Eigen::Vector2d(1.0 - theta[0] * z[0] * z[0] + z[1], theta[1] * z[0]);
    value.by_state = Eigen::Matrix2d{{-2.0 * theta[0] * z[0], 1.0}, {theta[1], 0.0}};
    value.by_parameter = Eigen::Matrix2d{{-z[0] * z[0], 0.0}, {0.0, z[0]}};
    return value;
}

/// Readings of Henon's map (a = 1.4, b = 0.3) on its attractor, shape (2, count), normal errors of this sd.
inline Eigen::MatrixXd henon_readings(Eigen::Index count, double sd, std::uint64_t seed) {
    std::mt19937_64 generator(seed);
    std::normal_distribution<double> normal(0.0, sd);
    Eigen::VectorXd z = Eigen::Vector2d(0.1, 0.1);
    const Eigen::VectorXd theta = Eigen::Vector2d(1.4, 0.3);
    for (int i = 0; i < 100; ++i)
        z = henon(z, theta).next;
    Eigen::MatrixXd readings(2, count);
    for (Eigen::Index i = 0; i < count; ++i) {
        readings.col(i) = z + Eigen::Vector2d(normal(generator), normal(generator));
        z = henon(z, theta).next;
    }
    return readings;
}

}  // namespace orbid::tests
