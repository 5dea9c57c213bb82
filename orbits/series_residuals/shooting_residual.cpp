#include "orbits/series_residuals/shooting_residual.hpp"

#include <cassert>
#include <stdexcept>

#include <fmt/format.h>

#include "orbits/series_residuals/shooting_interval.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

ShootingResidual::ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                   Series series, ShootingOptions options)
    : matching_(options.matching) {
    auto data = read(std::move(system), std::move(binding), std::move(series), std::move(options));
    const VectorXd all =
        data->options.start.size() > 0 ? data->binding.values(data->options.start) : data->binding.base;
    data->interval = data->options.interval > 0 ? data->options.interval
                                                : shooting_interval(data->systems, all, data->series,
                                                                    data->options.sensor, data->options.segments);
    data->plan = plan_shooting(data->system(), data->series, data->options.segments, data->observed,
                               data->options.sensor, data->interval);
    data_ = data;
    check_matching();
    guess_nodes(all);
    MatrixXd states(data->system().dimension(), std::ssize(start_));
    for (std::size_t b = 0; b < start_.size(); ++b)
        states.col(static_cast<Index>(b)) = start_[b];
    data->range = coordinate_range(data->system(), data->series, states);
    for (const ObservedCoordinate& o : data->observed)
        if (o.group == std::ssize(data->reading_range)) data->reading_range.push_back(data->range[o.coordinate]);
    make_groups();
    make_layout();
    begin_matching(start_theta());
}

void ShootingResidual::guess_nodes(const VectorXd& all) {
    const Data& data = *data_;
    const auto& plan = data.plan;
    start_.resize(plan.nodes.size());
    for (std::size_t f = 0, b = 0; f < data.options.segments.size(); ++f) {
        const std::size_t s = data.options.segments[f];
        std::vector<Index> samples;
        for (std::size_t i = b; i < plan.nodes.size() && plan.nodes[i].segment == s; ++i)
            samples.push_back(plan.nodes[i].sample);
        MatrixXd states;
        if (data.options.nodes.empty()) {
            states = node_states(system_of(s), all, data.series, s, data.options.sensor, samples);
        } else {
            states = data.options.nodes.size() > f ? data.options.nodes[f] : MatrixXd();
            if (states.rows() != data.system().dimension() || states.cols() != std::ssize(samples))
                throw std::invalid_argument(
                    fmt::format("shooting residual: segment {} has {} nodes of {} coordinates, "
                                "given are {} of {}",
                                data.series.segments[s].label, samples.size(), data.system().dimension(), states.cols(),
                                states.rows()));
        }
        if (!states.allFinite())
            throw std::invalid_argument(fmt::format(
                "shooting residual: segment {}: readings do not tell the states: a section needs all coordinates of "
                "the model, samples one at least",
                data.series.segments[s].label));
        for (Index k = 0; k < states.cols(); ++k, ++b)
            start_[b] = states.col(k);
    }
}

ShootingResidual ShootingResidual::with(const Continuity& matching, std::vector<VectorXd> latents,
                                        const VectorXd& theta) const {
    ShootingResidual other = *this;
    other.matching_ = matching;
    other.check_matching();
    if (!latents.empty()) {
        assert(latents.size() == start_.size());
        other.start_ = std::move(latents);
    }
    other.groups_.clear();
    other.layout_.clear();
    other.make_groups();
    other.make_layout();
    for (std::size_t b = 0; b < layout_.size(); ++b)
        other.layout_[b].active = layout_[b].active;
    other.begin_matching(theta.size() > 0 ? theta : start_theta());
    return other;
}

}  // namespace orbid::orbits
